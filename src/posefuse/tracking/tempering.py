"""The filter run again with less information per frame, from its states alone.

The information of a frame about a body is the difference that the update made: with P' and P the covariances of pose
and shape before and after the update, m' and m the means, the log likelihood has the curvature P^-1 - P'^-1 and at m
the gradient P'^-1 (m - m'). Correlated errors leave a fraction of both. No detections are needed, and each frame costs
a few products of small matrices. See docs/methods/smoothing.md.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.refiltering import ROUNDING_TOLERANCE
from posefuse.kernels.tracking.refiltering import refilter as refilter_frames
from posefuse.kernels.tracking.smoothing import apply_changes, compare_states
from posefuse.kinematics.initial_pose import initial_covariance
from posefuse.tracking.body_states import free_columns, select_states, set_state
from posefuse.tracking.settings import TrackerSettings


@dataclass(frozen=True, eq=False)
class FrameInformation:
    """Information of frames about pose and shape, in the axes of the updated states.

    Attributes:
        curvature: shape (frame, pose + shape, pose + shape): of the negative log likelihood; 0 for a fixed shape.
        gradient: shape (frame, pose + shape): of the log likelihood, at the state.
    """

    curvature: np.ndarray
    gradient: np.ndarray


def predict_states(state: State, dt_s: np.ndarray, settings: TrackerSettings) -> State:
    """Predict states by a time, in place, and return them."""
    predict_people(dt_s, settings.motion, state)
    return state


def frame_information(before: State, dt_s: np.ndarray, after: State, settings: TrackerSettings) -> FrameInformation:
    """Return the information of frames from one person's filtered states before and after them.

    Args:
        before: State with one entry per frame, one frame earlier.
        dt_s: shape (frame,): time between the two states, in seconds.
        after: State with one entry per frame.
        settings: Settings of the tracker.
    """
    frames, n, h = len(dt_s), settings.tree.n_pose, settings.tree.n_shape
    predicted = predict_states(select_states(before, np.arange(frames)), dt_s, settings)
    change = np.empty((frames, 2 * n + h))
    compare_states(predicted, after, change)
    information = FrameInformation(np.zeros((frames, n + h, n + h)), np.zeros((frames, n + h)))
    free = (before.free != 0) & (after.free != 0)
    for these, m in ((np.flatnonzero(free), n + h), (np.flatnonzero(~free), n)):
        prior = np.linalg.inv(predicted.covariance[these, :m, :m])
        information.curvature[these, :m, :m] = np.linalg.inv(after.covariance[these, :m, :m]) - prior
        information.gradient[these, :m] = (prior @ change[these, :m, None])[..., 0]
    return information


def refilter(
    filtered: State,
    time_s: np.ndarray,
    share: np.ndarray,
    applied: np.ndarray,
    first: State,
    settings: TrackerSettings,
) -> tuple[State, np.ndarray]:
    """Filter one person over consecutive frames again with another share of each frame's information.

    Args:
        filtered: State with one entry per frame; it is not changed.
        time_s: shape (frame,), ascending.
        share: shape (frame,): share of the information that the filter used.
        applied: shape (frame,): tempering that the filter applied.
        first: State of one person in the first frame, with that share applied.
        settings: Settings of the tracker.

    Returns:
        The states; and the untempered information of each frame in the axes of these states, shape (frame, pose +
        shape, pose + shape), 0 for the first frame.
    """
    frames, size = len(time_s), settings.tree.n_pose + settings.tree.n_shape
    out = State(*(each.copy() for each in filtered))
    set_state(out, 0, first)
    information = np.empty((frames, size, size))
    information[0] = 0.0
    dt_s = np.diff(time_s, prepend=time_s[:1])
    changes = _shape_changes(filtered)
    k = 1
    while k < frames:
        stop = next((int(each) for each in changes if each >= k), frames)
        to = slice(k - 1, stop)
        k += refilter_frames(
            dt_s[to], settings.motion, State(*(each[to] for each in filtered)), share[to], applied[to],
            State(*(each[to] for each in out)), information[to],
        ) - 1  # fmt: skip
        if k < frames:
            step = _FrameStep(k, float(dt_s[k]), float(share[k]), float(applied[k]))
            _refilter_frame(filtered, step, out, information, settings)
            k += 1
    return out, information


def _shape_changes(filtered: State) -> np.ndarray:
    """Return the indices of frames in which a shape becomes fixed or free, or a fixed shape changes, int64."""
    same = filtered.free[1:] == filtered.free[:-1]
    refined = (filtered.free[1:] == 0) & (filtered.shape[1:] != filtered.shape[:-1]).any(axis=1)
    return np.flatnonzero(~same | refined) + 1


@dataclass(frozen=True)
class _FrameStep:
    """One frame to filter again: index, time since the last frame in seconds, share of the information, tempering."""

    frame: int
    dt_s: float
    share: float
    applied: float


def _refilter_frame(
    filtered: State, step: _FrameStep, out: State, information: np.ndarray, settings: TrackerSettings
) -> None:
    """Filter one frame again: where a shape becomes fixed or free or a fixed one changes, and where rounding matters.

    A frame with a reinitialized limb loses information. No share of that can be applied, and it is not information of
    the frame, so the state is that of the filter.
    """
    k = step.frame
    after = select_states(filtered, [k])
    gained = frame_information(select_states(filtered, [k - 1]), np.array([step.dt_s]), after, settings)
    curvature, gradient = gained.curvature[0], gained.gradient[0]
    now = temper_next_state(
        select_states(out, [k - 1]), step.dt_s, after, curvature, gradient, step.share, settings
    )  # fmt: skip
    lost = _loses_information(curvature, after, settings) or not _is_covariance(now, settings)
    if lost and _is_covariance(after, settings):
        set_state(out, k, after)
        information[k] = 0.0
        return
    set_state(out, k, now)
    turn = bone_axes(now, after, settings)[0]
    information[k] = step.applied * turn.T @ curvature @ turn


def _loses_information(curvature: np.ndarray, after: State, settings: TrackerSettings) -> bool:
    """Return whether a frame has negative information about a number, beyond rounding."""
    m = settings.tree.n_pose + (settings.tree.n_shape if after.free[0] else 0)
    posterior, gained = np.diag(np.linalg.inv(after.covariance[0, :m, :m])), np.diag(curvature)[:m]
    return bool((gained < -ROUNDING_TOLERANCE * (posterior - gained)).any())


def _is_covariance(state: State, settings: TrackerSettings) -> bool:
    rows = free_columns(settings.tree.n_pose, settings.tree.n_shape, bool(state.free[0]))
    try:
        np.linalg.cholesky(state.covariance[0][np.ix_(rows, rows)])
    except np.linalg.LinAlgError:
        return False
    return True


def temper_first_state(state: State, share: float, settings: TrackerSettings) -> State:
    """Return one person's first state after a share of its frame's information, from the prior of a new body."""
    n, h = settings.tree.n_pose, settings.tree.n_shape
    rows = free_columns(n, h, bool(state.free[0]))
    m = len(rows) - n
    at, pose = np.ix_(rows, rows), rows[:m]
    initial = initial_covariance(settings.tree, settings.tree.shape_covariance, settings.options.motion)
    state = select_states(state, [0])
    block = state.covariance[0][at]
    prior = np.linalg.inv(initial[np.ix_(pose, pose)])
    wider = np.linalg.inv((1.0 - share) * prior + share * np.linalg.inv(block[:m, :m]))
    gain = np.linalg.solve(block[:m, :m], block[:m])
    state.covariance[0][at] = block + gain.T @ (wider - block[:m, :m]) @ gain
    return state


def temper_next_state(
    state: State,
    dt_s: float,
    filtered: State,
    curvature: np.ndarray,
    gradient: np.ndarray,
    share: float,
    settings: TrackerSettings,
) -> State:
    """Return one person's next state after another share of a frame's information.

    Args:
        state: State in the frame before; it is not changed.
        dt_s: Time since then, in seconds.
        filtered: State that the filter found in this frame.
        curvature: shape (pose + shape, pose + shape): information of the frame, see :class:`FrameInformation`.
        gradient: shape (pose + shape,): likewise.
        share: Share of the information that the filter used; 1 gives the filter's result.
        settings: Settings of the tracker.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    now = predict_states(select_states(state, [0]), np.array([dt_s]), settings)
    was_free, is_free = bool(state.free[0]), bool(filtered.free[0])
    if was_free and not is_free:
        _fix_shape(now, filtered.shape[0])
    elif not is_free:
        now.shape[0] = filtered.shape[0]
    # The information is in the axes of the filter's bones, which differ from those of this state.
    turn = bone_axes(now, filtered, settings)[0]
    rows = free_columns(n, h, was_free and is_free)
    _apply_information(
        now, filtered, share * (turn.T @ curvature @ turn), share * (turn.T @ gradient), rows, len(rows) - n
    )
    if is_free and not was_free:
        _free_shape(now, filtered)
    return now


