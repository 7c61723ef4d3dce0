"""Rules of life: who counts as there, who is lost, who is forgotten, and when a body's lengths are kept."""

from typing import NamedTuple

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import predict_visibility
from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import aim, bones_shown
from posefuse.kinematics.segment_lengths import told_of_lengths
from posefuse.model.track_events import Happening
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import Sight, chosen, put
from posefuse.tracking.frame_clock import SAME_S
from posefuse.tracking.records import Track
from posefuse.tracking.reinitialize import forget
from posefuse.tracking.settings import Settings
from posefuse.tracking.tempering import see_lengths

_SEEN_SHARE = 0.5
_BESIDE_M = 0.5
"""Beside what a view sees, of a human: as far outside as somebody is counted as inside."""


class Bounds(NamedTuple):
    """Scores at which somebody's life changes.

    Attributes:
        begins_with: the least score of who is believed or found again.
        lost_below: the score with which they are lost.
        sure_from: the score with which they are no longer taken for a coincidence.
    """

    begins_with: float
    lost_below: float
    sure_from: float


def newcomer(number: int, time_s: float, bounds: Bounds) -> Track:
    """Somebody just believed."""
    track = Track(number, f"person_{number}", TrackState.ACTIVE, bounds.begins_with, time_s, np.zeros(3))
    track.sure = bounds.begins_with >= bounds.sure_from
    return track


