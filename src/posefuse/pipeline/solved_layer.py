"""The solved layer: what is made of measured points over time, in windows of a recording of any length."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Protocol

import numpy as np

from posefuse.arrays import ranges
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections, with_lacking_times
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import Source, ViewStatus, is_used
from posefuse.model.tracks import TrackState
from posefuse.postprocess.bones import Bones
from posefuse.postprocess.points import Clock
from posefuse.postprocess.steps import margin_s, postprocess
from posefuse.trajectory import solve as trajectory
from posefuse.trajectory.observations import MeasuredRange
from posefuse.trajectory.priors import RecordingPriors, estimate_priors

BLOCK_FRAMES = 1024
"""So many frames are solved at a time, and those around them that count."""

_PIECES, _PIECE_FRAMES = 4, 256


@dataclass(frozen=True, eq=False)
class Window:
    """A range of frames with what lies around it.

    Attributes:
        part: frames from ``first`` on, in memory, measured.
        first: counted from 0 in the recording, as are the others.
        start: of the range.
        stop: the frame after its last.
    """

    part: Reconstruction
    first: int
    start: int
    stop: int


class Step(Protocol):
    """One thing that is done to a layer over time."""

    @property
    def margin_s(self) -> float:
        """What lies this far beyond a range changes nothing in it."""
        ...

    def apply(self, window: Window, layer: Layer) -> Layer:
        """The layer after the step, of all frames of the window."""
        ...

    def frames(self, start: int, stop: int) -> "Step":
        """The same step where the frames ``start`` to ``stop`` are the whole recording, in memory."""
        ...


@dataclass(frozen=True, eq=False)
class Postprocess:
    """Gaps, filters and rigid bones; see :mod:`posefuse.postprocess.steps`.

    Attributes:
        rig: the cameras.
        detections: of the whole recording.
        options: of the recording.
        clock: of the whole recording.
        bones: of everybody, or None where they may breathe.
        margin_s: of the filters.
    """

    rig: CameraRig
    detections: Detections
    options: Options
    clock: Clock
    bones: Bones | None
    margin_s: float

    @classmethod
    def of(cls, rig: CameraRig, detections: Detections, options: Options, bones: Bones | None) -> "Postprocess":
        """What the options ask for.

        Raises:
            DetectionsError: if frames have no times.
            OptionsError: if a filter cannot be had at this frame rate.
        """
        clock = clock_of(detections)
        return cls(rig, detections, options, clock, bones, margin_s(options.postprocess, clock))

    def apply(self, window: Window, layer: Layer) -> Layer:
        """The layer after the step, of all frames of the window, with reprojection errors of its points."""
        last = window.first + window.part.n_frames
        clock = self.clock.frames(window.first, last)
        done = postprocess(layer, clock, self.options.postprocess, self.bones)
        if window.part.unit != "m":
            return done
        return with_errors(done, self.rig, self.detections.frames(window.first, last), window.part)

    def frames(self, start: int, stop: int) -> "Postprocess":
        """The same step where the frames ``start`` to ``stop`` are the whole recording, in memory."""
        return replace(self, detections=self.detections.frames(start, stop), clock=self.clock.frames(start, stop))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """All frames of a window together; see :mod:`posefuse.trajectory.solve`.

    Attributes:
        rig: the cameras.
        detections: of the whole recording.
        noise: of the detections.
        laws: of the recording.
        options: of the solve.
    """

    rig: CameraRig
    detections: Detections
    noise: NoiseModel
    laws: RecordingPriors
    options: TrajectoryOptions

    @property
    def margin_s(self) -> float:
        """What lies this far beyond a range changes nothing in it that shows."""
        return trajectory.margin_s(self.laws)

    def apply(self, window: Window, layer: Layer) -> Layer:
        """The layer after the step, of all frames of the window."""
        part = window.part
        assert part.tracks is not None
        detections = self.detections.frames(window.first, window.first + part.n_frames)
        return trajectory.solve(
            self.rig, detections, part.tracks, layer, part.swaps, self.noise, self.laws, self.options
        )

    def frames(self, start: int, stop: int) -> "Trajectory":
        """The same step where the frames ``start`` to ``stop`` are the whole recording, in memory."""
        return replace(self, detections=self.detections.frames(start, stop))


def learned(
    rig: CameraRig,
    detections: Detections,
    noise: NoiseModel,
    spans: Sequence[tuple[int, int]],
    measured: Callable[[int, int], Reconstruction],
    options: TrajectoryOptions,
) -> Trajectory:
    """The solve of a recording, with what a sample tells of its motion, bones and errors.

    Args:
        rig: the cameras.
        detections: of the whole recording.
        noise: of the detections.
        spans: ranges of frames, counted from 0, to learn from.
        measured: makes what was measured in one.
        options: of the solve.
    """

    def told() -> Iterator[MeasuredRange]:
        for span in spans:
            part = measured(*span)
            assert part.tracks is not None
            yield MeasuredRange(rig, detections.frames(*span), part.tracks, part.layers["measured"], part.swaps, noise)

    laws = estimate_priors(told(), detections.skeleton, options)
    if len(spans) > 1:
        # One range would tell the solve of it no more than it finds itself.
        laws = trajectory.estimate_roughness(laws, told(), options)
    return Trajectory(rig, detections, noise, laws, options)


def telling_spans(states: np.ndarray) -> list[tuple[int, int]]:
    """Ranges of frames that show how everybody moves: evenly spread ones, and of each person the middle of their life.

    Args:
        states: shape (frame, person), of the whole recording: :class:`TrackState`.
    """
    n_frames = len(states)
    if n_frames <= _PIECES * _PIECE_FRAMES:
        return [(0, n_frames)]
    starts = np.linspace(0, n_frames - _PIECE_FRAMES, _PIECES).astype(int).tolist()
    for state in states.T:
        there = np.flatnonzero(state == TrackState.ACTIVE)
        if len(there):
            middle = int(there[len(there) // 2])
            starts.append(min(max(middle - _PIECE_FRAMES // 2, 0), n_frames - _PIECE_FRAMES))
    spans: list[tuple[int, int]] = []
    for start in sorted(starts):
        first, last = max(start, spans[-1][1] if spans else 0), start + _PIECE_FRAMES
        if first < last:
            spans.append((first, last))
    return spans


@dataclass(frozen=True, eq=False)
class Solver:
    """The steps that make the solved layer of the measured one.

    Attributes:
        steps: one after the other.
        period_s: between frames.
    """

    steps: tuple[Step, ...]
    period_s: float

    @property
    def margin(self) -> int:
        """How many frames around a range its steps look at."""
        return round(sum(step.margin_s for step in self.steps) / self.period_s) + 1

    @property
    def size(self) -> int:
        """How many frames are solved at a time: those of a block, or as many as the steps look at on either side."""
        return max(BLOCK_FRAMES, self.margin)

    def solve(
        self, parts: Iterable[Reconstruction], n_frames: int, size: int | None = None, done: int = 0, begin: int = 0
    ) -> Iterator[Reconstruction]:
        """The recording with its solved layer, in ranges of its own, the same however it comes.

        Args:
            parts: consecutive ranges of frames, with a measured layer.
            n_frames: of all of them.
            size: so many frames are solved at a time; :attr:`size` where it is left out.
            done: so many ranges are left out.
            begin: the first frame of the first part, counted from 0; no later than the first that is looked at.
        """
        return map(self.solved, windows(iter(parts), n_frames, self.margin, size or self.size, done, begin))

    def solved(self, window: Window) -> Reconstruction:
        """The range of a window with its solved layer."""
        layer = window.part.layers["measured"]
        for step in self.steps:
            layer = step.apply(window, layer)
        return _inner(window, layer)

    def alone(self, window: Window) -> "tuple[Solver, Window]":
        """A solver that knows the frames of a window alone, and the window as it knows it: the same comes out."""
        last = window.first + window.part.n_frames
        steps = tuple(step.frames(window.first, last) for step in self.steps)
        moved = Window(window.part, 0, window.start - window.first, window.stop - window.first)
        return replace(self, steps=steps), moved


def _inner(window: Window, solved: Layer) -> Reconstruction:
    """The range itself; its layers from the rawest to the most processed."""
    start, stop = window.start - window.first, window.stop - window.first
    part = window.part.frames(start, stop)
    rest = {name: layer for name, layer in part.layers.items() if name != "measured"}
    layers = {"measured": part.layers["measured"], "solved": solved.frames(start, stop), **rest}
    return replace(part, layers=layers, events=window.part.events)


def windows(
    parts: Iterator[Reconstruction], n_frames: int, margin: int, size: int, done: int = 0, begin: int = 0
) -> Iterator[Window]:
    """Ranges of ``size`` frames with ``margin`` frames on either side, from consecutive ranges of any size.

    Args:
        parts: the ranges there are.
        n_frames: of the recording.
        margin: frames on either side.
        size: of the ranges.
        done: so many of them are left out.
        begin: the first frame of the first part, counted from 0.
    """
    held: list[Reconstruction] = []
    end = begin
    for start, stop in islice(ranges(n_frames, size), done, None):
        first, last = max(start - margin, 0), min(stop + margin, n_frames)
        begin += _passed(held, first - begin)
        while end < last:
            held.append(next(parts))
            end += held[-1].n_frames
            begin += _passed(held, first - begin)
        events = held[0].events
        part = Reconstruction.concatenate(held).frames(first - begin, last - begin)
        yield Window(replace(part, events=events), first, start, stop)


def _passed(held: list[Reconstruction], frames: int) -> int:
    """Let go of the ranges that lie within so many frames from the first; how many frames they have."""
    passed = 0
    while held and passed + held[0].n_frames <= frames:
        passed += held.pop(0).n_frames
    return passed


def clock_of(detections: Detections) -> Clock:
    """When the frames of a recording were.

    Raises:
        DetectionsError: if nobody knows.
    """
    return Clock.of(with_lacking_times(mean_times(detections), detections.frame_numbers), detections.rate_hz)


def mean_times(detections: Detections) -> np.ndarray:
    """Shape (frame,): mean over the views that took the frame; NaN where unknown."""
    recorded = np.asarray(detections.recorded) & np.isfinite(detections.time_s)
    count = recorded.sum(axis=1)
    total = np.where(recorded, detections.time_s, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def with_errors(layer: Layer, rig: CameraRig, detections: Detections, part: Reconstruction) -> Layer:
    """A layer with the distances of its points from the detections; those as they were measured keep theirs.

    Args:
        layer: with points that may have moved.
        rig: the cameras.
        detections: of the same frames.
        part: of the same frames, with tracks.
    """
    assert part.tracks is not None
    rows, mirror = part.tracks.rows(detections), part.skeleton.mirror
    points, views = np.asarray(layer.points_m), np.asarray(layer.view_status)
    errors = np.full(views.shape, np.nan, dtype=np.float32)
    for v, camera in enumerate(rig.cameras):
        there = rows[:, :, v] >= 0
        seen = np.asarray(detections.keypoints_px)[rows[:, :, v][there]]
        exchanged = (views[there][:, :, v] == ViewStatus.USED_SWAPPED)[..., None]
        seen = np.where(exchanged, seen[:, mirror], seen)
        errors[there, :, v] = np.linalg.norm(camera.project(points[there])[0] - seen, axis=-1)
    kept = np.isin(np.asarray(layer.source), (Source.MEASURED, Source.TRAJECTORY))
    errors = np.where(kept[..., None], np.asarray(layer.view_error_px), errors)
    counted = is_used(views) & np.isfinite(errors)
    number = counted.sum(axis=-1)
    mean = np.where(counted, errors, 0.0).sum(axis=-1, dtype=np.float64) / np.maximum(number, 1)
    mean = np.where(kept, np.asarray(layer.reprojection_error_px), np.where(number > 0, mean, np.nan))
    return replace(layer, view_error_px=errors, reprojection_error_px=mean)
