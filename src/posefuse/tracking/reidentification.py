"""Re-identification: whether a new person is one whose track was lost, by position and by bone lengths."""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.segment_lengths import measured_lengths
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_evidence import log_evidence, person_lengths
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.records import Observation, Track
from posefuse.tracking.settings import TrackerSettings, correlation_factor

_CALM_SHARE = 0.25
"""Share of the predicted variance with which people mostly move.

Lost people who walked in simulated rooms are off by 0.3 to 0.65 predicted standard deviations after 0.4 to 4 s."""
_CENTER_SHARE = 1.0 / 3.0
"""Share of ``trunk_sd_m`` with which the center of a fitted body is known: it needs no visible trunk."""
_ANYWHERE = 0.02
"""Probability that a lost person moved as no prediction expects, and is anywhere within reach."""


@dataclass(frozen=True)
class Reidentification:
    """A lost track that a new person continues.

    Attributes:
        track: Index of the track.
        reason: Reason, as a clause.
        doubt: What makes the identification uncertain; empty if it is certain.
        position: Log odds of the position alone.
    """

    track: int
    reason: str
    doubt: str = ""
    position: float = math.inf


def find_lost_track(
    tracks: list[Track],
    state: State,
    fitted: State,
    observation: Observation,
    since_s: float,
    time_s: float,
    settings: TrackerSettings,
) -> Reidentification | None:
    """Find the lost track of a new person, if that is more likely than a new identity or the only possibility.

    A track that is not lost yet is considered too if it has been unsupported for a large enough share of the time for
    which the new person was visible.

    Args:
        tracks: Confirmed tracks.
        state: States of the tracks.
        fitted: State of the new person's body.
        observation: Detections of the new person in this frame.
        since_s: Time at which the new person was first seen, in seconds.
        time_s: Time of the frame, in seconds.
        settings: Settings of the tracker.
    """
    options = settings.options.reidentification
    closed = population_is_known(tracks, settings)
    missing = [
        p
        for p, track in enumerate(tracks)
        if track.state == TrackState.LOST or time_s - track.last_seen_s > options.min_absence_share * (time_s - since_s)
    ]
    odds, near = lost_log_odds(tracks, state, missing, fitted, observation, settings, closed)
    if not (odds > -math.inf).any():
        return None
    best = int(odds.argmax())
    if odds[best] < options.min_log_odds and not closed:
        return None
    others = [p for i, p in enumerate(missing) if i != best and odds[best] - odds[i] < options.ambiguity_log_odds]
    doubt = f"{tracks[others[0]].name} is equally likely" if others else ""
    absent_s = time_s - tracks[missing[best]].last_seen_s
    reason = f"log odds {odds[best]:.1f} of the same person after {absent_s:.1f} s"
    return Reidentification(missing[best], reason, doubt, float(near[best]))


