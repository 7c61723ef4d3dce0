"""The solved layer: measured points processed over time, in windows of a recording of any length."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Protocol

import numpy as np

from posefuse.arrays import ranges
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.track_events import Poses
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.defaults import BLOCK_FRAMES
from posefuse.pipeline.foot_contact import FootContact
from posefuse.pipeline.reprojection_errors import with_reprojection_errors
from posefuse.pipeline.resting_feet import with_resting_feet
from posefuse.postprocess.bones import Bones
from posefuse.postprocess.points import Clock
from posefuse.postprocess.steps import margin_s, postprocess
from posefuse.preprocess.timeline import fill_missing_times
from posefuse.trajectory import solve as trajectory
from posefuse.trajectory.observations import MeasuredRange
from posefuse.trajectory.priors import RecordingPriors


@dataclass(frozen=True, eq=False)
class FrameWindow:
    """A range of frames with a margin around it.

    Attributes:
        part: the frames from ``first`` on, in memory, with a measured layer.
        first: index of the first frame of ``part`` in the recording.
        start: index of the first frame of the range.
        stop: index after its last frame.
        own: the range without the margin, if that is in memory anyway; None to copy it from ``part``.
    """

    part: Reconstruction
    first: int
    start: int
    stop: int
    own: Reconstruction | None = None

    def without_margin(self) -> Reconstruction:
        """Return the range."""
        if self.own is not None:
            return self.own
        return replace(self.part.frames(self.start - self.first, self.stop - self.first), events=self.part.events)


class Step(Protocol):
    """One operation on a layer over time."""

    @property
    def margin_s(self) -> float:
        """Frames farther than this from a range do not affect the range."""
        ...

    def apply(self, window: FrameWindow, layer: Layer) -> Layer:
        """Return the layer after the step, for all frames of the window."""
        ...

    def frames(self, start: int, stop: int) -> "Step":
        """Return the same step for the frames ``start`` to ``stop`` as a recording of their own, in memory."""
        ...

    def with_views(self, rig: CameraRig, detections: Detections, noise: NoiseModel) -> "Step":
        """Return the same step for the same frames with other views."""
        ...


@dataclass(frozen=True, eq=False)
class Postprocess:
    """Fill gaps, filter and make bones rigid; see :mod:`posefuse.postprocess.steps`.

    Attributes:
        rig: calibrated cameras.
        detections: detections of the whole recording.
        options: options of the reconstruction.
        clock: frame times of the whole recording.
        bones: bone lengths of all people, or None where lengths may vary.
        margin_s: margin of the filters.
    """

    rig: CameraRig
    detections: Detections
    options: Options
    clock: Clock
    bones: Bones | None
    margin_s: float

    @classmethod
    def of(cls, rig: CameraRig, detections: Detections, options: Options, bones: Bones | None) -> "Postprocess":
        """Return the step that the options ask for.

        Raises:
            DetectionsError: if frames have no times.
            OptionsError: if a filter is not possible at this frame rate.
        """
        clock = clock_of(detections)
        return cls(rig, detections, options, clock, bones, margin_s(options.postprocess, clock))

    def apply(self, window: FrameWindow, layer: Layer) -> Layer:
        """Return the layer after the step, for all frames of the window, with new reprojection errors."""
        last = window.first + window.part.n_frames
        clock = self.clock.frames(window.first, last)
        processed = postprocess(layer, clock, self.options.postprocess, self.bones)
        if window.part.unit != "m":
            return processed
        return with_reprojection_errors(processed, self.rig, self.detections.frames(window.first, last), window.part)

    def frames(self, start: int, stop: int) -> "Postprocess":
        """Return the same step for the frames ``start`` to ``stop`` as a recording of their own, in memory."""
        return replace(self, detections=self.detections.frames(start, stop), clock=self.clock.frames(start, stop))

    def with_views(self, rig: CameraRig, detections: Detections, noise: NoiseModel) -> "Postprocess":
        """Return the same step for the same frames with other views."""
        return replace(self, rig=rig, detections=detections)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Solve all frames of a window together; see :mod:`posefuse.trajectory.solve`.

    Attributes:
        rig: calibrated cameras.
        detections: detections of the whole recording.
        noise: noise of the detections.
        priors: priors of motion, bones and errors, fitted to the recording.
        options: options of the solve.
        contact: estimates which feet rest on the ground; None leaves contact out.
    """

    rig: CameraRig
    detections: Detections
    noise: NoiseModel
    priors: RecordingPriors
    options: TrajectoryOptions
    contact: FootContact | None = None

    @property
    def margin_s(self) -> float:
        """Frames farther than this from a range do not visibly affect the range."""
        return trajectory.margin_s(self.priors)

    def apply(self, window: FrameWindow, layer: Layer) -> Layer:
        """Return the layer after the step, for all frames of the window."""
        part = window.part
        assert part.tracks is not None
        detections = self.detections.frames(window.first, window.first + part.n_frames)
        measured = MeasuredRange(self.rig, detections, part.tracks, layer, part.swaps, self.noise)
        return trajectory.solve(measured, self.priors, self.options, self.contact)

    def frames(self, start: int, stop: int) -> "Trajectory":
        """Return the same step for the frames ``start`` to ``stop`` as a recording of their own, in memory."""
        return replace(self, detections=self.detections.frames(start, stop))

    def with_views(self, rig: CameraRig, detections: Detections, noise: NoiseModel) -> "Trajectory":
        """Return the same step for the same frames with other views."""
        return replace(self, rig=rig, detections=detections, noise=noise)


