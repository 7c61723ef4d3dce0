"""Fit the solve over time to a sample of a recording: priors of motion, bones and errors, and the ground."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.tracks import TrackState
from posefuse.pipeline.foot_contact import find_foot_contact
from posefuse.pipeline.solved_layer import FrameWindow, Trajectory
from posefuse.trajectory import solve as trajectory
from posefuse.trajectory.observations import MeasuredRange, frame_times_s
from posefuse.trajectory.priors import estimate_priors

_TRAINING_RANGES, _TRAINING_FRAMES = 4, 256


class MeasuredSpans(Protocol):
    """Ranges of a recording with their measured layer, which can be read several times."""

    def __len__(self) -> int:
        """Return the number of ranges."""
        ...

    def __iter__(self) -> Iterator[tuple[tuple[int, int], Reconstruction]]:
        """Yield first frame and end of each range, and its frames."""
        ...


def fit_trajectory(
    rig: CameraRig,
    detections: Detections,
    noise: NoiseModel,
    ranges: MeasuredSpans,
    options: TrajectoryOptions,
) -> Trajectory:
    """Fit the priors of motion, bones and errors to ranges of a recording, and return the solve that uses them.

    Args:
        rig: calibrated cameras.
        detections: detections of the whole recording.
        noise: noise of the detections.
        ranges: first frame and end of each range to fit to, from :func:`training_spans`, and its measured frames; it is
            read twice.
        options: options of the solve.
    """

    def measured() -> Iterator[MeasuredRange]:
        for span, part in ranges:
            assert part.tracks is not None
            yield MeasuredRange(rig, detections.frames(*span), part.tracks, part.layers["measured"], part.swaps, noise)

    priors = estimate_priors(measured(), detections.skeleton, options)
    if len(ranges) > 1:
        # The solve of a single range estimates its own roughness equally well.
        priors = trajectory.estimate_roughness(priors, measured(), options)
    return Trajectory(rig, detections, noise, priors, options)


def with_contact(step: Trajectory, ranges: MeasuredSpans) -> Trajectory:
    """Return the solve with feet that rest on the ground, where a sample of the recording shows the ground.

    Args:
        step: solve without contact.
        ranges: first frame and end of each range of the sample, and its measured frames.
    """

    def solved() -> Iterator[tuple[np.ndarray, Layer]]:
        for (start, stop), part in ranges:
            window = FrameWindow(part, start, start, stop)
            times = frame_times_s(step.detections.frames(start, stop))
            yield times, step.apply(window, part.layers["measured"])

    return replace(step, contact=find_foot_contact(step.rig, step.detections.skeleton, solved()))


def training_spans(states: np.ndarray) -> list[tuple[int, int]]:
    """Return ranges of frames that show how all people move.

    The ranges are evenly spread over the recording; for each person one more lies in the middle of their track.

    Args:
        states: shape (frame, person): :class:`TrackState` of the whole recording.
    """
    n_frames = len(states)
    if n_frames <= _TRAINING_RANGES * _TRAINING_FRAMES:
        return [(0, n_frames)]
    starts = np.linspace(0, n_frames - _TRAINING_FRAMES, _TRAINING_RANGES).astype(int).tolist()
    for state in states.T:
        active = np.flatnonzero(state == TrackState.ACTIVE)
        if len(active):
            middle = int(active[len(active) // 2])
            starts.append(min(max(middle - _TRAINING_FRAMES // 2, 0), n_frames - _TRAINING_FRAMES))
    spans: list[tuple[int, int]] = []
    for start in sorted(starts):
        first, last = max(start, spans[-1][1] if spans else 0), start + _TRAINING_FRAMES
        if first < last:
            spans.append((first, last))
    return spans
