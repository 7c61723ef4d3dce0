"""Doubtful identities: lost people who were re-acquired far from where they were lost, perhaps a new person.

Place and bone lengths of one frame often do not distinguish a lost person from a new one of a similar size. The name of
the lost person is given, and the lost track is kept. After a second, a body is fitted to the observations since then,
without a prior from the track. If its lengths contradict those of the lost person, or if those of a person who appeared
later fit better, the names are corrected, back to the frame of the re-acquisition.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.tracking.body_states import fix_shape_covariance, select_states, shape_block
from posefuse.tracking.bone_lengths import LengthMonitor
from posefuse.tracking.frame_clock import TIME_TOLERANCE_S
from posefuse.tracking.identity_audit import MAX_OBSERVATIONS, subsample, track_observation
from posefuse.tracking.lifecycle import swap_identities
from posefuse.tracking.records import Candidate, DoubtfulIdentity, IdentitySwap, Observation
from posefuse.tracking.reidentification import Reidentification, position_log_odds, same_body_log_odds
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import FrameOutcome
from posefuse.tracking.track_initiation import fit_last_state
from posefuse.tracking.track_set import TrackSet, advance_state

_CERTAIN = 2.0
"""Log odds of the place from which on it decides alone: those 0.6 s after the loss, at the predicted place."""
_ERROR_FACTOR, _FLOOR_FACTOR = 4.0, 0.5
"""Factors on the covariance of lengths measured over a second, and on their standard deviations between observations.