def expected(sight: Sight, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """Which views should see whom: half of the core within the image; and where people are.

    Returns:
        Shape (person, view), bool, and shape (person, 3): the middles of their cores, m.
    """
    should_see = np.empty(sight.pixels.shape[:2], dtype=bool)
    middles_m = np.empty((len(should_see), 3))
    core = frozen(settings.core, np.int64)
    predict_visibility(sight.points_m, sight.pixels, settings.sizes_px, core, _SEEN_SHARE, should_see, middles_m)
    return should_see, middles_m


def live_on(
    track: Track,
    score: float,
    bounds: Bounds,
    supported: np.ndarray,
    should_see: np.ndarray,
    torso_m: np.ndarray,
    time_s: float,
    settings: Settings,
) -> list[tuple[Happening, str]]:
    """Change a person's score and state by what the views show.

    Args:
        track: in and out.
        score: that they are there, after the frame.
        bounds: of scores.
        supported: shape (view,), bool: which views show them.
        should_see: shape (view,), bool: which views should.
        torso_m: shape (3,): where they are.
        time_s: of the frame.
        settings: of the tracker.

    Returns:
        What happened, and why.
    """
    o = settings.options
    n_views = np.count_nonzero(supported)
    track.log_odds = score
    track.sure |= score >= bounds.sure_from
    if n_views > 1:
        track.firm_s = time_s
    said: list[tuple[Happening, str]] = []
    # What may be a coincidence of two views one alone does not show.
    if n_views >= (1 if track.sure else 2) and track.state == TrackState.ACTIVE:
        track.seen_s, track.lost_at_m = time_s, torso_m
    elif n_views >= o.reacquire_views and track.state == TrackState.LOST:
        said.append(("found", f"seen again by {_named(supported, settings)} after {time_s - track.seen_s:.2f} s"))
        track.state, track.seen_s, track.lost_at_m = TrackState.ACTIVE, time_s, torso_m
        track.log_odds = max(track.log_odds, bounds.begins_with)
    if track.state == TrackState.ACTIVE:
        few, lasts_s = ("no camera", o.lost_after_s) if track.sure else ("one camera at most", o.weak_after_s)
        if time_s - track.seen_s > lasts_s + SAME_S:
            track.state = TrackState.LOST
            said.append(("lost", f"seen by {few} for {time_s - track.seen_s:.2f} s"))
        elif track.log_odds < bounds.lost_below:
            track.state = TrackState.LOST
            others = _named(should_see & ~supported, settings)
            said.append(("lost", f"seen by {_named(supported, settings)}, but not by {others}"))
    return said


def _named(views: np.ndarray, settings: Settings) -> str:
    names = [settings.rig.names[v] for v in np.flatnonzero(views)]
    return ", ".join(names) if names else "no camera"


def note_inside(tracks: list[Track], sight: Sight, time_s: float, settings: Settings) -> None:
    """Note who is where two views overlap, or near it: their core's middle within the image or so far beside it."""
    margin = (_BESIDE_M * settings.tree.scale * sight.size_px[:, :, settings.core])[..., None]
    pixels = sight.pixels[:, :, settings.core]
    inside = ((pixels >= -margin) & (pixels < settings.sizes_px[:, None] + margin)).all(axis=-1)
    views = (inside.mean(axis=2) >= _SEEN_SHARE).sum(axis=1)
    for p, track in enumerate(tracks):
        if views[p] >= 2:
            track.inside_s = time_s


def forgotten(tracks: list[Track], state: State, time_s: float, settings: Settings) -> dict[int, str]:
    """Who is not looked for any more, by place, and why."""
    over: dict[int, str] = {}
    sound = np.isfinite(state.root).all(axis=1)
    for p, track in enumerate(tracks):
        staying = track.sure and settings.options.population is not None
        lost = track.state == TrackState.LOST and not staying
        why = _why_forgotten(track, state, p, time_s, settings) if lost else ""
        if why:
            over[p] = why
        elif not sound[p]:
            over[p] = "the state is broken"
    return over


def _why_forgotten(track: Track, state: State, p: int, time_s: float, settings: Settings) -> str:
    """Why somebody lost is not looked for any more, "" where they are."""
    o = settings.options
    if not track.sure:
        return "it may have been a coincidence of two cameras"
    if time_s - track.seen_s > o.forget_after_s + SAME_S:
        return f"lost for {time_s - track.seen_s:.1f} s"
    doubt_m = float(np.sqrt(np.trace(state.covariance[p, :3, :3])))
    if o.forget_beyond_m is not None and doubt_m > o.forget_beyond_m:
        return f"where they are is known to {doubt_m:.1f} m only"
    if o.outside_s is not None and time_s - track.inside_s > o.outside_s + SAME_S:
        return f"outside of what two cameras see for {time_s - track.inside_s:.1f} s"
    return ""


def settle_shape(track: Track, state: State, p: int, time_s: float, dt_s: float, settings: Settings) -> None:
    """Keep a body's lengths once they have been seen for long enough: what goes by while nobody looks does not count.

    Args:
        track: in and out.
        state: in and out.
        p: their place in it.
        time_s: of the frame.
        dt_s: since the last.
        settings: of the tracker.
    """
    if track.state != TrackState.ACTIVE or not state.free[p]:
        return
    if track.firm_s == time_s:
        track.sought_s += dt_s
    if track.sought_s > settings.options.shape_settle_s:
        n, h = settings.tree.n_pose, settings.tree.n_shape
        block = state.covariance[p, n : n + h, n : n + h]
        track.trusted = (state.shape[p].copy(), block.copy())
        track.settled_s = time_s
        state.free[p] = 0
        state.covariance[p, n : n + h] = 0.0
        state.covariance[p, :, n : n + h] = 0.0


def take_back(state: State, p: int, found: State, settings: Settings) -> None:
    """Somebody lost is there again, as a new state says; a body whose lengths are known keeps them.

    Where they are still sought, what was found of them goes on with what the new state knows.

    Args:
        state: in and out.
        p: their place in it.
        found: of one person, whose lengths are sought; it is left as it is.
        settings: of the tracker.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    known, block, kept = state.shape[p].copy(), state.covariance[p, n : n + h, n : n + h].copy(), not state.free[p]
    found = chosen(found, [0])
    if not kept:
        information, pull = told_of_lengths(settings.tree, known, block)
        gradient = pull - information @ (found.shape[0] - settings.tree.shape_m)
        see_lengths(found, information, gradient, settings)
    put(state, p, found)
    if kept:
        state.shape[p] = known
        state.free[p] = 0
        state.covariance[p, n : n + h] = 0.0
        state.covariance[p, :, n : n + h] = 0.0


def exchange(tracks: list[Track], state: State, p: int, q: int) -> None:
    """Let two people go on as each other: names, and what is known of lengths, change places; poses stay."""
    for name in ("name", "trusted", "settled_s", "sought_s"):
        mine, theirs = getattr(tracks[p], name), getattr(tracks[q], name)
        setattr(tracks[p], name, theirs)
        setattr(tracks[q], name, mine)
    n, h = state.velocity.shape[1], state.shape.shape[1]
    lengths = slice(n, n + h)
    blocks = state.covariance[[q, p], lengths, lengths]
    for each in (p, q):
        # How lengths go with the pose was found of the other body.
        state.covariance[each, lengths] = 0.0
        state.covariance[each, :, lengths] = 0.0
    state.covariance[[p, q], lengths, lengths] = blocks
    state.shape[[p, q]] = state.shape[[q, p]]
    state.free[[p, q]] = state.free[[q, p]]


def set_limb_anew(state: State, p: int, keypoint: int, points_m: np.ndarray, settings: Settings) -> bool:
    """Turn the bones that lead to a keypoint to where they are shown, as little known as those of somebody new.

    Args:
        state: in and out.
        p: whose.
        keypoint: at the end of the limb.
        points_m: shape (keypoint, 3): where the views show the body's points, NaN where they do not.
        settings: of the tracker.

    Returns:
        Whether any bones lead there.
    """
    tree = settings.tree
    node = int(tree.keypoint_nodes[keypoint])
    bones: list[int] = []
    while node > 0 and tree.nodes[node].is_bone:
        bones.append(tree.nodes[node].mover)
        node = tree.nodes[node].parent
    if not bones:
        return False
    aim(state.bones[p], bones_shown(tree, points_m), bones)
    forget(
        state, p, np.array([3 + 3 * len(tree.segments) + 2 * bone + i for bone in bones for i in range(2)]), settings
    )
    return True
