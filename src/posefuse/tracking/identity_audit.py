"""Audit of identities after close contact: which person is which, by bone lengths.

While two people are in close contact, detections may show both, and a track may continue on the wrong person. After
they separate, a body is fitted to the observations of each since then, without a prior from the tracks, and its bone
lengths are compared with those known from before.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.options.tracking_stages import IdentityAuditOptions
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.records import Observation, Track
from posefuse.tracking.reidentification import same_body_log_odds
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import FrameOutcome
from posefuse.tracking.track_initiation import fit_last_state
from posefuse.tracking.track_set import TrackSet

MAX_OBSERVATIONS = 100
"""Number of observations kept per person, which bounds the memory."""

Contacts = dict[tuple[str, str], "Contact"]
"""Contacts by the names of the two people."""


@dataclass
class Contact:
    """Two people who are, or recently were, close enough to be confused.

    Attributes:
        names: Names of the two people.
        merged_s: Time for which most views that should show both showed only one, in seconds.
        separated_at_s: Time since which they are separated, in seconds; NaN while they are not.
        observations: By name, observations since then.
    """

    names: tuple[str, str]
    merged_s: float = 0.0
    separated_at_s: float = np.nan
    observations: dict[str, deque[Observation]] = field(default_factory=dict)


@dataclass(frozen=True)
class AuditResult:
    """Result of an audit.

    Attributes:
        names: Names of the two people.
        swap: Whether to swap the two identities.
        is_clear: Whether the bone lengths distinguish the two people.
        log_odds: Log odds of the current identities.
        since_s: Time since which the two are separated, in seconds.
    """

    names: tuple[str, str]
    swap: bool
    is_clear: bool
    log_odds: float
    since_s: float


def update_contacts(
    contacts: Contacts, tracks: list[Track], state: State, outcome: FrameOutcome, options: IdentityAuditOptions
) -> None:
    """Update who is close to whom, and for how long views have shown only one of the two.

    Args:
        contacts: Updated in place.
        tracks: All tracks.
        state: States of the tracks.
        outcome: Outcome of the frame for these tracks.
        options: Options of the audit.
    """
    index = {track.name: p for p, track in enumerate(tracks)}
    for pair in [pair for pair in contacts if not index.keys() >= set(pair)]:
        del contacts[pair]
    if len(tracks) < 2:
        return
    roots = state.root.tolist()
    known = {tuple(sorted((index[first], index[second]))) for first, second in contacts}
    pairs = sorted(known | _near_pairs(roots, options.near_m))
    if not pairs:
        return
    # Views that share one detection between two people show only one of them.
    supported, expected = outcome.supported & (outcome.rows >= 0), outcome.expected
    for p, q in pairs:
        pair, distance_m, merged_s = ordered_pair(tracks[p].name, tracks[q].name), math.dist(roots[p], roots[q]), 0.0
        if distance_m < options.near_m:
            both = expected[p] & expected[q]
            merged = 2 * (both & (supported[p] != supported[q])).sum() > both.sum()
            merged_s = outcome.dt_s if merged else 0.0
        _update_contact(contacts, pair, distance_m, merged_s, outcome.time_s, options)


def _near_pairs(points_m: list[list[float]], near_m: float) -> set[tuple[int, ...]]:
    """Return the pairs of points that are near; along the first axis, few of a crowd are.

    Args:
        points_m: Points, not NaN.
        near_m: Distance, in meters.
    """
    pairs = set()
    order = sorted(range(len(points_m)), key=lambda p: points_m[p][0])
    for i, p in enumerate(order):
        for q in order[i + 1 :]:
            if points_m[q][0] - points_m[p][0] >= near_m:
                break
            if math.dist(points_m[p], points_m[q]) < near_m:
                pairs.add((p, q) if p < q else (q, p))
    return pairs


def _update_contact(
    contacts: Contacts,
    pair: tuple[str, str],
    distance_m: float,
    merged_s: float,
    time_s: float,
    options: IdentityAuditOptions,
) -> None:
    """Update one contact by the distance and by the time for which views of this frame showed only one person."""
    contact = contacts.get(pair)
    if distance_m < options.near_m:
        contact = contacts.setdefault(pair, Contact(pair))
        contact.merged_s += merged_s
        contact.separated_at_s = np.nan
        contact.observations.clear()
    elif contact is not None and distance_m > options.apart_m and np.isnan(contact.separated_at_s):
        contact.separated_at_s = time_s
        if contact.merged_s < options.min_merged_s:
            del contacts[pair]


def ordered_pair(first: str, second: str) -> tuple[str, str]:
    """Return two names in the order in which contacts are stored."""
    return (first, second) if first < second else (second, first)


def drop_contacts(contacts: Contacts, names: tuple[str, str]) -> None:
    """Drop all contacts of two people whose identities were swapped, because their observations are mixed up."""
    for pair in [pair for pair in contacts if set(pair) & set(names)]:
        del contacts[pair]


def observe_separated(contacts: Contacts, tracks: TrackSet, outcome: FrameOutcome, settings: TrackerSettings) -> None:
    """Add this frame's observations of people whom several views show to the contacts from which they are separated.

    Args:
        contacts: Updated in place.
        tracks: All tracks.
        outcome: Outcome of the frame for these tracks.
        settings: Settings of the tracker.
    """
    interval_s = settings.options.identity_audit.min_interval_s
    due: dict[str, list[deque[Observation]]] = {}
    for contact in contacts.values():
        if math.isfinite(contact.separated_at_s):
            for name in contact.names:
                earlier = contact.observations.setdefault(name, deque(maxlen=MAX_OBSERVATIONS))
                # Errors of consecutive frames are correlated.
                if not earlier or outcome.time_s - earlier[-1].time_s > interval_s:
                    due.setdefault(name, []).append(earlier)
    if not due:
        return
    projected = tracks.projected(settings.cameras[:0], settings)
    for p, track in enumerate(tracks.tracks):
        if track.name in due and outcome.supported[p].sum() > 1:
            new = track_observation(outcome, p, projected, tracks, settings)
            for earlier in due[track.name]:
                earlier.append(new)


def track_observation(
    outcome: FrameOutcome,
    p: int,
    projected: ProjectedBodies,
    tracks: TrackSet,
    settings: TrackerSettings,
) -> Observation:
    """Return what a frame shows of a tracked person.

    Args:
        outcome: Outcome of the frame.
        p: Index of the track.
        projected: Bodies of all tracks.
        tracks: All tracks.
        settings: Settings of the tracker.
    """
    frame, rows, labels = outcome.frame, outcome.rows[p], outcome.labels[p]
    shape = labels.shape
    pixels, confidence = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    views, keypoints = np.nonzero((rows >= 0)[:, None] & (labels >= 0))
    shown = rows[views], labels[views, keypoints]
    pixels[views, keypoints], confidence[views, keypoints] = frame.keypoints_px[shown], frame.confidence[shown]
    return Observation(
        outcome.time_s, frame.number, pixels, confidence, rows, projected.points_m[p], projected.covariance_m2[p],
        tracks.state.root[p].copy(), 0.0, 1.0,
    )  # fmt: skip


def audit_identities(
    contacts: Contacts, tracks: list[Track], state: State, time_s: float, settings: TrackerSettings
) -> list[AuditResult]:
    """Audit the people who have been separated for long enough; their contacts are dropped.

    Args:
        contacts: Updated in place.
        tracks: All tracks.
        state: States of the tracks.
        time_s: Time of the frame, in seconds.
        settings: Settings of the tracker.
    """
    results, options = [], settings.options.identity_audit
    index = {track.name: p for p, track in enumerate(tracks)}
    for pair, contact in list(contacts.items()):
        if not time_s - contact.separated_at_s > options.observe_s:
            continue
        n_frames = min(len(contact.observations.get(name, ())) for name in pair)
        overdue = time_s - contact.separated_at_s > options.max_observe_s
        if n_frames < options.frames and not overdue:
            continue
        del contacts[pair]
        if n_frames < options.min_frames:
            results.append(AuditResult(pair, swap=False, is_clear=False, log_odds=0.0, since_s=contact.separated_at_s))
            continue
        fitted = [fit_last_state(subsample(contact.observations[name], options.frames), settings) for name in pair]
        p, q = (index[name] for name in pair)
        same = _log_odds(tracks, state, p, fitted[0], settings) + _log_odds(tracks, state, q, fitted[1], settings)
        swapped = _log_odds(tracks, state, p, fitted[1], settings) + _log_odds(tracks, state, q, fitted[0], settings)
        odds = same - swapped
        clear = abs(odds) > options.min_log_odds
        results.append(AuditResult(pair, odds < -options.min_log_odds, clear, odds, contact.separated_at_s))
    return results


def subsample(observations: deque[Observation], n_frames: int) -> list[Observation]:
    """Return at most ``n_frames`` observations that are evenly spread, because their errors are less correlated."""
    count = len(observations)
    return [observations[int(i)] for i in np.linspace(0, count - 1, min(count, n_frames))]


def _log_odds(tracks: list[Track], state: State, p: int, fitted: State, settings: TrackerSettings) -> float:
    observed_s = settings.options.identity_audit.observe_s
    return same_body_log_odds(settings, tracks[p], state, p, fitted, observed_s)
