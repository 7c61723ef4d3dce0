"""First step of the tracker: predict all tracks to the time of a frame."""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.frame_clock import differ_in_time
from posefuse.tracking.strategy import TrackerSetup
from posefuse.tracking.track_set import TrackSet

_MAX_LOG_ODDS = 600.0
"""Larger log odds make a probability zero."""
_MAX_PROBABILITY = 1.0 - 1e-12


@dataclass(frozen=True, eq=False)
class FrameInput:
    """One frame with its times.

    Attributes:
        frame: The detections.
        time_s: Time of the frame, in seconds.
        dt_s: Time since the last frame, in seconds.
        view_dt_s: Typical time since the views' own last frames, in seconds.
    """

    frame: Frame
    time_s: float
    dt_s: float
    view_dt_s: float


@dataclass(frozen=True, eq=False)
class Prediction:
    """Tracks predicted to the time of a frame.

    Attributes:
        projected: Predicted keypoints in space and in the views.
        state_before: States at the time of the last frame if the views differ in time, else None.
    """

    projected: ProjectedBodies
    state_before: State | None


def predict(tracks: TrackSet, frame: FrameInput, setup: TrackerSetup) -> Prediction:
    """Predict all tracks to the time of a frame.

    Args:
        tracks: Updated in place: states and swap probabilities.
        frame: The frame.
        setup: Setup of the tracker.
    """
    s = setup.settings
    if not len(tracks):
        return Prediction(ProjectedBodies.allocate(0, len(s.rig), len(s.skeleton)), None)
    setup.strategy.prior.prepare(tracks.state, tracks.recent)
    before = select_states(tracks.state, np.arange(len(tracks))) if differ_in_time(frame.frame) else None
    setup.strategy.motion.advance(tracks.state, frame.dt_s, s)
    projected = tracks.projected(s.cameras, s)
    predict_swaps(tracks.recent.swapped, frame.dt_s, s.options)
    return Prediction(projected, before)


def predict_swaps(swapped: np.ndarray, dt_s: float, options: TrackerOptions) -> None:
    """Predict the probabilities of left/right swaps of limbs, seen or not.

    A swap is a Markov chain of two states with a mean duration of ``swap_duration_s``.

    Args:
        swapped: shape (track, view, group), in and out: probability that left and right are swapped.
        dt_s: Time since the last frame, in seconds.
        options: Options of the tracker.
    """
    stationary = 1.0 / (1.0 + math.exp(min(-options.swap_log_odds, _MAX_LOG_ODDS)))
    retained = math.exp(-max(dt_s, 0.0) / options.swap_duration_s)
    np.subtract(swapped, stationary, out=swapped)
    np.multiply(swapped, retained, out=swapped)
    np.add(swapped, stationary, out=swapped)
    np.maximum(swapped, math.exp(-_MAX_LOG_ODDS), out=swapped)
    np.minimum(swapped, _MAX_PROBABILITY, out=swapped)
