"""Lifecycle of tracks: which views should show them, when they are lost, re-acquired and terminated."""

from typing import NamedTuple

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import predict_visibility
from posefuse.kernels.tracking.records import State
from posefuse.kinematics.segment_lengths import length_information
from posefuse.model.track_events import Event, EventKind
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import (
    ProjectedBodies,
    fix_shape_covariance,
    select_states,
    set_state,
    shape_block,
)
from posefuse.tracking.bone_lengths import LengthMonitor, measure_lengths, reopen_shape
from posefuse.tracking.frame_clock import TIME_TOLERANCE_S
from posefuse.tracking.pooled_lengths import PooledLengths
from posefuse.tracking.records import Track
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import FrameOutcome
from posefuse.tracking.tempering import update_lengths

_MAX_REFINED_SIGMA = 2.0
"""Bias of the recent comparisons, in standard deviations, beyond which fixed lengths are not refined."""


class LifecycleThresholds(NamedTuple):
    """Scores at which the state of a track changes.

    Attributes:
        initial_score: Lowest score of a track that was just confirmed or re-acquired.
        lost_score: Score below which a track is lost.
        established_score: Score from which a track is never again taken for a coincidence.
    """

    initial_score: float
    lost_score: float
    established_score: float


def new_track(number: int, time_s: float, thresholds: LifecycleThresholds) -> Track:
    """Return a track that was just confirmed."""
    track = Track(number, f"person_{number}", TrackState.ACTIVE, thresholds.initial_score, time_s)
    track.established = thresholds.initial_score >= thresholds.established_score
    return track


def expected_views(projected: ProjectedBodies, settings: TrackerSettings) -> np.ndarray:
    """Return which views should show each person, shape (person, view), bool.

    A large enough share of the core keypoints must be inside the image.
    """
    should_show = np.empty(projected.pixels.shape[:2], dtype=bool)
    core, share = frozen(settings.core, np.int64), settings.options.lifecycle.visible_share
    predict_visibility(projected.pixels, settings.sizes_px, core, share, should_show)
    return should_show


def update_track(
    track: Track,
    score: float,
    thresholds: LifecycleThresholds,
    supported: np.ndarray,
    expected: np.ndarray,
    time_s: float,
    settings: TrackerSettings,
) -> list[tuple[EventKind, str]]:
    """Update score and state of a track by the views that support it.

    Args:
        track: Updated in place.
        score: Score of the track after the frame.
        thresholds: Scores at which states change.
        supported: shape (view,), bool: views that support the track.
        expected: shape (view,), bool: views that should show the person.
        time_s: Time of the frame, in seconds.
        settings: Settings of the tracker.

    Returns:
        Events and their reasons.
    """
    o = settings.options
    n_views = np.count_nonzero(supported)
    track.log_odds = score
    track.established |= score >= thresholds.established_score
    if n_views > 1:
        track.last_multiview_s = time_s
    events: list[tuple[EventKind, str]] = []
    # A single view does not support a track that may be a coincidence of two views.
    if n_views >= (1 if track.established else 2) and track.state == TrackState.ACTIVE:
        track.last_seen_s = time_s
    elif n_views >= o.reacquire_views and track.state == TrackState.LOST:
        missing_s = time_s - track.last_seen_s
        events.append(("reacquired", f"seen again by {_names(supported, settings)} after {missing_s:.2f} s"))
        track.state, track.last_seen_s = TrackState.ACTIVE, time_s
        track.log_odds = max(track.log_odds, thresholds.initial_score)
    if track.state == TrackState.ACTIVE:
        missing_s = time_s - track.last_seen_s
        if track.established:
            views, limit_s = "no camera", o.lost_after_s
        else:
            views, limit_s = "at most one camera", o.single_view_after_s
        if missing_s > limit_s + TIME_TOLERANCE_S:
            track.state = TrackState.LOST
            events.append(("lost", f"seen by {views} for {missing_s:.2f} s"))
        elif track.log_odds < thresholds.lost_score:
            track.state = TrackState.LOST
            others = _names(expected & ~supported, settings)
            events.append(("lost", f"seen by {_names(supported, settings)}, but not by {others}"))
    return events


def _names(views: np.ndarray, settings: TrackerSettings) -> str:
    names = [settings.rig.names[v] for v in np.flatnonzero(views)]
    return ", ".join(names) if names else "no camera"


