"""Re-acquisition: whether proposals that are not confirmed yet show a person whose track was lost.

A new track is confirmed over several frames, because false detections in two views may agree. A lost person is expected
to return, so that fewer proposals suffice at a place, and with bone lengths, that fit the lost person.
"""

import math

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.lifecycle import expected_views
from posefuse.tracking.records import TentativeTrack, Track
from posefuse.tracking.reidentification import Reidentification, length_log_odds
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_initiation import fit_body


def find_reacquired_tracks(
    tracks: list[Track], state: State, tentative: list[TentativeTrack], settings: TrackerSettings
) -> list[tuple[Reidentification, TentativeTrack]]:
    """Find the lost tracks that proposals continue, each with its proposals; the most likely ones first.

    A proposal that two lost tracks explain almost equally well, or that is far from the prediction, is left to
    :func:`posefuse.tracking.reidentification.find_lost_track`, which knows more frames.

    Args:
        tracks: Confirmed tracks.
        state: States of the tracks.
        tentative: Tentative tracks that a proposal of the last frame started or continued.
        settings: Settings of the tracker.
    """
    options = settings.options.reidentification
    lost = [p for p, track in enumerate(tracks) if track.state == TrackState.LOST]
    odds = np.full((len(lost), len(tentative)), -math.inf)
    for j, each in enumerate(tentative):
        odds[:, j] = _log_odds(tracks, state, lost, each, settings)
    found: list[tuple[Reidentification, TentativeTrack]] = []
    while odds.size and odds.max() > -math.inf:
        i, j = np.unravel_index(int(odds.argmax()), odds.shape)
        best, others = float(odds[i, j]), np.delete(odds[:, j], i)
        odds[:, j] = -math.inf
        if len(others) and best - others.max() < options.ambiguity_log_odds:
            continue
        odds[i] = -math.inf
        missing_s = tentative[j].observations[-1].time_s - tracks[lost[i]].last_seen_s
        reason = f"log odds {best:.1f} of the same person after {missing_s:.2f} s"
        found.append((Reidentification(lost[i], reason), tentative[j]))
    return found


def _log_odds(
    tracks: list[Track], state: State, lost: list[int], tentative: TentativeTrack, settings: TrackerSettings
) -> np.ndarray:
    """Return the log odds that a tentative track shows each lost person, shape (lost,); -inf where they do not suffice.

    The log odds of the proposals count, too, because they may be false.
    """
    options, last = settings.options.reidentification, tentative.observations[-1]
    shown_s = last.time_s - tentative.observations[0].time_s
    fitted, _, _ = fit_body(tentative.observations, settings)
    proposed = sum(each.log_odds for each in tentative.observations)
    absent_s = np.array([last.time_s - tracks[p].last_seen_s for p in lost])
    near = _position_log_odds(select_states(state, lost), absent_s, fitted, settings)
    odds = np.full(len(lost), -math.inf)
    for i, p in enumerate(lost):
        found = near[i] + length_log_odds(tracks[p], state, p, fitted, shown_s, settings)
        if found >= options.min_log_odds and found + proposed >= options.immediate_log_odds:
            odds[i] = found
    return odds


def _position_log_odds(lost: State, absent_s: np.ndarray, fitted: State, settings: TrackerSettings) -> np.ndarray:
    """Return the log odds of a position: a lost person's, against anywhere in a room; shape (lost,).

    The person either moved as predicted, or moved fast and is anywhere within reach; both are equally likely. The
    result is -inf for a person beyond reach.
    """
    centers_m = [
        expected_views(ProjectedBodies.of(each, settings.cameras[:0], settings.body), settings)[1]
        for each in (lost, fitted)
    ]
    options, offset_m = settings.options.reidentification, centers_m[1] - centers_m[0]
    reach_m = options.reach_m + settings.options.motion.top_speed_m_s * absent_s
    spread = lost.covariance[:, :3, :3] + options.trunk_sd_m**2 * np.eye(3)
    squared = (offset_m * np.linalg.solve(spread, offset_m[..., None])[..., 0]).sum(axis=1)
    uniform = 3.0 * math.log(options.room_m / math.sqrt(2.0 * math.pi))
    predicted = uniform - 0.5 * np.linalg.slogdet(spread)[1] - 0.5 * squared
    anywhere = 3.0 * np.log(options.room_m / np.minimum(reach_m, options.room_m))
    odds = np.logaddexp(predicted, anywhere) - math.log(2.0)
    return np.where(np.linalg.norm(offset_m, axis=1) > reach_m, -math.inf, odds)
