"""Evidence of detections for the bone lengths of one person, against those of any person.

A body is fitted to the detections of all views twice: with the lengths of the person as prior, and with those of all
people. Laplace's method (Tierney & Kadane 1986) gives the marginal likelihood of the detections under each. The lengths
of a body that is fitted freely are no substitute: two views hardly fix the depth, and make the body too large.
"""

import math

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.tracking.body_states import ProjectedBodies, shape_block
from posefuse.tracking.records import Observation, Track
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_initiation import fit_last_state

_INDEPENDENT_SHARE = 0.5
"""Share of the information of a frame's keypoints that is independent: the errors of neighboring ones are similar.

In simulated rooms, a person's own lengths are favored in 95 % of frames from 0.5 on, also in two views.
"""


def person_lengths(track: Track, state: State, index: int, settings: TrackerSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return the distribution of the lengths that another observation of a person shows.

    Each observation places the joints differently, so that lengths differ between observations.

    Args:
        track: Track of the person.
        state: States of the tracks, for lengths that are still estimated.
        index: Index of the track.
        settings: Settings of the tracker.

    Returns:
        Mean, shape (shape,), in meters, and covariance, shape (shape, shape).
    """
    options = settings.options.reidentification
    mean_m, covariance = track.known_shape or (state.shape[index], shape_block(state, index, settings.tree))
    floor_m = options.length_sd_share * np.abs(settings.tree.shape_m) + options.length_sd_m
    return mean_m, covariance + np.diag(floor_m**2)


def log_evidence(
    observation: Observation,
    shape_m: np.ndarray,
    covariance: np.ndarray,
    settings: TrackerSettings,
    fitted: State | None = None,
) -> float:
    """Return the log marginal likelihood of the detections of one body, up to a constant that no prior changes.

    Args:
        observation: Detections of one person in one frame.
        shape_m: shape (shape,): mean of the prior of the lengths, in meters.
        covariance: shape (shape, shape): covariance of that prior.
        settings: Settings of the tracker.
        fitted: State of the body that is fitted to these detections with this prior; None to fit it.

    Returns:
        The log marginal likelihood; -inf if no body fits.
    """
    state = fit_last_state([observation], settings, shape_m, covariance) if fitted is None else fitted
    off_m = state.shape[0] - shape_m
    prior_sign, prior_volume = np.linalg.slogdet(covariance)
    sign, volume = np.linalg.slogdet(state.covariance[0])
    if not (prior_sign > 0 and sign > 0 and np.isfinite(off_m).all()):
        return -math.inf
    prior = -0.5 * (off_m @ np.linalg.solve(covariance, off_m) + prior_volume)
    return float(_INDEPENDENT_SHARE * _log_likelihood(observation, state, settings) + prior + 0.5 * volume)


def _log_likelihood(observation: Observation, state: State, settings: TrackerSettings) -> float:
    """Return the log likelihood of the keypoints, with the Student's t errors of the filter."""
    law = settings.law
    projected = ProjectedBodies.of(state, settings.cameras, settings.body)
    views = np.arange(len(observation.confidence))
    variance = settings.variance_px2(observation.confidence, views) + (law.floor_m * projected.px_per_m[0]) ** 2
    squared = ((observation.keypoints_px - projected.pixels[0]) ** 2).sum(axis=-1) / variance
    return float(np.nansum(-np.log(variance) - 0.5 * (law.nu + 2.0) * np.log1p(squared / law.nu), where=squared >= 0.0))