The error of a person's size is 1.8 % after 1.2 s and 1.4 % after 2.4 s in simulated rooms, because errors of detectors
persist; errors of single bones average out."""
_MIN_ADVANTAGE = 2.0
"""Difference of log odds from which a person who appeared later receives the name."""
_MIN_VIEWS = 3
"""Number of views of an observation that counts: two views make the freely fitted body too large."""


Doubts = dict[str, DoubtfulIdentity]
"""Doubtful identities by the name of the lost person."""


@dataclass(frozen=True)
class Correction:
    """Names that were corrected.

    Attributes:
        swap: The two tracks whose names changed.
        names: The new name of the track that had the name of the lost person, and the latter.
        reason: Reason, as a clause.
    """

    swap: IdentitySwap
    names: tuple[str, str]
    reason: str


def begin_doubt(
    doubts: Doubts, tracks: TrackSet, match: Reidentification, first: Observation, settings: TrackerSettings
) -> None:
    """Keep a lost track that is about to be re-acquired, if the place does not identify the person.

    Args:
        doubts: Updated in place.
        tracks: Confirmed tracks, before the re-acquisition.
        match: The track that is re-acquired.
        first: First observation of the person.
        settings: Settings of the tracker.
    """
    track, options = tracks.tracks[match.track], settings.options
    doubts.pop(track.name, None)
    is_known = track.known_shape is not None or track.shape_observed_s > options.identity_audit.observe_s
    if options.identity_audit.enabled and options.population is None and is_known and match.position < _CERTAIN:
        lost = select_states(tracks.state, [match.track])
        candidates = {track.number: _candidate(first, match.position, settings)}
        doubts[track.name] = DoubtfulIdentity(track.number, replace(track), lost, candidates)


def add_candidate(
    doubts: Doubts, number: int, fitted: State, observations: list[Observation], settings: TrackerSettings
) -> None:
    """Add a track that was confirmed under a new name to the lost people it may show.

    Args:
        doubts: Updated in place.
        number: Number of the track.
        fitted: State of its body.
        observations: Its observations.
        settings: Settings of the tracker.
    """
    for each in doubts.values():
        absent_s = np.array([observations[-1].time_s - each.lost.last_seen_s])
        position = float(position_log_odds(each.state, absent_s, fitted, settings)[0])
        if position > -math.inf:
            each.candidates[number] = _candidate(observations[0], position, settings)


def _candidate(first: Observation, position: float, settings: TrackerSettings) -> Candidate:
    observe_s = settings.options.identity_audit.observe_s
    return Candidate(first.time_s - TIME_TOLERANCE_S, position, deque(maxlen=MAX_OBSERVATIONS), observe_s)


def update_doubts(doubts: Doubts, tracks: TrackSet, outcome: FrameOutcome, settings: TrackerSettings) -> None:
    """Predict the lost people, add the observations of a frame, and drop what is no longer in doubt.

    Args:
        doubts: Updated in place.
        tracks: All tracks.
        outcome: Outcome of the frame for these tracks.
        settings: Settings of the tracker.
    """
    if not doubts:
        return
    index = {track.number: p for p, track in enumerate(tracks.tracks)}
    names = {track.number: track.name for track in tracks.tracks}
    for name, each in list(doubts.items()):
        absent_s = outcome.time_s - each.lost.last_seen_s
        if names.get(each.number) != name or absent_s > settings.options.terminate_after_s:
            del doubts[name]
            continue
        advance_state(each.state, outcome.dt_s, settings)
        each.candidates = {number: found for number, found in each.candidates.items() if number in index}
    candidates = {number for each in doubts.values() for number in each.candidates}
    observed = sorted(n for n in candidates if outcome.supported[index[n]].sum() >= _MIN_VIEWS)
    projected = tracks.projected(settings.cameras[:0], settings) if observed else None
    for number in observed:
        assert projected is not None
        new = track_observation(outcome, index[number], projected, tracks, settings)
        for each in doubts.values():
            if number in each.candidates:
                each.candidates[number].observations.append(new)


def resolve_doubts(doubts: Doubts, tracks: TrackSet, time_s: float, settings: TrackerSettings) -> list[Correction]:
    """Correct the names that place and bone lengths contradict.

    Args:
        doubts: Updated in place.
        tracks: Updated in place: names and bone lengths. A lost person whose name another one had is lost again.
        time_s: Time of the frame, in seconds.
        settings: Settings of the tracker.
    """
    corrections: list[Correction] = []
    for name, each in list(doubts.items()):
        if not _is_due(each, time_s, settings):
            continue
        fitted = {
            number: fit_last_state(subsample(found.observations, settings.options.identity_audit.frames), settings)
            for number, found in each.candidates.items()
            if len(found.observations) >= settings.options.identity_audit.min_frames
        }
        odds = {number: _log_odds(each, number, body, time_s, settings) for number, body in fitted.items()}
        if each.number not in odds:
            continue
        own, best = odds[each.number], max(odds, key=lambda number: odds[number])
        if odds[best] - own > _MIN_ADVANTAGE:
            reason = f"its place and its bone lengths fit {name} less, log odds {own - odds[best]:.1f}"
        elif own < 0.0:
            best, reason = 0, f"its place and its bone lengths are not those of {name}, log odds {own:.1f}"
        else:
            continue
        corrections.append(_correct(each, best, fitted[each.number], tracks, reason, settings))
        del doubts[name]
    return corrections


def _is_due(each: DoubtfulIdentity, time_s: float, settings: TrackerSettings) -> bool:
    """Return whether a track was observed for so long that its lengths are compared again; twice as long each time."""
    due = False
    for found in each.candidates.values():
        enough = len(found.observations) >= settings.options.identity_audit.min_frames
        if enough and time_s - found.since_s > found.next_check_s:
            found.next_check_s, due = 2.0 * found.next_check_s, True
    return due


def _log_odds(each: DoubtfulIdentity, number: int, body: State, time_s: float, settings: TrackerSettings) -> float:
    """Return the log odds that a track shows the lost person."""
    found = each.candidates[number]
    observed_s = time_s - found.observations[0].time_s
    lengths = same_body_log_odds(settings, each.lost, each.state, 0, body, observed_s, _ERROR_FACTOR, _FLOOR_FACTOR)
    return found.position + lengths


def _correct(
    each: DoubtfulIdentity, other: int, fitted: State, tracks: TrackSet, reason: str, settings: TrackerSettings
) -> Correction:
    """Give the name of a lost person to another track, or to a new one that is lost.

    Args:
        each: The doubtful identity.
        other: Number of the other track; 0 for none.
        fitted: State of a body fitted to the track that had the name.
        tracks: Updated in place.
        reason: Reason, as a clause.
        settings: Settings of the tracker.
    """
    numbers = [track.number for track in tracks.tracks]
    p = numbers.index(each.number)
    if other:
        swap_identities(tracks.tracks, tracks.state, p, numbers.index(other))
    else:
        tracks.n_created += 1
        other = tracks.n_created
        tracks.tracks[p].name = f"person_{other}"
        tracks.append(replace(each.lost, number=other, lengths=LengthMonitor()), each.state, settings)
    track, state, n = tracks.tracks[p], tracks.state, settings.tree.n_pose
    track.known_shape, track.lengths = None, LengthMonitor()
    track.shape_observed_s = settings.options.identity_audit.observe_s
    fix_shape_covariance(state, p, n, settings.tree.n_shape)
    state.free[p], state.shape[p] = 1, fitted.shape[0]
    shape_block(state, p, settings.tree)[:] = shape_block(fitted, 0, settings.tree)
    swap = IdentitySwap((each.number, other), each.candidates[each.number].since_s)
    return Correction(swap, (track.name, each.lost.name), reason)