@dataclass(frozen=True, eq=False)
class LayerSolver:
    """The steps that turn the measured layer into the solved layer.

    Attributes:
        steps: steps in the order in which they are applied.
        period_s: time between frames.
    """

    steps: tuple[Step, ...]
    period_s: float

    @property
    def margin(self) -> int:
        """Number of frames on either side of a range that the steps read."""
        return round(sum(step.margin_s for step in self.steps) / self.period_s) + 1

    @property
    def size(self) -> int:
        """Number of frames solved at a time: a block, or the margin if that is longer."""
        return max(BLOCK_FRAMES, self.margin)

    def solve(
        self,
        parts: Iterable[Reconstruction],
        n_frames: int,
        size: int | None = None,
        *,
        done: int = 0,
        begin: int = 0,
        jobs: Jobs = ONE_JOB,
    ) -> Iterator[Reconstruction]:
        """Return the recording with its solved layer, in ranges of ``size`` frames, however ``parts`` is divided.

        Args:
            parts: consecutive ranges of frames with a measured layer.
            n_frames: number of frames of the recording.
            size: number of frames solved at a time, by default :attr:`size`.
            done: number of ranges to skip.
            begin: index of the first frame of the first part, no later than the first frame that is read.
            jobs: processes that solve.
        """
        windows = frame_windows(iter(parts), n_frames, self.margin, size or self.size, done, begin)
        pieces = map(self._part_and_piece, windows)
        # No window waits for a process: each takes as much memory as the range itself.
        solved = jobs.in_order_with(_solve_piece, pieces, jobs.number - 1)
        # Unlike a generator, a map does not keep a range while the next one is computed.
        return map(lambda found: _with_solved(*found), solved)

    def solve_window(self, window: FrameWindow) -> Reconstruction:
        """Return the range of a window with its solved layer."""
        return _with_solved(window.without_margin(), self._solve_frames(window))

    def _solve_frames(self, window: FrameWindow) -> "_SolvedFrames":
        layer = window.part.layers["measured"]
        for step in self.steps:
            layer = step.apply(window, layer)
        start, stop = window.start - window.first, window.stop - window.first
        solved, part = with_true_statuses(layer).frames(start, stop), window.part
        step = self._contact_step
        if step is None or step.contact is None or part.poses is None:
            return _SolvedFrames(solved, None, None)
        detections = step.detections.frames(window.first, window.first + part.n_frames)
        part = with_resting_feet(part, layer, step.contact, step.rig, detections).frames(start, stop)
        return _SolvedFrames(solved, part.layers["model"], part.poses)

    @property
    def _contact_step(self) -> Trajectory | None:
        """The step that knows which feet rest."""
        return next((each for each in self.steps if isinstance(each, Trajectory) and each.contact is not None), None)

    def _part_and_piece(self, window: FrameWindow) -> "tuple[Reconstruction, tuple[LayerSolver, FrameWindow]]":
        """Return the range, and the same as :meth:`restricted_to`, without bodies where the steps do not read them."""
        own = window.without_margin()
        if self._contact_step is None:
            layers = {"measured": window.part.layers["measured"]}
            window = replace(window, part=replace(window.part, layers=layers, poses=None))
        return own, self.restricted_to(window)

    def restricted_to(self, window: FrameWindow) -> "tuple[LayerSolver, FrameWindow]":
        """Return a solver that holds the data of a window only, and the window by its frame indices.

        The solver returns the same for the window as this one.
        """
        last = window.first + window.part.n_frames
        steps = tuple(step.frames(window.first, last) for step in self.steps)
        moved = FrameWindow(window.part, 0, window.start - window.first, window.stop - window.first)
        return replace(self, steps=steps), moved


