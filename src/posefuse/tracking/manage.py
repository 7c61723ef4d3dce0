"""Fourth step of the tracker: manage the lifecycle, the cameras, the identities and the initiation of tracks."""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.tracking.associate import Association, find_unassigned
from posefuse.tracking.camera_monitor import CameraMonitor, is_occluded
from posefuse.tracking.doubtful_identities import resolve_doubts, update_doubts
from posefuse.tracking.frame_clock import TIME_TOLERANCE_S
from posefuse.tracking.identity_audit import (
    AuditResult,
    Contacts,
    audit_identities,
    drop_contacts,
    observe_separated,
    update_contacts,
)
from posefuse.tracking.lifecycle import (
    check_lengths,
    expected_views,
    fix_shape,
    swap_identities,
    tracks_to_terminate,
    update_last_inside,
    update_track,
)
from posefuse.tracking.predict import FrameInput, Prediction
from posefuse.tracking.promotion import lifecycle_thresholds, promote_tracks
from posefuse.tracking.records import IdentitySwap, PastState
from posefuse.tracking.strategy import FrameOutcome, TrackerSetup
from posefuse.tracking.track_set import TentativePool, TrackSet
from posefuse.tracking.update import Update

_LENGTH_CHECK_S = 0.4
"""Time between two comparisons of a body's lengths with the views."""


@dataclass(frozen=True, eq=False)
class Management:
    """Result of the management of tracks.

    Attributes:
        rows: shape (track, view), int64: assigned detections of all remaining and new tracks.
        used: shape (track, view, keypoint), bool: used keypoints of these tracks.
        innovations: By track number: normalized innovation squared, and its degrees of freedom.
        events: All events of the frame.
        past_states: By name, states in earlier frames of tracks that were confirmed or re-identified.
        swaps: Identity swaps.
    """

    rows: np.ndarray
    used: np.ndarray
    innovations: dict[int, tuple[float, int]]
    events: tuple[Event, ...]
    past_states: dict[str, list[PastState]]
    swaps: tuple[IdentitySwap, ...]


@dataclass(eq=False)
class Bookkeeping:
    """Records beside the confirmed tracks that last from frame to frame.

    Attributes:
        pool: Tentative tracks.
        monitor: Statistics of the cameras.
        contacts: People who are, or recently were, close to each other.
        lengths_checked_s: Time at which bone lengths were last compared with the views, in seconds; NaN before the
            first frame.
    """

    pool: TentativePool
    monitor: CameraMonitor
    contacts: Contacts
    lengths_checked_s: float = math.nan

    @classmethod
    def new(cls, n_views: int) -> "Bookkeeping":
        """Return the records before the first frame."""
        return cls(TentativePool(), CameraMonitor.new(n_views), {})

    def begins_length_check(self, time_s: float) -> bool:
        """Return whether bone lengths are compared with the views at this time; if so, note the time."""
        # Differences of times, so that results do not depend on the origin of the clock.
        if time_s - self.lengths_checked_s < _LENGTH_CHECK_S - TIME_TOLERANCE_S:
            return False
        is_first = math.isnan(self.lengths_checked_s)
        self.lengths_checked_s = time_s
        return not is_first


def manage(
    tracks: TrackSet,
    book: Bookkeeping,
    frame: FrameInput,
    prediction: Prediction,
    association: Association,
    update: Update,
    setup: TrackerSetup,
) -> Management:
    """Update the lifecycle of all tracks after an update.

    Args:
        tracks: Updated in place: confirmed tracks.
        book: Updated in place: tentative tracks, cameras and contacts.
        frame: The frame.
        prediction: Predicted tracks.
        association: Assigned detections.
        update: Result of the update.
        setup: Setup of the tracker.
    """
    s, rejected, events = setup.settings, book.monitor.rejected, list(update.events)
    should_show = expected_views(prediction.projected, s)
    outcome = FrameOutcome(
        frame.frame, frame.time_s, frame.dt_s, association.rows, association.labels, update.used, update.supported,
        should_show & frame.frame.recorded,
    )  # fmt: skip
    events += _update_lifecycle(tracks, outcome, prediction, rejected, setup)
    if book.begins_length_check(frame.time_s):
        events += check_lengths(tracks.tracks, tracks.state, outcome, s)
    remaining, ended = _terminate(tracks, frame, prediction, setup)
    events += ended
    outcome = outcome.select(remaining)
    if s.options.camera_monitor.enabled:
        events += _monitor_cameras(tracks, book.monitor, frame, association, outcome, setup)
    swaps: list[IdentitySwap] = []
    if s.options.identity_audit.enabled:
        audited, swaps = _audit(tracks, book.contacts, outcome, setup)
        events += audited
    update_doubts(book.pool.doubts, tracks, outcome, s)
    points_m = prediction.projected.points_m
    if len(remaining) < len(points_m):
        points_m = points_m[remaining]
    promoted = promote_tracks(tracks, book.pool, frame, association, outcome, points_m, rejected, setup)
    events += promoted.events
    rows, used = promoted.rows, promoted.used
    for each in resolve_doubts(book.pool.doubts, tracks, frame.time_s, s):
        swaps.append(each.swap)
        drop_contacts(book.contacts, each.names)
        events.append(Event(frame.frame.number, frame.time_s, each.names[0], "identities_swapped", each.reason))
    lost_again = len(tracks) - len(rows)
    if lost_again:
        rows = np.concatenate([rows, np.full((lost_again, *rows.shape[1:]), -1)])
        used = np.concatenate([used, np.zeros((lost_again, *used.shape[1:]), dtype=bool)])
    innovations = {number: each for number, each in update.innovations.items() if number not in promoted.restored}
    return Management(rows, used, innovations, tuple(events), promoted.past_states, tuple(swaps))


