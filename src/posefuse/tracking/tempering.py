"""The same filter run over again with less said by each frame, from its states alone.

What a frame said of a body is what the filter learned there: with P' and P the covariances of pose and shape before and
after the update, m' and m the means, the logarithm of the likelihood has the curvature P^-1 - P'^-1 and at m the
gradient P'^-1 (m - m'). Both times a factor are what errors that last longer leave of it. No detections are needed, and
each costs a few products of small matrices. See docs/methods.md, "Smoothing people".
"""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.refiltering import ROUNDING_TOLERANCE, refilter
from posefuse.kernels.tracking.smoothing import apply_changes, compare_states
from posefuse.kinematics.initial_pose import newborn_covariance
from posefuse.tracking.body_states import chosen, put, uncertain
from posefuse.tracking.settings import Settings


@dataclass(frozen=True, eq=False)
class Said:
    """What frames said of pose and shape, in the axes of the states they led to.

    Attributes:
        curvature: shape (frame, pose + shape, pose + shape): of the negative log likelihood; 0 for a kept shape.
        gradient: shape (frame, pose + shape): of the log likelihood, at the state.
    """

    curvature: np.ndarray
    gradient: np.ndarray


def ahead(state: State, dt_s: np.ndarray, settings: Settings) -> State:
    """States so much later, as if nothing had been seen; in place."""
    walk = settings.options.motion.shape_walk
    predict_people(dt_s, settings.decay_s, settings.power, settings.most, walk, state)
    return state


def what_was_said(before: State, dt_s: np.ndarray, after: State, settings: Settings) -> Said:
    """What frames said, from one person's filtered states in the frames before them and in them.

    Args:
        before: a State with frames where people stand.
        dt_s: shape (frame,): from the one to the other.
        after: a State likewise.
        settings: of the tracker whose states they are.
    """
    frames, n, h = len(dt_s), settings.tree.n_pose, settings.tree.n_shape
    foretold = ahead(chosen(before, np.arange(frames)), dt_s, settings)
    change = np.empty((frames, 2 * n + h))
    compare_states(foretold, after, change)
    said = Said(np.zeros((frames, n + h, n + h)), np.zeros((frames, n + h)))
    free = (before.free != 0) & (after.free != 0)
    for these, m in ((np.flatnonzero(free), n + h), (np.flatnonzero(~free), n)):
        known = np.linalg.inv(foretold.covariance[these, :m, :m])
        said.curvature[these, :m, :m] = np.linalg.inv(after.covariance[these, :m, :m]) - known
        said.gradient[these, :m] = (known @ change[these, :m, None])[..., 0]
    return said


def tell_again(
    filtered: State, time_s: np.ndarray, share: np.ndarray, told: np.ndarray, first: State, settings: Settings
) -> tuple[State, np.ndarray]:
    """Filter one person over consecutive frames again, with another share of what each frame said.

    Args:
        filtered: a State with frames where people stand; it is left as it is.
        time_s: shape (frame,), ascending.
        share: shape (frame,): which of what the filter was told is told now.
        told: shape (frame,): by how much the filter was told less than frames say at face value.
        first: a State of one person, in the first frame, that knows of the share already.
        settings: of the tracker whose states they are.

    Returns:
        The states; and shape (frame, pose + shape, pose + shape): what frames say at face value, in the axes of those
        states; 0 for the first, which is not gone into.
    """
    frames, size = len(time_s), settings.tree.n_pose + settings.tree.n_shape
    out = State(*(each.copy() for each in filtered))
    put(out, 0, first)
    information = np.empty((frames, size, size))
    information[0] = 0.0
    dt_s, walk = np.diff(time_s, prepend=time_s[:1]), settings.options.motion.shape_walk
    changes = np.flatnonzero(np.diff(filtered.free) != 0) + 1
    k = 1
    while k < frames:
        stop = next((int(each) for each in changes if each >= k), frames)
        to = slice(k - 1, stop)
        k += refilter(
            dt_s[to], settings.decay_s, settings.power, settings.most, walk, State(*(each[to] for each in filtered)),
            share[to], told[to], State(*(each[to] for each in out)), information[to],
        ) - 1  # fmt: skip
        if k < frames:
            _tell_one_again(filtered, k, float(dt_s[k]), float(share[k]), float(told[k]), out, information, settings)
            k += 1
    return out, information


