"""Re-identification: whether a new person is one whose track was lost, by position and by bone lengths."""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.segment_lengths import measured_lengths
from posefuse.model.tracks import TrackState
from posefuse.tracking.records import Track
from posefuse.tracking.settings import TrackerSettings, correlation_factor


@dataclass(frozen=True)
class Reidentification:
    """A lost track that a new person continues.

    Attributes:
        track: Index of the track.
        reason: Reason, as a clause.
        doubt: What makes the identification uncertain; empty if it is certain.
    """

    track: int
    reason: str
    doubt: str = ""


def find_lost_track(
    tracks: list[Track],
    state: State,
    fitted: State,
    torso_m: np.ndarray,
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
        torso_m: shape (3,): position of the new person.
        since_s: Time at which the new person was first seen, in seconds.
        time_s: Time of the frame, in seconds.
        settings: Settings of the tracker.
    """
    options = settings.options.reidentification
    closed = population_is_known(tracks, settings)
    odds, age_s = {}, settings.options.initiation.min_age_s
    for p, track in enumerate(tracks):
        absent = time_s - track.last_seen_s > options.min_absence_share * (time_s - since_s)
        if track.state == TrackState.LOST or absent:
            near = _position_log_odds(track, torso_m, time_s, settings, closed)
            if near > -math.inf:
                odds[p] = near + length_log_odds(track, state, p, fitted, age_s, settings)
    if not odds:
        return None
    best = max(odds, key=lambda p: odds[p])
    if odds[best] < options.min_log_odds and not closed:
        return None
    others = [p for p in odds if p != best and odds[best] - odds[p] < options.ambiguity_log_odds]
    doubt = f"{tracks[others[0]].name} is equally likely" if others else ""
    absent_s = time_s - tracks[best].last_seen_s
    return Reidentification(best, f"log odds {odds[best]:.1f} of the same person after {absent_s:.1f} s", doubt)


def length_log_odds(
    track: Track, state: State, index: int, fitted: State, observed_s: float, settings: TrackerSettings
) -> float:
    """Return the log odds of equal bone lengths, some of which are outliers.

    Args:
        track: Track of the lost person.
        state: States of the tracks.
        index: Index of the track.
        fitted: State of the new person's body, fitted without a prior from the track.
        observed_s: Time for which that body was observed, in seconds.
        settings: Settings of the tracker.
    """
    share = settings.options.reidentification.corrupt_share
    alike = same_body_log_odds(settings, track, state, index, fitted, observed_s)
    return float(np.logaddexp(alike + math.log(1.0 - share), math.log(share)))


def population_is_known(tracks: list[Track], settings: TrackerSettings) -> bool:
    """Return whether all individuals have been tracked, so no new identity is possible."""
    population = settings.options.population
    return population is not None and sum(track.established for track in tracks) >= population


def _position_log_odds(
    track: Track, torso_m: np.ndarray, time_s: float, settings: TrackerSettings, closed: bool
) -> float:
    """Return the log odds of a position close to where a track was lost, relative to anywhere in a room.

    A person either moved as people mostly do, and is close, or moved fast, and is anywhere within reach; both are
    equally likely. The result is -inf for a person beyond reach, unless no new identity is possible.
    """
    options, motion = settings.options.reidentification, settings.options.motion
    absent_s = time_s - track.last_seen_s
    room = options.room_m
    distance = float(np.linalg.norm(torso_m - track.last_position_m))
    reach = options.reach_m + motion.top_speed_m_s * absent_s
    # Displacement by velocities that fade: Ornstein and Uhlenbeck.
    faded = motion.root_decay_s * (1.0 - math.exp(-absent_s / motion.root_decay_s))
    variance = motion.root_acceleration * motion.root_decay_s**2 * (absent_s - faded)
    sd = math.sqrt(variance + options.trunk_sd_m**2)
    near = 3.0 * math.log(room / (math.sqrt(2.0 * math.pi) * sd)) - 0.5 * (distance / sd) ** 2
    if distance > reach:
        return near if closed else -math.inf
    return float(np.logaddexp(near, 3.0 * math.log(max(room / min(reach, room), 1.0))) - math.log(2.0))


def same_body_log_odds(
    settings: TrackerSettings, track: Track, state: State, index: int, fitted: State, observed_s: float
) -> float:
    """Return the log likelihood ratio of measured bone lengths: this person's against any person's.

    Args:
        settings: Settings of the tracker.
        track: Track of the person.
        state: States of the tracks, for lengths that are still estimated.
        index: Index of the track.
        fitted: State of one body, fitted without a prior from the track.
        observed_s: Time for which that body was observed, in seconds.
    """
    tree, options = settings.tree, settings.options
    n, h = tree.n_pose, tree.n_shape
    known = track.known_shape or (state.shape[index], state.covariance[index, n : n + h, n : n + h])
    # Each observation places the joints differently, so lengths differ systematically between observations.
    share, offset_m = options.reidentification.length_sd_share, options.reidentification.length_sd_m
    floor = 0.5 * np.diag((share * np.abs(tree.shape_m) + offset_m) ** 2)
    theirs, error = measured_lengths(tree, *known)
    error = correlation_factor(track.shape_observed_s, options) * error + floor
    new, new_error = measured_lengths(tree, fitted.shape[0], fitted.covariance[0, n : n + h, n : n + h])
    new_error = correlation_factor(observed_s, options) * new_error + floor
    gain = np.linalg.solve(tree.shape_covariance + error, tree.shape_covariance).T
    left = tree.shape_covariance - gain @ tree.shape_covariance
    return _log_normal(new - gain @ theirs, left + new_error) - _log_normal(new, tree.shape_covariance + new_error)


def _log_normal(residual: np.ndarray, covariance: np.ndarray) -> float:
    sign, log_determinant = np.linalg.slogdet(covariance)
    if sign <= 0:
        return -math.inf
    return float(-0.5 * (log_determinant + residual @ np.linalg.solve(covariance, residual)))