@dataclass(frozen=True, eq=False)
class _SolvedFrames:
    """What a solve over time adds to a range of frames.

    Attributes:
        solved: the solved layer.
        model: the model layer, if its feet rest where those of the solved layer do; else None.
        poses: poses of the same bodies, or None.
    """

    solved: Layer
    model: Layer | None
    poses: Poses | None


def _solve_piece(piece: tuple[LayerSolver, FrameWindow]) -> _SolvedFrames:
    solver, window = piece
    return solver._solve_frames(window)


def _with_solved(part: Reconstruction, found: _SolvedFrames) -> Reconstruction:
    """Return a range of frames with its solved layer; layers are ordered from the rawest to the most processed."""
    rest = {name: layer for name, layer in part.layers.items() if name != "measured"}
    if found.model is not None:
        rest["model"] = found.model
        part = replace(part, poses=found.poses)
    return replace(part, layers={"measured": part.layers["measured"], "solved": found.solved, **rest})


def frame_windows(
    parts: Iterator[Reconstruction], n_frames: int, margin: int, size: int, done: int = 0, begin: int = 0
) -> Iterator[FrameWindow]:
    """Return ranges of ``size`` frames with ``margin`` frames on either side, from consecutive ranges of any size.

    Args:
        parts: consecutive ranges of frames.
        n_frames: number of frames of the recording.
        margin: number of frames on either side.
        size: number of frames of the ranges returned.
        done: number of ranges to skip.
        begin: index of the first frame of the first part.
    """
    held: list[Reconstruction] = []
    end = begin
    for start, stop in islice(ranges(n_frames, size), done, None):
        first, last = max(start - margin, 0), min(stop + margin, n_frames)
        begin += _drop_before(held, first - begin)
        while end < last:
            held.append(next(parts))
            end += held[-1].n_frames
            begin += _drop_before(held, first - begin)
        yield _window_of(held, begin, (first, last), (start, stop))


def _window_of(
    held: Sequence[Reconstruction], begin: int, around: tuple[int, int], span: tuple[int, int]
) -> FrameWindow:
    """Return a window of consecutive ranges.

    Args:
        held: the ranges, each with frames of the window.
        begin: index of the first frame of the first range.
        around: first frame and end of the window.
        span: first frame and end of the window without its margins.
    """
    events, parts, at = held[0].events, [], begin
    for each in held:
        # Only the frames of the window are copied.
        parts.append(each.frames(max(around[0] - at, 0), min(around[1] - at, each.n_frames)))
        at += each.n_frames
    own = _find_range(held, span[0] - begin, span[1] - begin)
    own = None if own is None else replace(own, events=events)
    return FrameWindow(replace(Reconstruction.concatenate(parts), events=events), around[0], *span, own)


def _find_range(held: Sequence[Reconstruction], start: int, stop: int) -> Reconstruction | None:
    """Return the range that consists of these frames, counted from the first one held, or None."""
    for each in held:
        if (start, stop) == (0, each.n_frames):
            return each
        start, stop = start - each.n_frames, stop - each.n_frames
    return None


def _drop_before(held: list[Reconstruction], frames: int) -> int:
    """Drop the ranges that end within the first ``frames`` frames; return how many frames were dropped."""
    dropped = 0
    while held and dropped + held[0].n_frames <= frames:
        dropped += held.pop(0).n_frames
    return dropped


def clock_of(detections: Detections) -> Clock:
    """Return the frame times of a recording.

    Raises:
        DetectionsError: if no times are known.
    """
    return Clock.of(fill_missing_times(mean_times(detections), detections.frame_numbers), detections.rate_hz)


def mean_times(detections: Detections) -> np.ndarray:
    """Return the mean time of each frame over the views that recorded it, shape (frame,); NaN where unknown."""
    recorded = np.asarray(detections.recorded) & np.isfinite(detections.time_s)
    count = recorded.sum(axis=1)
    total = np.where(recorded, detections.time_s, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