def _tell_one_again(
    filtered: State,
    k: int,
    dt_s: float,
    share: float,
    told: float,
    out: State,
    information: np.ndarray,
    settings: Settings,
) -> None:
    """Frame ``k`` of the same, by itself: where a shape begins or ends to be sought, and where rounding counts.

    Where a limb was set anew the filter knew less after the frame than before it. No share can be told of that, and it
    is nothing that the frame says: the state is the filter's.
    """
    seen = chosen(filtered, [k])
    said = what_was_said(chosen(filtered, [k - 1]), np.array([dt_s]), seen, settings)
    now = next_with(chosen(out, [k - 1]), dt_s, seen, said.curvature[0], said.gradient[0], share, settings)
    forgot = _forgets(said.curvature[0], seen, settings) or not _is_covariance(now, settings)
    if forgot and _is_covariance(seen, settings):
        put(out, k, seen)
        information[k] = 0.0
        return
    put(out, k, now)
    turn = bone_axes(now, seen, settings)[0]
    information[k] = told * turn.T @ said.curvature[0] @ turn


def _forgets(curvature: np.ndarray, seen: State, settings: Settings) -> bool:
    """Whether a frame said less than nothing of a number, by more than rounding."""
    m = settings.tree.n_pose + (settings.tree.n_shape if seen.free[0] else 0)
    after, said = np.diag(np.linalg.inv(seen.covariance[0, :m, :m])), np.diag(curvature)[:m]
    return bool((said < -ROUNDING_TOLERANCE * (after - said)).any())


def _is_covariance(state: State, settings: Settings) -> bool:
    rows = uncertain(settings.tree.n_pose, settings.tree.n_shape, bool(state.free[0]))
    try:
        np.linalg.cholesky(state.covariance[0][np.ix_(rows, rows)])
    except np.linalg.LinAlgError:
        return False
    return True


def first_with(state: State, share: float, settings: Settings) -> State:
    """One person's first state, had only that share of its frame been told to a filter that knew nothing."""
    n, h = settings.tree.n_pose, settings.tree.n_shape
    rows = uncertain(n, h, bool(state.free[0]))
    m = len(rows) - n
    at, pose = np.ix_(rows, rows), rows[:m]
    nothing = newborn_covariance(settings.tree, settings.tree.shape_covariance, settings.options.motion)
    state = chosen(state, [0])
    block = state.covariance[0][at]
    prior = np.linalg.inv(nothing[np.ix_(pose, pose)])
    wider = np.linalg.inv((1.0 - share) * prior + share * np.linalg.inv(block[:m, :m]))
    gain = np.linalg.solve(block[:m, :m], block[:m])
    state.covariance[0][at] = block + gain.T @ (wider - block[:m, :m]) @ gain
    return state


def next_with(
    state: State,
    dt_s: float,
    told: State,
    curvature: np.ndarray,
    gradient: np.ndarray,
    share: float,
    settings: Settings,
) -> State:
    """One person's next state where another share of what a frame said is told.

    Args:
        state: of the frame before; it is left as it is.
        dt_s: since then.
        told: what the filter found in this frame.
        curvature: shape (pose + shape, pose + shape): what the frame said, see :class:`Said`.
        gradient: shape (pose + shape,): likewise.
        share: which of what the filter was told; with 1 it finds what it found.
        settings: of the tracker whose states they are.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    now = ahead(chosen(state, [0]), np.array([dt_s]), settings)
    was_free, is_free = bool(state.free[0]), bool(told.free[0])
    if was_free and not is_free:
        _keep_shape(now, told.shape[0])
    # What the frame said is in the axes of the first run's bones, whose frames went other ways.
    turn = bone_axes(now, told, settings)[0]
    rows = uncertain(n, h, was_free and is_free)
    _learn(now, told, share * (turn.T @ curvature @ turn), share * (turn.T @ gradient), rows, len(rows) - n)
    if is_free and not was_free:
        _reopen_shape(now, told)
    return now


def see_pose(state: State, seen: State, settings: Settings) -> None:
    """Tell a state of one person, in place, the pose that another source has, as an observation of that covariance."""
    n, h = settings.tree.n_pose, settings.tree.n_shape
    turn = bone_axes(state, seen, settings)[0, :n, :n]
    curvature = turn.T @ np.linalg.inv(seen.covariance[0, :n, :n]) @ turn
    _learn(state, seen, curvature, np.zeros(n), uncertain(n, h, bool(state.free[0])), n)


def see_of_pose(state: State, curvature: np.ndarray, gradient: np.ndarray, settings: Settings) -> None:
    """Tell a state of one person, in place, what is known of the pose beside detections.

    Args:
        state: of one person.
        curvature: shape (pose, pose): of the negative log likelihood.
        gradient: shape (pose,): of the log likelihood, at the state.
        settings: of the tracker whose states they are.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    _learn(state, chosen(state, [0]), curvature, gradient, uncertain(n, h, bool(state.free[0])), n)


