"""Promotion: turn tentative tracks into confirmed ones, or identify them as lost tracks."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.track_events import Event, EventKind
from posefuse.model.tracks import TrackState
from posefuse.tracking.associate import Association, find_unassigned
from posefuse.tracking.body_states import ProjectedBodies, join_states, select_states
from posefuse.tracking.camera_monitor import missing_views
from posefuse.tracking.doubtful_identities import Doubts, add_candidate, begin_doubt
from posefuse.tracking.frame_clock import TIME_TOLERANCE_S
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track, restore_track
from posefuse.tracking.predict import FrameInput
from posefuse.tracking.records import Observation, PastState, TentativeTrack, Track
from posefuse.tracking.reidentification import Reidentification, population_is_known
from posefuse.tracking.strategy import FrameOutcome, Propose, TrackerSetup
from posefuse.tracking.track_initiation import (
    continue_tentative,
    is_confirmed,
    is_expired,
    observation_of,
)
from posefuse.tracking.track_set import TentativePool, TrackSet


@dataclass(frozen=True, eq=False)
class Promotions:
    """Result of the promotion of tentative tracks.

    Attributes:
        rows: shape (track, view), int64: assigned detections of all tracks, with the new ones.
        used: shape (track, view, keypoint), bool: used keypoints of all tracks, with the new ones.
        events: Tracks that were confirmed or re-identified.
        past_states: By name, states in earlier frames of these tracks.
        restored: Numbers of the tracks that were re-identified.
    """

    rows: np.ndarray
    used: np.ndarray
    events: tuple[Event, ...]
    past_states: dict[str, list[PastState]]
    restored: frozenset[int]


@dataclass(frozen=True, eq=False)
class _Promotion:
    """A tentative track or a proposal that became active: its track, past states, last observation and events."""

    track: int
    number: int
    name: str
    past: list[PastState]
    last: Observation
    events: list[tuple[EventKind, str]]
    is_restored: bool


def promote_tracks(
    tracks: TrackSet,
    pool: TentativePool,
    frame: FrameInput,
    association: Association,
    outcome: FrameOutcome,
    predicted_points_m: np.ndarray,
    rejected: np.ndarray,
    setup: TrackerSetup,
) -> Promotions:
    """Continue tentative tracks by the unassigned detections of a frame, and promote those that satisfy the rule.

    Args:
        tracks: Updated in place: confirmed tracks.
        pool: Updated in place: tentative tracks.
        frame: The frame.
        association: Assigned detections.
        outcome: Outcome of the frame for the confirmed tracks.
        predicted_points_m: shape (track, keypoint, 3): predicted points of the confirmed tracks.
        rejected: shape (view,), bool: cameras that are not used.
        setup: Setup of the tracker.
    """
    s, score = setup.settings, setup.strategy.score
    single_view = _single_view_detections(tracks, outcome, setup)
    free = find_unassigned(frame.frame, outcome.rows, association.explained, rejected)
    free[list(single_view)] = True
    observations = _propose_new_people(tracks, frame, free, predicted_points_m, rejected, setup, setup.propose_new)
    expected = _propose_expected(tracks, frame, free, predicted_points_m, rejected, setup, observations)
    if not (pool.tracks or observations or expected):
        return Promotions(outcome.rows.copy(), outcome.used.copy(), (), {}, frozenset())
    distance = setup.strategy.distance
    for each in continue_tentative(pool.tracks, observations, lambda a, b: distance.distance(a, b, s)):
        pool.n_created += 1
        pool.tracks.append(TentativeTrack(pool.n_created, [each]))
    promoted, waiting = [], []
    for each in pool.tracks:
        each.score = score.tentative_score(each, frame.time_s, frame.dt_s, s)
        min_age_s = score.min_age_s(each, s)
        promotion = None
        figures = setup.strategy.initiation.figures
        if is_confirmed(each, frame.time_s, score.promotion_score(s), min_age_s, figures, s):
            promotion = _promote(each, tracks, frame, single_view, pool.doubts, setup)
        if promotion is not None:
            promoted.append(promotion)
        else:
            waiting.append((each, is_expired(each, frame.time_s, min_age_s, s)))
    shown = [each for each, _ in waiting if each.observations[-1].time_s == frame.time_s]
    reacquired = _reacquire_lost(tracks, [*shown, *expected], frame, pool.doubts, setup)
    promoted += reacquired
    pool.tracks = [
        each
        for each, expired in waiting
        if not expired and not any(each.observations[-1] is other.last for other in reacquired)
    ]
    rows, used = _extended(outcome, promoted)
    events = [
        Event(frame.frame.number, frame.time_s, each.name, kind, reason)
        for each in promoted
        for kind, reason in each.events
    ]
    restored = frozenset(each.number for each in promoted if each.is_restored)
    return Promotions(rows, used, tuple(events), {each.name: each.past for each in promoted}, restored)


def _extended(outcome: FrameOutcome, promoted: list[_Promotion]) -> tuple[np.ndarray, np.ndarray]:
    """Return detections and used keypoints of all tracks, with those of promoted tracks."""
    rows, used = outcome.rows.copy(), outcome.used.copy()
    for each in promoted:
        counted = np.isfinite(each.last.keypoints_px[..., 0])
        if each.track < len(rows):
            rows[each.track], used[each.track] = each.last.rows, counted
        else:
            rows, used = np.vstack([rows, each.last.rows]), np.vstack([used, counted[None]])
    return rows, used


def lifecycle_thresholds(setup: TrackerSetup) -> LifecycleThresholds:
    """Return the scores at which the state of a track changes."""
    score, s = setup.strategy.score, setup.settings
    return LifecycleThresholds(score.initial_score(s), score.lost_score(s), score.established_score(s))


def _single_view_detections(tracks: TrackSet, outcome: FrameOutcome, setup: TrackerSetup) -> dict[int, int]:
    """Return the detections of people whom a single view has shown for some time, with the indices of their tracks.

    A single view hardly constrains the distance. Where other views show the person of that detection elsewhere, the
    person is there.
    """
    detections = {}
    for p, track in enumerate(tracks.tracks):
        single_s = outcome.time_s - track.last_multiview_s
        if single_s > setup.settings.options.single_view_after_s + TIME_TOLERANCE_S:
            own = outcome.rows[p][outcome.rows[p] >= 0]
            if len(own) == 1:
                detections[int(own[0])] = p
    return detections


def _propose_new_people(
    tracks: TrackSet,
    frame: FrameInput,
    free: np.ndarray,
    predicted_points_m: np.ndarray,
    rejected: np.ndarray,
    setup: TrackerSetup,
    propose: Propose,
) -> list[Observation]:
    """Return the people whom unassigned detections show, without those who are tracked already."""
    s, detections, active = setup.settings, frame.frame, tracks.active
    views = detections.view[free]
    if not len(views) or views[0] == views[-1]:
        return []
    known, options = predicted_points_m[active], s.options.initiation
    proposals = propose(detections, free)
    observations = []
    for i in range(len(proposals)):
        distance = np.linalg.norm(known - proposals.points_m[i], axis=-1)
        if len(active) and (np.nanmean(distance, axis=1) < options.apart_m).any():
            continue
        observation = observation_of(detections, frame.time_s, proposals, i, s.skeleton.mirror)
        if observation.n_views <= options.min_views:
            missing = missing_views(observation.points_m, observation.rows, detections, rejected, s)
            observation = replace(observation, n_silent=int(missing.sum()))
        observations.append(observation)
    return setup.strategy.distance.merge(observations, s)


def _propose_expected(
    tracks: TrackSet,
    frame: FrameInput,
    free: np.ndarray,
    predicted_points_m: np.ndarray,
    rejected: np.ndarray,
    setup: TrackerSetup,
    observations: list[Observation],
) -> list[TentativeTrack]:
    """Return the people whom the remaining detections show if lost people are expected to return."""
    if setup.propose_lost is setup.propose_new or not tracks.is_in_state(TrackState.LOST).any():
        return []
    free = free.copy()
    for each in observations:
        free[each.rows[each.rows >= 0]] = False
    found = _propose_new_people(tracks, frame, free, predicted_points_m, rejected, setup, setup.propose_lost)
    return [TentativeTrack(0, [each]) for each in found]


def _promote(
    tentative: TentativeTrack,
    tracks: TrackSet,
    frame: FrameInput,
    single_view: dict[int, int],
    doubts: Doubts,
    setup: TrackerSetup,
) -> _Promotion | None:
    """Confirm a tentative track under a new name, or under that of a lost track.

    Args:
        tentative: The tentative track.
        tracks: Updated in place: confirmed tracks.
        frame: The frame.
        single_view: From :func:`_single_view_detections`.
        doubts: Updated in place: doubtful identities.
        setup: Setup of the tracker.

    Returns:
        None if no body fits the observations, or if a tracked person is already there.
    """
    s, thresholds = setup.settings, lifecycle_thresholds(setup)
    state, past, error = setup.strategy.initiation.fit(tentative, s)
    if not error <= s.options.initiation.max_error_sigma:
        return None
    last = tentative.observations[-1]
    single = [single_view[int(row)] for row in last.rows if int(row) in single_view]
    if single:
        reason = "other cameras show the person, whom a single camera had shown"
        lost: Reidentification | None = Reidentification(single[0], reason)
    elif _is_occupied(state, tracks, setup):
        return None
    else:
        lost = setup.strategy.distance.find_lost(
            tracks.tracks, tracks.state, state, last, tentative.observations[0].time_s, frame.time_s, s
        )
    events: list[tuple[EventKind, str]] = []
    if lost is not None:
        p = lost.track
        begin_doubt(doubts, tracks, lost, tentative.observations[0], s)
        restore_track(tracks.state, p, state, s)
        tracks.reset_history(p, s)
        events.append(("reidentified", lost.reason))
        if lost.doubt:
            events.append(("possible_identity_switch", lost.doubt))
    elif len(tracks) >= s.options.max_people or population_is_known(tracks.tracks, s):
        return None
    else:
        tracks.n_created += 1
        p = len(tracks)
        tracks.append(new_track(tracks.n_created, frame.time_s, thresholds), state, s)
        add_candidate(doubts, tracks.n_created, state, tentative.observations, s)
        events.append(("confirmed", f"seen by {last.n_views} cameras with an error of {error:.1f} sigma"))
    track = _activate(tracks.tracks[p], frame, setup)
    return _Promotion(p, track.number, track.name, past, last, events, lost is not None)


def _activate(track: Track, frame: FrameInput, setup: TrackerSetup) -> Track:
    """Make a track active in a frame that shows it."""
    track.state = TrackState.ACTIVE
    track.last_seen_s = track.last_multiview_s = frame.time_s
    track.log_odds = lifecycle_thresholds(setup).initial_score
    return track


def _reacquire_lost(
    tracks: TrackSet, tentative: list[TentativeTrack], frame: FrameInput, doubts: Doubts, setup: TrackerSetup
) -> list[_Promotion]:
    """Re-acquire lost tracks by proposals of this frame, without the confirmation of a new track.

    Args:
        tracks: Updated in place: confirmed tracks.
        tentative: Tentative tracks that a proposal of this frame started or continued.
        frame: The frame.
        doubts: Updated in place: doubtful identities.
        setup: Setup of the tracker.
    """
    s, reacquired = setup.settings, []
    lost = tracks.is_in_state(TrackState.LOST)
    if not tentative or not lost.any():
        return []
    for match, found in setup.strategy.distance.find_reacquired(tracks.tracks, tracks.state, tentative, s):
        state, past, error = setup.strategy.initiation.fit(found, s)
        last = found.observations[-1]
        if not error <= s.options.initiation.max_error_sigma or _is_occupied(state, tracks, setup):
            continue
        begin_doubt(doubts, tracks, match, found.observations[0], s)
        restore_track(tracks.state, match.track, state, s)
        tracks.reset_history(match.track, s)
        track = _activate(tracks.tracks[match.track], frame, setup)
        events: list[tuple[EventKind, str]] = [("reacquired", match.reason)]
        reacquired.append(_Promotion(match.track, track.number, track.name, past, last, events, True))
    return reacquired


def _is_occupied(state: State, tracks: TrackSet, setup: TrackerSetup) -> bool:
    """Return whether an active person's body is where a new one is: two proposals may show parts of one person."""
    s = setup.settings
    together = join_states(select_states(tracks.state, tracks.active), state)
    points = ProjectedBodies.of(together, s.cameras[:0], s.body).points_m
    distance = np.linalg.norm(points[:-1] - points[-1], axis=-1)
    return bool((np.nanmean(distance, axis=1) < s.options.initiation.apart_m).any())