def update_last_inside(
    tracks: list[Track], projected: ProjectedBodies, time_s: float, settings: TrackerSettings
) -> None:
    """Note which people are in, or close to, the overlap of two images."""
    options = settings.options.lifecycle
    margin = (options.outside_margin_m * projected.px_per_m[:, :, settings.core])[..., None]
    pixels = projected.pixels[:, :, settings.core]
    inside = ((pixels >= -margin) & (pixels < settings.sizes_px[:, None] + margin)).all(axis=-1)
    n_views = (inside.mean(axis=2) >= options.visible_share).sum(axis=1)
    for p, track in enumerate(tracks):
        if n_views[p] >= 2:
            track.last_inside_s = time_s


def tracks_to_terminate(tracks: list[Track], state: State, time_s: float, settings: TrackerSettings) -> dict[int, str]:
    """Return the tracks that end, by index, each with the reason."""
    reasons: dict[int, str] = {}
    finite = np.isfinite(state.root).all(axis=1)
    for p, track in enumerate(tracks):
        permanent = track.established and settings.options.population is not None
        lost = track.state == TrackState.LOST and not permanent
        reason = _termination_reason(track, state, p, time_s, settings) if lost else ""
        if reason:
            reasons[p] = reason
        elif not finite[p]:
            reasons[p] = "its state is not finite"
    return reasons


def _termination_reason(track: Track, state: State, p: int, time_s: float, settings: TrackerSettings) -> str:
    """Return why a lost track ends; empty if it does not."""
    o = settings.options
    if not track.established:
        return "it may have been a coincidence of two cameras"
    if time_s - track.last_seen_s > o.terminate_after_s + TIME_TOLERANCE_S:
        return f"lost for {time_s - track.last_seen_s:.1f} s"
    sd_m = float(np.sqrt(np.trace(state.covariance[p, :3, :3])))
    if o.terminate_beyond_m is not None and sd_m > o.terminate_beyond_m:
        return f"position uncertainty of {sd_m:.1f} m"
    limit_s = o.terminate_outside_after_s
    if limit_s is not None and time_s - track.last_inside_s > limit_s + TIME_TOLERANCE_S:
        return f"outside the overlap of two cameras for {time_s - track.last_inside_s:.1f} s"
    return ""


def fix_shape(track: Track, state: State, p: int, time_s: float, dt_s: float, settings: TrackerSettings) -> None:
    """Fix the bone lengths of a body once they are stable, or observed for long, and reopen those that are biased.

    Args:
        track: Updated in place.
        state: Updated in place.
        p: Index of the track.
        time_s: Time of the frame, in seconds.
        dt_s: Time since the last frame, in seconds.
        settings: Settings of the tracker.
    """
    if track.lengths.to_reopen is not None and track.known_shape is not None:
        reopen_shape(state, p, track.known_shape[1], track.lengths, settings)
        track.known_shape, track.shape_observed_s = None, 0.0
        track.lengths, track.pooled = LengthMonitor(), PooledLengths()
        return
    if track.state != TrackState.ACTIVE or not state.free[p]:
        return
    is_stable = False
    if track.last_multiview_s == time_s:
        track.shape_observed_s += dt_s
        block = shape_block(state, p, settings.tree)
        is_stable = track.lengths.is_stable(state.shape[p], block, track.shape_observed_s, dt_s, settings)
    if is_stable or track.shape_observed_s > settings.options.fix_shape_after_s:
        _fix_shape(track, state, p, settings)


def _fix_shape(track: Track, state: State, p: int, settings: TrackerSettings) -> None:
    track.known_shape = (state.shape[p].copy(), shape_block(state, p, settings.tree).copy())
    fix_shape_covariance(state, p, settings.tree.n_pose, settings.tree.n_shape)


def _refine_shape(track: Track, state: State, p: int, settings: TrackerSettings) -> None:
    """Take fixed lengths from all comparisons with the views, unless the recent ones contradict those in use."""
    if track.known_shape is None or track.lengths.to_reopen is not None or not track.pooled.is_due:
        return
    # Where some comparisons were biased, lengths between them and the others would hide the bias.
    if (np.abs(track.lengths.bias_sigma(state.shape[p], settings)) > _MAX_REFINED_SIGMA).any():
        return
    lengths_m = track.pooled.take_m(settings.tree)
    state.shape[p] = lengths_m
    track.known_shape = (lengths_m, track.known_shape[1])