def observe_pose(state: State, other: State, settings: TrackerSettings) -> None:
    """Update a state of one person, in place, by the pose of another state as an observation with its covariance."""
    n, h = settings.tree.n_pose, settings.tree.n_shape
    turn = bone_axes(state, other, settings)[0, :n, :n]
    curvature = turn.T @ np.linalg.inv(other.covariance[0, :n, :n]) @ turn
    _apply_information(state, other, curvature, np.zeros(n), free_columns(n, h, bool(state.free[0])), n)


def update_pose(state: State, curvature: np.ndarray, gradient: np.ndarray, settings: TrackerSettings) -> None:
    """Update a state of one person, in place, by information about the pose.

    Args:
        state: State of one person.
        curvature: shape (pose, pose): of the negative log likelihood.
        gradient: shape (pose,): of the log likelihood, at the state.
        settings: Settings of the tracker.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    _apply_information(
        state, select_states(state, [0]), curvature, gradient, free_columns(n, h, bool(state.free[0])), n
    )


def update_lengths(state: State, curvature: np.ndarray, gradient: np.ndarray, settings: TrackerSettings) -> None:
    """Update a state of one person, in place, by information about bone lengths that are not fixed.

    Args:
        state: State of one person; the pose changes as far as it is correlated with the lengths.
        curvature: shape (shape, shape): of the negative log likelihood of the lengths.
        gradient: shape (shape,): of the log likelihood, at the state.
        settings: Settings of the tracker.
    """
    n, h = settings.tree.n_pose, settings.tree.n_shape
    whole, pull = np.zeros((n + h, n + h)), np.zeros(n + h)
    whole[n:, n:], pull[n:] = curvature, gradient
    _apply_information(state, select_states(state, [0]), whole, pull, free_columns(n, h, free=True), n + h)


def bone_axes(state: State, other: State, settings: TrackerSettings) -> np.ndarray:
    """Return the rotations from changes in the axes of one state to those of another, whose bones have other frames.

    Args:
        state: State with one entry per frame.
        other: State with one entry per frame.
        settings: Settings of the tracker.

    Returns:
        Rotations of pose and shape, shape (frame, pose + shape, pose + shape).
    """
    n, first = settings.tree.n_pose, 3 + 3 * len(settings.tree.segments)
    frames = np.arange(len(state.root))
    change = np.zeros((len(frames), state.covariance.shape[1]))
    compare_states(state, other, change)
    change[:, :first] = 0.0
    change[:, n:] = 0.0
    moved = select_states(state, frames)
    apply_changes(change, moved)
    turn = np.tile(np.eye(n + settings.tree.n_shape), (len(frames), 1, 1))
    columns = np.arange(first, n).reshape(-1, 2)
    between = other.bones.transpose(0, 1, 3, 2) @ moved.bones
    turn[:, columns[:, :, None], columns[:, None]] = between[:, :, :2, :2]
    return turn


def _apply_information(
    now: State, at: State, curvature: np.ndarray, gradient: np.ndarray, rows: np.ndarray, m: int
) -> None:
    """Update a state, in place, by information that is linearized at another state."""
    change = np.empty((1, now.covariance.shape[1]))
    compare_states(now, at, change)
    block = np.ix_(rows, rows)
    covariance = now.covariance[0][block]
    curvature, pull = curvature[:m, :m], gradient[:m] + curvature[:m, :m] @ change[0, :m]
    # (1 / curvature + P)^-1, where the curvature need not have an inverse.
    inner = np.linalg.solve(np.eye(m) + curvature @ covariance[:m, :m], curvature)
    inner = 0.5 * (inner + inner.T)
    step = np.zeros((1, now.covariance.shape[1]))
    step[0, rows] = covariance[:, :m] @ (pull - inner @ (covariance[:m, :m] @ pull))
    apply_changes(step, now)
    left = covariance - covariance[:, :m] @ inner @ covariance[:m]
    # Asymmetry from rounding would grow from frame to frame.
    now.covariance[0][block] = 0.5 * (left + left.T)


def _fix_shape(state: State, shape_m: np.ndarray) -> None:
    """Fix the shape of one person, in place."""
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


def _free_shape(state: State, filtered: State) -> None:
    """Free the shape of one person, in place, with the uncertainty that the filter gave it."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    shape = slice(n, n + h)
    state.shape[0] = filtered.shape[0]
    state.covariance[0, shape, shape] = filtered.covariance[0, shape, shape]
    state.free[0] = filtered.free[0]