def lost_log_odds(
    tracks: list[Track],
    state: State,
    lost: list[int],
    fitted: State,
    observation: Observation,
    settings: TrackerSettings,
    closed: bool = False,
    *,
    is_fitted_alone: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the log odds that an observation shows each lost person, and not a new one.

    They are -inf for people beyond reach. Some observations of lengths are outliers.

    Args:
        tracks: Confirmed tracks.
        state: States of the tracks.
        lost: Indices of the lost tracks.
        fitted: State of a body fitted to the observation, without a prior from the tracks.
        observation: Detections of one person.
        settings: Settings of the tracker.
        closed: Whether no new identity is possible, so that no place is beyond reach.
        is_fitted_alone: Whether ``fitted`` is fitted to this observation alone.

    Returns:
        The log odds, and those of the position alone, shape (lost,) each.
    """
    share, tree = settings.options.reidentification.corrupt_share, settings.tree
    absent_s = np.array([observation.time_s - tracks[p].last_seen_s for p in lost])
    near = position_log_odds(select_states(state, lost), absent_s, fitted, settings, closed)
    odds = near.copy()
    if not (odds > -math.inf).any():
        return odds, near
    anyone = fitted if is_fitted_alone else None
    other = log_evidence(observation, tree.shape_m, tree.shape_covariance, settings, anyone)
    for i in np.flatnonzero(odds > -math.inf).tolist():
        own = log_evidence(observation, *person_lengths(tracks[lost[i]], state, lost[i], settings), settings)
        alike = own - other if math.isfinite(own) and math.isfinite(other) else 0.0
        odds[i] += np.logaddexp(alike + math.log(1.0 - share), math.log(share))
    return odds, near


def position_log_odds(
    lost: State, absent_s: np.ndarray, fitted: State, settings: TrackerSettings, closed: bool = False
) -> np.ndarray:
    """Return the log odds of a position: a lost person's, against anywhere in a room; shape (lost,).

    The motion model predicts fast movements as well. A person mostly moves less, at times as predicted, and rarely is
    anywhere within reach. The result is -inf for a person beyond reach.

    Args:
        lost: Predicted states of the lost people.
        absent_s: shape (lost,): times since they were last seen, in seconds.
        fitted: State of the body at the position.
        settings: Settings of the tracker.
        closed: Whether no new identity is possible, so that no place is beyond reach.
    """
    centers_m = [_centers_m(each, settings) for each in (lost, fitted)]
    options, offset_m = settings.options.reidentification, centers_m[1] - centers_m[0]
    reach_m = _reach_m(absent_s, settings)
    anywhere = 3.0 * np.log(options.room_m / np.minimum(reach_m, options.room_m)) + math.log(_ANYWHERE)
    floor = (_CENTER_SHARE * options.trunk_sd_m) ** 2 * np.eye(3)
    uniform = 3.0 * math.log(options.room_m / math.sqrt(2.0 * math.pi))
    odds = anywhere
    for share in (_CALM_SHARE, 1.0):
        spread = share * lost.covariance[:, :3, :3] + floor
        squared = (offset_m * np.linalg.solve(spread, offset_m[..., None])[..., 0]).sum(axis=1)
        near = uniform - 0.5 * np.linalg.slogdet(spread)[1] - 0.5 * squared
        odds = np.logaddexp(odds, near + math.log(0.5 * (1.0 - _ANYWHERE)))
    beyond = (np.linalg.norm(offset_m, axis=1) > reach_m) & (not closed)
    return np.where(beyond, -math.inf, odds)


def may_be_within_reach(
    tracks: list[Track], state: State, lost: list[int], observations: list[Observation], settings: TrackerSettings
) -> np.ndarray:
    """Return which observations may show a lost person within reach, shape (observation,), bool.

    A body that is fitted to the others would be beyond the reach of all lost people. Its center is within the size of a
    body of the observed trunk.

    Args:
        tracks: Confirmed tracks.
        state: States of the tracks.
        lost: Indices of the lost tracks.
        observations: Observations of the same frame.
        settings: Settings of the tracker.
    """
    centers_m = _centers_m(select_states(state, lost), settings)
    absent_s = np.array([[each.time_s - tracks[p].last_seen_s for p in lost] for each in observations])
    offset_m = np.linalg.norm(np.stack([each.torso_m for each in observations])[:, None] - centers_m, axis=-1)
    # An unknown trunk may be anywhere.
    return (~(offset_m > _reach_m(absent_s, settings) + settings.tree.size_m)).any(axis=1)


def _reach_m(absent_s: np.ndarray, settings: TrackerSettings) -> np.ndarray:
    return settings.options.reidentification.reach_m + settings.options.motion.top_speed_m_s * absent_s


def _centers_m(bodies: State, settings: TrackerSettings) -> np.ndarray:
    """Return the centers of the cores of bodies, shape (person, 3), in meters."""
    points_m = ProjectedBodies.of(bodies, settings.cameras[:0], settings.body).points_m[:, settings.core]
    return np.nanmean(points_m, axis=1)


def population_is_known(tracks: list[Track], settings: TrackerSettings) -> bool:
    """Return whether all individuals have been tracked, so no new identity is possible."""
    population = settings.options.population
    return population is not None and sum(track.established for track in tracks) >= population


def same_body_log_odds(
    settings: TrackerSettings,
    track: Track,
    state: State,
    index: int,
    fitted: State,
    observed_s: float,
    error_factor: float = 1.0,
    floor_factor: float = 1.0,
) -> float:
    """Return the log likelihood ratio of measured bone lengths: this person's against any person's.

    Args:
        settings: Settings of the tracker.
        track: Track of the person.
        state: States of the tracks, for lengths that are still estimated.
        index: Index of the track.
        fitted: State of one body, fitted without a prior from the track.
        observed_s: Time for which that body was observed, in seconds.
        error_factor: Factor on the covariances of the measured lengths.
        floor_factor: Factor on the standard deviations of lengths between observations.
    """
    tree, options = settings.tree, settings.options
    n, h = tree.n_pose, tree.n_shape
    known = track.known_shape or (state.shape[index], state.covariance[index, n : n + h, n : n + h])
    # Each observation places the joints differently, so lengths differ systematically between observations.
    share, offset_m = options.reidentification.length_sd_share, options.reidentification.length_sd_m
    floor = 0.5 * np.diag((floor_factor * (share * np.abs(tree.shape_m) + offset_m)) ** 2)
    theirs, error = measured_lengths(tree, *known)
    error = error_factor * correlation_factor(track.shape_observed_s, options) * error + floor
    new, new_error = measured_lengths(tree, fitted.shape[0], fitted.covariance[0, n : n + h, n : n + h])
    new_error = error_factor * correlation_factor(observed_s, options) * new_error + floor
    gain = np.linalg.solve(tree.shape_covariance + error, tree.shape_covariance).T
    left = tree.shape_covariance - gain @ tree.shape_covariance
    return _log_normal(new - gain @ theirs, left + new_error) - _log_normal(new, tree.shape_covariance + new_error)


def _log_normal(residual: np.ndarray, covariance: np.ndarray) -> float:
    sign, log_determinant = np.linalg.slogdet(covariance)
    if sign <= 0:
        return -math.inf
    return float(-0.5 * (log_determinant + residual @ np.linalg.solve(covariance, residual)))