def see_lengths(state: State, curvature: np.ndarray, gradient: np.ndarray, settings: Settings) -> None:
    """Tell a state of one person, in place, whose lengths are sought, what another source knows of them.

    Args:
        state: of one person, whose pose goes with their lengths as far as it depends on them.
        curvature: shape (shape, shape): of the negative log likelihood of the lengths.
        gradient: shape (shape,): of the log likelihood, at the state.
        settings: of the tracker whose states they are.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    whole, pull = np.zeros((n + h, n + h)), np.zeros(n + h)
    whole[n:, n:], pull[n:] = curvature, gradient
    _learn(state, chosen(state, [0]), whole, pull, uncertain(n, h, free=True), n + h)


def bone_axes(state: State, seen: State, settings: Settings) -> np.ndarray:
    """For each frame what makes changes in the axes of one state those in another's, whose bones' frames lie otherwise.

    Args:
        state: a State with frames where people stand.
        seen: a State likewise.
        settings: of the tracker whose states they are.

    Returns:
        Rotations of pose and shape, shape (frame, pose + shape, pose + shape).
    """
    n, first = settings.tree.n_pose, 3 + 3 * len(settings.tree.segments)
    frames = np.arange(len(state.root))
    change = np.zeros((len(frames), state.covariance.shape[1]))
    compare_states(state, seen, change)
    change[:, :first] = 0.0
    change[:, n:] = 0.0
    carried = chosen(state, frames)
    apply_changes(change, carried)
    turn = np.tile(np.eye(n + settings.tree.n_shape), (len(frames), 1, 1))
    columns = np.arange(first, n).reshape(-1, 2)
    between = seen.bones.transpose(0, 1, 3, 2) @ carried.bones
    turn[:, columns[:, :, None], columns[:, None]] = between[:, :, :2, :2]
    return turn


def _learn(now: State, told: State, curvature: np.ndarray, gradient: np.ndarray, rows: np.ndarray, m: int) -> None:
    """Change a state, in place, by what is said about the state ``told``."""
    change = np.empty((1, now.covariance.shape[1]))
    compare_states(now, told, change)
    at = np.ix_(rows, rows)
    covariance = now.covariance[0][at]
    curvature, pull = curvature[:m, :m], gradient[:m] + curvature[:m, :m] @ change[0, :m]
    # (1 / curvature + P)^-1, where the curvature need not have an inverse.
    inner = np.linalg.solve(np.eye(m) + curvature @ covariance[:m, :m], curvature)
    inner = 0.5 * (inner + inner.T)
    step = np.zeros((1, now.covariance.shape[1]))
    step[0, rows] = covariance[:, :m] @ (pull - inner @ (covariance[:m, :m] @ pull))
    apply_changes(step, now)
    left = covariance - covariance[:, :m] @ inner @ covariance[:m]
    # What rounding makes unsymmetric would grow from frame to frame.
    now.covariance[0][at] = 0.5 * (left + left.T)


def _keep_shape(state: State, shape_m: np.ndarray) -> None:
    """Make the shape of one person, in place, certain."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    shape = slice(n, n + h)
    covariance = state.covariance[0]
    gain = np.linalg.solve(covariance[shape, shape], covariance[shape])
    apply_changes(((shape_m - state.shape[0]) @ gain)[None], state)
    covariance -= gain.T @ covariance[shape, shape] @ gain
    covariance[shape] = 0.0
    covariance[:, shape] = 0.0
    state.shape[0] = shape_m
    state.free[0] = 0


def _reopen_shape(state: State, told: State) -> None:
    """Make the shape of one person, in place, as uncertain as it was made."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    shape = slice(n, n + h)
    state.shape[0] = told.shape[0]
    state.covariance[0, shape, shape] = told.covariance[0, shape, shape]
    state.free[0] = told.free[0]