def _update_lifecycle(
    tracks: TrackSet,
    outcome: FrameOutcome,
    prediction: Prediction,
    rejected: np.ndarray,
    setup: TrackerSetup,
) -> list[Event]:
    """Update score and state of every track, adapt the noise model and fix bone lengths."""
    s, events = setup.settings, []
    if not len(tracks):
        return []
    outcome = outcome.with_expected(_reliable_views(tracks, outcome, prediction, rejected, setup))
    setup.strategy.noise.adapt(outcome, tracks.recent, tracks.state, s)
    scores = setup.strategy.score.track_scores(outcome, tracks.tracks, tracks.state, s)
    thresholds = lifecycle_thresholds(setup)
    for p, track in enumerate(tracks.tracks):
        changes = update_track(
            track, float(scores[p]), thresholds, outcome.supported[p], outcome.expected[p], outcome.time_s, s,
        )  # fmt: skip
        events += [Event(outcome.frame.number, outcome.time_s, track.name, *change) for change in changes]
        fix_shape(track, tracks.state, p, outcome.time_s, outcome.dt_s, s)
    return events


def _reliable_views(
    tracks: TrackSet, outcome: FrameOutcome, prediction: Prediction, rejected: np.ndarray, setup: TrackerSetup
) -> np.ndarray:
    """Return the views in which a missing detection counts against a track, shape (track, view), bool."""
    expected, s = outcome.expected & ~rejected, setup.settings
    share = s.options.lifecycle.occluded_share
    for p, track in enumerate(tracks.tracks):
        if not track.established:
            pixels = prediction.projected.pixels[p][:, s.core]
            expected[p] &= ~is_occluded(pixels, outcome.rows[p], outcome.frame, share)
    return expected


def _terminate(
    tracks: TrackSet, frame: FrameInput, prediction: Prediction, setup: TrackerSetup
) -> tuple[list[int], list[Event]]:
    """Drop the tracks that end; return the indices of the others and the events."""
    s = setup.settings
    if s.options.terminate_outside_after_s is not None:
        update_last_inside(tracks.tracks, prediction.projected, frame.time_s, s)
    reasons = tracks_to_terminate(tracks.tracks, tracks.state, frame.time_s, s)
    events = [
        Event(frame.frame.number, frame.time_s, tracks.tracks[p].name, "terminated", reason)
        for p, reason in reasons.items()
    ]
    remaining = [p for p in range(len(tracks)) if p not in reasons]
    if reasons:
        tracks.keep(remaining)
    return remaining, events


def _monitor_cameras(
    tracks: TrackSet,
    monitor: CameraMonitor,
    frame: FrameInput,
    association: Association,
    outcome: FrameOutcome,
    setup: TrackerSetup,
) -> list[Event]:
    """Find cameras that moved, that fell silent, or that are back."""
    options, rig = setup.settings.options.camera_monitor, setup.settings.rig
    active = tracks.is_in_state(TrackState.ACTIVE)
    unassigned = find_unassigned(frame.frame, outcome.rows, association.explained)
    n_unassigned = np.bincount(frame.frame.view[unassigned], minlength=len(rig))
    supported, expected = outcome.supported, outcome.expected
    if not active.all():
        supported, expected = supported[active], expected[active]
    changes = monitor.update_fit(supported, expected, n_unassigned, frame.dt_s, options)
    changes += monitor.update_silence(frame.frame.recorded, frame.frame.shown, frame.dt_s, options)
    if not changes:
        return []
    names = rig.names
    return [Event(frame.frame.number, frame.time_s, names[v], kind, reason) for v, kind, reason in changes]


def _audit(
    tracks: TrackSet, contacts: Contacts, outcome: FrameOutcome, setup: TrackerSetup
) -> tuple[list[Event], list[IdentitySwap]]:
    """Audit identities after close contact, and swap those that the bone lengths contradict."""
    s, events, swaps = setup.settings, [], []
    update_contacts(contacts, tracks.tracks, tracks.state, outcome, s.options.identity_audit)
    if not contacts:
        return [], []
    observe_separated(contacts, tracks, outcome, s)
    renamed: set[str] = set()
    for result in audit_identities(contacts, tracks.tracks, tracks.state, outcome.time_s, s):
        if renamed & set(result.names):
            continue
        if result.swap:
            swaps.append(_swap(tracks, contacts, result))
            renamed |= set(result.names)
            reason = f"its bone lengths match those of {result.names[1]}, log odds {-result.log_odds:.1f}"
            events.append(Event(outcome.frame.number, outcome.time_s, result.names[0], "identities_swapped", reason))
        elif not result.is_clear:
            reason = f"it may be {result.names[1]} after close contact, log odds {result.log_odds:.1f}"
            name = result.names[0]
            events.append(Event(outcome.frame.number, outcome.time_s, name, "possible_identity_switch", reason))
    return events, swaps


def _swap(tracks: TrackSet, contacts: Contacts, result: AuditResult) -> IdentitySwap:
    index = {track.name: p for p, track in enumerate(tracks.tracks)}
    p, q = (index[name] for name in result.names)
    swap_identities(tracks.tracks, tracks.state, p, q)
    drop_contacts(contacts, result.names)
    return IdentitySwap((tracks.tracks[p].number, tracks.tracks[q].number), result.since_s)