def check_lengths(tracks: list[Track], state: State, outcome: FrameOutcome, settings: TrackerSettings) -> list[Event]:
    """Compare the bone lengths of all bodies with the views, refine fixed ones, and note biased ones.

    Lengths that are still estimated are fixed first: the smoother takes the lengths before and after a frame in which
    they are fixed for different ones.

    Args:
        tracks: Updated in place.
        state: Updated in place.
        outcome: Result of association and update.
        settings: Settings of the tracker.

    Returns:
        Bodies whose lengths are estimated again from the next frame on.
    """
    if settings.options.reopen_shape_sigma is None:
        return []
    near_m = settings.options.identity_audit.near_m
    apart_m = np.linalg.norm(state.root[:, None] - state.root, axis=-1) + near_m * np.eye(len(tracks))
    # In contact, a detection may show parts of the other body.
    clear = (outcome.supported.sum(axis=1) > 1) & (apart_m >= near_m).all(axis=1)
    bodies = [p for p, track in enumerate(tracks) if clear[p] and track.state == TrackState.ACTIVE]
    if not bodies:
        return []
    labels = np.where(outcome.used[bodies], outcome.labels[bodies], -1)
    shown = measure_lengths(
        select_states(state, bodies), outcome.frame, outcome.time_s, outcome.rows[bodies], labels, settings
    )
    events = []
    for each, p in zip(shown, bodies, strict=True):
        track = tracks[p]
        track.lengths.add(each)
        track.pooled.add(each, settings.options.smoother_error_memory_s)
        biased = None if track.lengths.to_reopen is not None else track.lengths.find_biased(state.shape[p], settings)
        if biased is None:
            _refine_shape(track, state, p, settings)
            continue
        if state.free[p]:
            _fix_shape(track, state, p, settings)
        names = ", ".join(settings.tree.shape_names[j] for j in np.flatnonzero(biased))
        reason = f"the cameras contradict {names}"
        events.append(Event(outcome.frame.number, outcome.time_s, track.name, "lengths_reestimated", reason))
    return events


def restore_track(state: State, p: int, fitted: State, settings: TrackerSettings) -> None:
    """Give a lost track the state of a newly fitted body; fixed bone lengths stay.

    Lengths that are still estimated are combined with those of the new state.

    Args:
        state: Updated in place.
        p: Index of the track.
        fitted: State of one body whose lengths are estimated; it is not changed.
        settings: Settings of the tracker.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    shape_m, block = state.shape[p].copy(), state.covariance[p, n : n + h, n : n + h].copy()
    is_fixed = not state.free[p]
    fitted = select_states(fitted, [0])
    if not is_fixed:
        information, pull = length_information(settings.tree, shape_m, block)
        gradient = pull - information @ (fitted.shape[0] - settings.tree.shape_m)
        update_lengths(fitted, information, gradient, settings)
    set_state(state, p, fitted)
    if is_fixed:
        state.shape[p] = shape_m
        fix_shape_covariance(state, p, n, h)


def swap_identities(tracks: list[Track], state: State, p: int, q: int) -> None:
    """Swap the names and the bone lengths of two tracks; the poses stay."""
    for name in ("name", "known_shape", "shape_observed_s", "pooled"):
        mine, theirs = getattr(tracks[p], name), getattr(tracks[q], name)
        setattr(tracks[p], name, theirs)
        setattr(tracks[q], name, mine)
    tracks[p].lengths, tracks[q].lengths = LengthMonitor(), LengthMonitor()
    n, h = state.velocity.shape[1], state.shape.shape[1]
    lengths = slice(n, n + h)
    blocks = state.covariance[[q, p], lengths, lengths]
    for each in (p, q):
        # The correlation of lengths and pose was estimated for the other body.
        state.covariance[each, lengths] = 0.0
        state.covariance[each, :, lengths] = 0.0
    state.covariance[[p, q], lengths, lengths] = blocks
    state.shape[[p, q]] = state.shape[[q, p]]
    state.free[[p, q]] = state.free[[q, p]]
