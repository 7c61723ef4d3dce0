"""Re-acquisition: whether proposals that are not confirmed yet show a person whose track was lost.

A new track is confirmed over several frames, because false detections in two views may agree. A lost person is expected
to return, so that fewer proposals suffice at a place, and with bone lengths, that fit the lost person.
"""

import math

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.records import TentativeTrack, Track
from posefuse.tracking.reidentification import Reidentification, lost_log_odds, may_be_within_reach
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_initiation import fit_last_state


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
    odds, near = np.full((2, len(lost), len(tentative)), -math.inf)
    last = [each.observations[-1] for each in tentative]
    for j in np.flatnonzero(may_be_within_reach(tracks, state, lost, last, settings)).tolist():
        odds[:, j], near[:, j] = _log_odds(tracks, state, lost, tentative[j], settings)
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
        found.append((Reidentification(lost[i], reason, position=float(near[i, j])), tentative[j]))
    return found


def _log_odds(
    tracks: list[Track], state: State, lost: list[int], tentative: TentativeTrack, settings: TrackerSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Return the log odds that a tentative track shows each lost person, and those of the position, shape (lost,) each.

    They are -inf where they do not suffice. The log odds of the proposals count, too, because they may be false.
    """
    options, last = settings.options.reidentification, tentative.observations[-1]
    fitted = fit_last_state([last], settings)
    odds, near = lost_log_odds(tracks, state, lost, fitted, last, settings, is_fitted_alone=True)
    proposed = sum(each.log_odds for each in tentative.observations)
    enough = (odds >= options.min_log_odds) & (odds + proposed >= options.immediate_log_odds)
    return np.where(enough, odds, -math.inf), near
