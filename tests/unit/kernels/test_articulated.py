"""Articulated bodies: derivatives, small systems, and the filter against dense textbook formulas."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.arrays import kernel_array
from posefuse.kernels.linear_algebra import rotations, symmetric
from posefuse.kernels.tracking import body_kinematics, update
from posefuse.kernels.tracking.error_model import ErrorModel
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import (
    UNOBSERVED,
    USED,
    AssignedDetections,
    Body,
    MotionModel,
    Pose,
    State,
    UpdateResults,
)
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.skeleton.trees import Tree
from posefuse.synthetic.rigs import build_rig
from tests.kernels import from_python

TREE = shipped_skeleton("halpe_26").tree
assert TREE is not None

locate = from_python(body_kinematics.locate_nodes)
differentiate = from_python(body_kinematics.node_jacobian)
move = from_python(body_kinematics.apply_increment)


def body_of(tree: Tree) -> Body:
    return Body(*tree.packed, tree.keypoint_nodes, *tree.packed_limits)


def pose(rng: np.random.Generator, tree: Tree) -> Pose:
    turns = Rotation.random(len(tree.segments), rng=rng).as_matrix()
    bones = Rotation.random(len(tree.bones), rng=rng).as_matrix()
    return Pose(rng.normal(size=3), turns, bones, tree.shape_m * rng.uniform(0.9, 1.1, tree.n_shape))


def points_of(tree: Tree, root, turns, bones, shape) -> np.ndarray:
    points = np.empty((len(tree.nodes), 3))
    locate(body_of(tree), Pose(root, turns, bones, shape), points)
    return points


def moved_points(tree: Tree, state: tuple[np.ndarray, ...], change: np.ndarray) -> np.ndarray:
    root, turns, bones, shape = (each.copy() for each in state)
    move(change[: tree.n_pose], root, turns, bones)
    return points_of(tree, root, turns, bones, shape + change[tree.n_pose :])


def test_jacobian_is_the_derivative(rng):
    state = pose(rng, TREE)
    jacobian = np.empty((len(TREE.nodes), 3, TREE.n_pose + TREE.n_shape))
    differentiate(body_of(TREE), state, TREE.n_pose, jacobian)
    for c in range(jacobian.shape[2]):
        step = np.zeros(jacobian.shape[2])
        step[c] = 1e-6
        change = (moved_points(TREE, state, step) - moved_points(TREE, state, -step)) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, c], change, atol=1e-8)


def test_only_listed_columns_move_a_node(rng):
    jacobian = np.empty((len(TREE.nodes), 3, TREE.n_pose + TREE.n_shape))
    differentiate(body_of(TREE), pose(rng, TREE), TREE.n_pose, jacobian)
    starts, columns = TREE.packed[6:]
    for n in range(len(TREE.nodes)):
        others = np.setdiff1d(np.arange(jacobian.shape[2]), columns[starts[n] : starts[n + 1]])
        assert np.abs(jacobian[n][:, others]).max() == 0.0


def test_rotation_about_a_bone_has_no_effect(rng):
    root, turns, bones, shape = pose(rng, TREE)
    before = points_of(TREE, root, turns, bones, shape)
    twisted = bones @ Rotation.from_euler("z", rng.uniform(-3, 3, (len(bones), 1))).as_matrix()
    np.testing.assert_allclose(points_of(TREE, root, turns, twisted, shape), before, atol=1e-12)


def test_rotation_logarithm_inverts_the_exponential(rng):
    turn, between = from_python(rotations.rotate), from_python(rotations.rotation_between)
    for _ in range(20):
        start = Rotation.random(rng=rng).as_matrix()
        by = rng.normal(size=3)
        by *= rng.uniform(1e-8, 3.0) / np.linalg.norm(by)
        end = start.copy()
        turn(end, *by)
        np.testing.assert_allclose(end, start @ Rotation.from_rotvec(by).as_matrix(), atol=1e-12)
        np.testing.assert_allclose(between(start, end), by, atol=1e-7)


@pytest.mark.parametrize("n", [1, 7, 40])
def test_symmetric_systems_are_solved_and_inverted(n, rng):
    factor, invert, solve = (
        from_python(each) for each in (symmetric.cholesky, symmetric.invert, symmetric.cholesky_solve)
    )
    half, units = rng.normal(size=(n, n + 2)), np.geomspace(1e-4, 1e4, n)
    matrix, vector = units[:, None] * (half @ half.T) * units, rng.normal(size=n) * units
    lower, inverse, found = matrix.copy(), np.tril(matrix), vector.copy()
    assert factor(lower, n)
    solve(lower, n, found)
    np.testing.assert_allclose(
        found * units, np.linalg.solve(matrix / np.outer(units, units), vector / units), rtol=1e-6
    )
    assert invert(inverse, n, np.full(2 * n, np.nan))
    np.testing.assert_allclose(inverse * np.outer(units, units), np.linalg.inv(half @ half.T), rtol=1e-6, atol=1e-9)
    assert not factor(-matrix, n)
    assert not invert(-matrix, n, np.empty(2 * n))


def people(tree: Tree, rng: np.random.Generator, spread: float) -> State:
    """One person standing, with a random covariance of everything."""
    n = tree.n_pose
    size = 2 * n + tree.n_shape
    half = spread * rng.normal(size=(size, 2 * size)) / np.sqrt(2 * size)
    root = np.array([[0.1, -0.2, 0.9]])
    turns = np.tile(np.eye(3), (1, len(tree.segments), 1, 1))
    bones = np.tile(np.diag([1.0, -1.0, -1.0]), (1, len(tree.bones), 1, 1))
    covariance = (half @ half.T)[None].copy()
    return State(
        root, turns, bones, tree.shape_m[None].copy(), np.zeros((1, n)), covariance, np.ones(1, dtype=np.int64)
    )


def test_prediction_matches_the_linear_formula(rng):
    state = people(TREE, rng, 0.1)
    n, h = TREE.n_pose, TREE.n_shape
    state.velocity[0] = 0.01 * rng.normal(size=n)
    decay, power, dt, walk = rng.uniform(0.2, 2.0, n), rng.uniform(0.5, 2.0, n), 0.04, 1e-4
    fade, reach = np.exp(-dt / decay), decay * (1 - np.exp(-dt / decay))
    transition = np.eye(2 * n + h)
    transition[:n, n + h :] = np.diag(reach)
    transition[n + h :, n + h :] = np.diag(fade)
    steps = (np.arange(2000) + 0.5) / 2000 * dt
    left = decay[:, None] * (1 - np.exp(-(dt - steps) / decay[:, None]))
    rest = np.exp(-(dt - steps) / decay[:, None])
    noise = np.zeros_like(transition)
    noise[:n, :n] = np.diag(power * (left**2).mean(axis=1) * dt)
    noise[:n, n + h :] = noise[n + h :, :n] = np.diag(power * (left * rest).mean(axis=1) * dt)
    noise[n + h :, n + h :] = np.diag(power * (rest**2).mean(axis=1) * dt)
    noise[n : n + h, n : n + h] = walk * dt * np.eye(h)
    expected = transition @ state.covariance[0] @ transition.T + noise
    change = np.concatenate([reach * state.velocity[0], np.zeros(h)])
    before = (state.root[0], state.turns[0], state.bones[0], state.shape[0])
    there = moved_points(TREE, before, change)
    velocity = fade * state.velocity[0]
    predict_people(np.array([dt]), MotionModel(decay, power, np.full(n, np.inf), walk), state)
    np.testing.assert_allclose(state.covariance[0], expected, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(state.velocity[0], velocity)
    np.testing.assert_allclose(points_of(TREE, *(each[0] for each in state[:4])), there, atol=1e-12)


def seen_by(rig, points: np.ndarray) -> np.ndarray:
    return np.stack([camera.project(points)[0] for camera in rig.cameras])


@pytest.mark.parametrize("lens", ["pinhole", "barrel", "fisheye"])
def test_update_matches_the_kalman_formula_for_a_linear_problem(lens, rng):
    rig = build_rig(n_cameras=4, lens=lens)
    state = people(TREE, rng, 1e-3)
    n, h, keypoints = TREE.n_pose, TREE.n_shape, len(TREE.keypoint_nodes)
    before = tuple(each[0].copy() for each in state[:4])
    prior = state.covariance[0].copy()
    predicted = seen_by(rig, points_of(TREE, *before)[TREE.keypoint_nodes])
    pixels = predicted + 0.1 * rng.normal(size=predicted.shape)
    law = ErrorModel(np.full(4, 2.0), 0.0, 0.0, 1e9, 1e9, 1e9, 0.0)
    labels = np.tile(np.arange(keypoints), (1, 4, 1))
    use = np.empty((1, 4, keypoints), dtype=np.int64)
    moved, surprise = np.empty(1), np.empty(1)
    update.update_people(
        rig.packed,
        body_of(TREE),
        law,
        AssignedDetections(np.arange(4)[None], labels, kernel_array(pixels), kernel_array(np.ones((4, keypoints)))),
        np.ones(1),
        3,
        state,
        UpdateResults(use, moved, surprise),
    )
    assert (use == USED).all()
    jacobian = np.zeros((pixels.size, 2 * n + h))
    for c in range(n + h):
        step = np.zeros(n + h)
        step[c] = 1e-6
        ahead, behind = (seen_by(rig, moved_points(TREE, before, sign * step)[TREE.keypoint_nodes]) for sign in (1, -1))
        jacobian[:, c] = ((ahead - behind) / 2e-6).ravel()
    gain = prior @ jacobian.T @ np.linalg.inv(jacobian @ prior @ jacobian.T + 4.0 * np.eye(len(jacobian)))
    spread = jacobian @ prior @ jacobian.T + 4.0 * np.eye(len(jacobian))
    off = (pixels - predicted).reshape(-1, 2)
    by_keypoint = [
        off[i] @ np.linalg.inv(spread[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]) @ off[i] for i in range(len(off))
    ]
    assert surprise[0] == pytest.approx(sum(by_keypoint), rel=1e-4)
    change = gain @ (pixels - predicted).ravel()
    np.testing.assert_allclose(state.covariance[0], prior - gain @ jacobian @ prior, rtol=1e-3, atol=1e-11)
    np.testing.assert_allclose(state.velocity[0], change[n + h :], rtol=1e-2, atol=2e-7)
    np.testing.assert_allclose(
        points_of(TREE, *(each[0] for each in state[:4])), moved_points(TREE, before, change[: n + h]), atol=1e-6
    )


def test_joint_limits_correct_violations(rng):
    """A hyperextended knee and an overtwisted trunk without observations return to their limits; nothing else moves."""
    state = people(TREE, rng, 1e-9)
    n = TREE.n_pose
    state.covariance[0] = 0.1 * np.eye(len(state.covariance[0]))
    knee, ankle = TREE.bones.index("left_knee"), TREE.bones.index("left_ankle")
    state.bones[0, ankle] = Rotation.from_euler("y", -40, degrees=True).as_matrix() @ state.bones[0, knee]
    state.turns[0, 1] = Rotation.from_euler("z", 100, degrees=True).as_matrix()
    before = tuple(each.copy() for each in state)
    keypoints = len(TREE.keypoint_nodes)
    law = ErrorModel(np.full(1, 2.0), 0.0, 0.0, 3.0, 50.0, 0.05, 0.0)
    rig = build_rig(n_cameras=1)
    for _ in range(3):
        labels, pixels = np.zeros((1, 1, keypoints), int), np.empty((0, keypoints, 2))
        none = AssignedDetections(
            np.full((1, 1), -1), labels, kernel_array(pixels), kernel_array(np.empty((0, keypoints)))
        )
        out = UpdateResults(np.empty((1, 1, keypoints), np.int64), np.empty(1), np.empty(1))
        update.update_people(rig.packed, body_of(TREE), law, none, np.ones(1), 5, state, out)
    thigh, shank, across = state.bones[0, knee, :, 2], state.bones[0, ankle, :, 2], state.turns[0, 0, :, 1]
    assert np.cross(before[2][0, knee, :, 2], before[2][0, ankle, :, 2]) @ before[1][0, 0, :, 1] < -0.5
    assert np.cross(thigh, shank) @ across > -0.2
    assert state.turns[0, 1, :, 1] @ across > np.cos(np.radians(80.0))
    np.testing.assert_allclose(state.root, before[0], atol=1e-9)
    right = TREE.bones.index("right_knee")
    np.testing.assert_allclose(state.bones[0, right], before[2][0, right], atol=1e-9)
    assert n == 34


def test_indefinite_covariance_is_reported_and_ignored(rng):
    rig = build_rig(n_cameras=2)
    state, keypoints = people(TREE, rng, 0.1), len(TREE.keypoint_nodes)
    state.covariance[0, 5, 5] = -1.0
    use = np.zeros((1, 2, keypoints), dtype=np.int64)
    moved, surprise = np.zeros(1), np.zeros(1)
    law = ErrorModel(np.full(2, 2.0), 0.0, 0.0, 1e9, 1e9, 1e9, 0.0)
    labels = np.tile(np.arange(keypoints), (1, 2, 1))
    nothing = kernel_array(np.zeros((2, keypoints, 2)))
    detections = AssignedDetections(np.arange(2)[None], labels, nothing, kernel_array(np.ones((2, keypoints))))
    out = UpdateResults(use, moved, surprise)
    update.update_people(rig.packed, body_of(TREE), law, detections, np.ones(1), 3, state, out)
    assert (use == UNOBSERVED).all()
    assert np.isnan([moved[0], surprise[0], *state.root[0]]).all()


@pytest.mark.parametrize("m", [1, 3, 4, 7, 28])
def test_products_match_matrix_products(m, rng):
    multiply, subtract = (from_python(each) for each in (symmetric.multiply, symmetric.subtract_symmetric_product))
    left, right, out = rng.normal(size=(m + 2, m + 1)), rng.normal(size=(m + 1, m + 1)), np.empty((m, m + 1))
    multiply(left, 2, right, m, m, out)
    np.testing.assert_allclose(out[:, :m], left[2:, :m] @ right[:m, :m], atol=1e-12)
    first = m + 1
    half, gain = rng.normal(size=(m, m)), rng.normal(size=(m, m))
    whole = rng.normal(size=(first + m, first + m))
    whole[first:, :m] = gain @ (half + half.T)
    whole[first:, first:] += whole[first:, first:].T
    expected = whole[first:, first:] - whole[first:, :m] @ gain.T
    subtract(whole, first, gain, m, m)
    np.testing.assert_allclose(whole[first:, first:], expected, atol=1e-10)
