"""Poses fitted to all detections at once: equations, solution, and accuracy."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.kernels.tracking.path_errors import Innovations, weigh_errors, weigh_lasting_errors
from posefuse.kernels.tracking.path_solve import PathFactor, factor_path, invert_path, solve_path
from posefuse.kernels.tracking.path_terms import LinearObservations, PathSystem, move_poses
from posefuse.kernels.tracking.records import State
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.path_fit import PathDetections, PathFit, PathMotion, reduce_to_lengths
from posefuse.tracking.settings import TrackerSettings

FRAMES, DT_S = 5, 0.04
SKELETON = shipped_skeleton("body_20")
LASTING_SHARE = 0.8
"""Correlation time of weighted errors over that of the errors."""


def random_system(rng: np.random.Generator, frames: int, m: int) -> tuple[PathSystem, np.ndarray]:
    """Return a positive definite system and its dense matrix."""
    blocks = rng.normal(size=(2, frames, m, m))
    own = blocks[0] @ blocks[0].transpose(0, 2, 1) + 6.0 * m * np.eye(m)
    second = rng.normal(size=(frames, m))
    dense = np.zeros((frames * m, frames * m))
    for t in range(frames):
        dense[t * m : (t + 1) * m, t * m : (t + 1) * m] = own[t]
    for t in range(1, frames):
        for ahead, block in ((1, blocks[1, t]), (2, np.diag(second[t]))):
            if t >= ahead:
                rows, columns = slice(t * m, (t + 1) * m), slice((t - ahead) * m, (t - ahead + 1) * m)
                dense[rows, columns], dense[columns, rows] = block, block.T
    return PathSystem(own, blocks[1].copy(), second, np.zeros((frames, m))), dense


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
def test_band_systems_are_solved_and_inverted(frames, rng):
    m = 4
    system, dense = random_system(rng, frames, m)
    factor = PathFactor(*(np.empty((frames, m, m)) for _ in range(3)))
    assert factor_path(system, factor, np.empty(2 * m)) == frames
    right = rng.normal(size=(frames, m, 3))
    actual = right.copy()
    solve_path(factor, actual, np.empty((m, 3)))
    expected = np.linalg.solve(dense, right.reshape(-1, 3)).reshape(right.shape)
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-12)
    blocks = [np.empty((frames, m, m)) for _ in range(3)]
    invert_path(factor, *blocks)
    inverse = np.linalg.inv(dense).reshape(frames, m, frames, m)
    for ahead, block in enumerate(blocks):
        for t in range(frames - ahead):
            np.testing.assert_allclose(block[t], inverse[t + ahead, :, t], rtol=1e-9, atol=1e-12)


def test_indefinite_system_is_not_factored(rng):
    system, _ = random_system(rng, 3, 4)
    system.diagonal[1] *= -1.0
    assert factor_path(system, PathFactor(*(np.empty((3, 4, 4)) for _ in range(3))), np.empty(8)) == 1


@pytest.fixture
def settings() -> TrackerSettings:
    rig = build_rig("ring", 3, "pinhole", radius_m=4.0)
    # Gaussian errors without a floor, so that all weights are 1, and no joint limits, which the random poses violate.
    options = replace(TrackerOptions(), nu=1e12, model_floor_m=0.0, limit_sigma=1e6)
    return TrackerSettings.of(rig, SKELETON, NoiseModel(np.full(3, 5.0), 0.0), options)


def moving(settings: TrackerSettings, rng: np.random.Generator, frames: int = FRAMES, size: float = 0.05) -> State:
    """Return states of one body that moves at random."""
    tree = settings.tree
    turns, bones = (np.tile(np.eye(3), (1, len(each), 1, 1)) for each in (tree.segments, tree.bones))
    one = State(
        np.array([[0.1, 0.2, 1.0]]), turns, bones, tree.shape_m[None].copy(), np.zeros((1, tree.n_pose)),
        np.zeros((1, tree.n_pose, tree.n_pose)), np.zeros(1, dtype=np.int64),
    )  # fmt: skip
    states = select_states(one, np.zeros(frames, dtype=int))
    change = size * np.cumsum(rng.normal(size=(frames, tree.n_pose)), axis=0)
    move_poses(change, states)
    return states


def fit_of(settings: TrackerSettings, states: State, rng: np.random.Generator, sd_px: float) -> PathFit:
    """Return a fit that begins at the states and sees them with white errors."""
    pixels = ProjectedBodies.of(states, settings.cameras, settings.node_body).pixels
    pixels = pixels + sd_px * rng.normal(size=pixels.shape)
    variance = np.full(pixels.shape[:3], 25.0)
    times = DT_S * np.arange(len(states.root))
    return PathFit(states, PathDetections(times, pixels, variance), settings)


def still(settings: TrackerSettings) -> PathMotion:
    """Return motion so wild that it says nothing."""
    return PathMotion(settings.decay_s, np.full(settings.tree.n_pose, 1e12))


def point_jacobian(fit: PathFit) -> np.ndarray:
    """Return the derivatives of the keypoints, shape (frame, keypoint, 3, pose + shape): those of all their offsets."""
    settings, offsets = fit.settings, fit.linear.offsets
    body, tree = settings.node_body, settings.tree
    columns = fit._scratch.columns
    nodes = np.zeros((*offsets.shape[:3], tree.n_pose + tree.n_shape))
    for node, parent in enumerate(body.parents):
        if parent >= 0:
            nodes[:, node] = nodes[:, parent]
        for place, column in enumerate(columns[node]):
            if column >= 0:
                nodes[:, node, :, column] += offsets[:, node, :, place]
    return nodes[:, body.keypoint_nodes]


def lasting_covariance(settings: TrackerSettings, inflation: float) -> np.ndarray:
    """Return the covariance of the errors of a keypoint in a view for uncertainties, shape (frame, frame)."""
    correlation = np.exp(-DT_S / (LASTING_SHARE * settings.options.smoother_error_memory_s))
    return inflation * 25.0 * correlation ** np.abs(np.subtract.outer(np.arange(FRAMES), np.arange(FRAMES)))


def test_equations_are_those_of_correlated_errors(settings, rng):
    """The matrix is J^T C^-1 J and the gradient J^T C^-1 r, with the covariance C of autoregressive errors."""
    fit = fit_of(settings, moving(settings, rng), rng, sd_px=3.0)
    fit.linearize()
    n, linear = settings.tree.n_pose, fit.linear
    system = fit.equations(still(settings), n, 1.5)
    bare = PathSystem(*(np.zeros_like(each) for each in system))
    fit.add_priors(still(settings), bare)
    covariance = lasting_covariance(settings, 1.5)
    rows = np.einsum("fvkax,fkxp->fvkap", linear.rows, point_jacobian(fit)[..., :n])
    whitened = np.einsum("fg,gvka->fvka", np.linalg.inv(covariance), linear.residual_px)
    gradient = np.einsum("fvkap,fvka->fp", rows, whitened)
    np.testing.assert_allclose(system.gradient - bare.gradient, gradient, rtol=1e-6, atol=1e-6)
    full = np.einsum("fvkap,gvkaq,fg->fpgq", rows, rows, np.linalg.inv(covariance))
    for f in range(FRAMES):
        actual = np.tril(system.diagonal[f] - bare.diagonal[f])
        np.testing.assert_allclose(actual, np.tril(full[f, :, f]), rtol=1e-6, atol=1e-5)
        if f:
            np.testing.assert_allclose(system.next[f] - bare.next[f], full[f, :, f - 1], rtol=1e-6, atol=1e-5)


def test_joint_covariances_are_those_of_all_poses_and_lengths(settings, rng):
    """They are blocks of the inverse of the dense matrix of all poses and of the lengths."""
    fit = fit_of(settings, moving(settings, rng), rng, sd_px=3.0)
    fit.linearize()
    n, h, linear = settings.tree.n_pose, settings.tree.n_shape, fit.linear
    bare = PathSystem(
        np.zeros((FRAMES, n, n)), np.zeros((FRAMES, n, n)), np.zeros((FRAMES, n)), np.zeros((FRAMES, n))
    )  # fmt: skip
    fit.add_priors(still(settings), bare)
    rows = np.einsum("fvkax,fkxp->fvkap", linear.rows, point_jacobian(fit))
    jacobian = np.zeros((*rows.shape[:4], FRAMES * n + h))
    for f in range(FRAMES):
        jacobian[f, ..., f * n : (f + 1) * n] = rows[f, ..., :n]
    jacobian[..., FRAMES * n :] = rows[..., n:]
    information = np.linalg.inv(lasting_covariance(settings, 1.5))
    dense = np.einsum("fvkap,fg,gvkaq->pq", jacobian, information, jacobian, optimize=True)
    for f in range(FRAMES):
        own = np.tril(bare.diagonal[f])
        dense[f * n : (f + 1) * n, f * n : (f + 1) * n] += own + np.tril(own, -1).T
    prior = np.linalg.inv(settings.tree.shape_covariance)
    dense[FRAMES * n :, FRAMES * n :] += prior
    reduced = reduce_to_lengths(fit, still(settings), 1.5)
    assert reduced is not None
    lengths_m2 = np.linalg.inv(prior + reduced.lengths.curvature)
    actual = reduced.covariance(fit.covariances()[0], np.tile(lengths_m2, (FRAMES, 1, 1)))
    inverse = np.linalg.inv(dense)
    for f in range(FRAMES):
        chosen = np.r_[f * n : (f + 1) * n, FRAMES * n : FRAMES * n + h]
        np.testing.assert_allclose(actual[f], inverse[np.ix_(chosen, chosen)], rtol=1e-5, atol=1e-9)


def observed(precision: np.ndarray) -> LinearObservations:
    """Return detections of one keypoint in one view with these precisions, shape (frame,); 0 for a miss."""
    shape = (len(precision), 1, 1)
    size = precision.reshape(shape)
    return LinearObservations(
        np.zeros((*shape, 2)), np.zeros((*shape, 2, 3)), size, np.maximum(size, 1e-9), np.zeros(shape),
        np.zeros((len(precision), 1, 3, 1)),
    )  # fmt: skip


def information_of_a_constant(innovations: Innovations) -> float:
    """Return the information about a constant that all detections show."""
    return float(np.square(innovations.own - innovations.before).sum())


def lasting_information(precision: np.ndarray, correlation: float) -> float:
    """Return the information that detections with lasting errors have about a constant."""
    frames = len(precision)
    out = Innovations(*(np.empty((frames, 1, 1)) for _ in range(2)))
    links = np.where(np.arange(frames) > 0, correlation, 0.0)
    weigh_lasting_errors(observed(precision), links, 1.0, out)
    return information_of_a_constant(out)


@pytest.mark.no_jit
def test_misses_do_not_end_an_error_that_lasts(rng):
    """The information about a constant is 1^T C^-1 1, with the covariance C of the errors of what is detected."""
    correlation, frames = 0.93, 40
    seen = np.arange(frames) == 0
    seen |= rng.random(frames) < 0.7
    covariance = correlation ** np.abs(np.subtract.outer(np.flatnonzero(seen), np.flatnonzero(seen)))
    expected = np.linalg.inv(covariance).sum()
    assert lasting_information(seen.astype(float), correlation) == pytest.approx(expected)


@pytest.mark.no_jit
def test_outlier_is_no_information():
    """A detection with a tenth of the weight of the others must not tell their errors from the pose."""
    precision = np.ones(40)
    usual = lasting_information(precision, 0.93)
    precision[20] = 0.1
    assert lasting_information(precision, 0.93) < usual
    out = Innovations(*(np.empty((40, 1, 1)) for _ in range(2)))
    weigh_errors(observed(precision), np.where(np.arange(40) > 0, 0.93, 0.0), out)
    assert information_of_a_constant(out) > 1.5 * usual, "the innovations of estimates are no measure of uncertainty"


def test_derivatives_are_those_of_the_projection(settings, rng):
    fit = fit_of(settings, moving(settings, rng), rng, sd_px=3.0)
    fit.linearize()
    n, linear = settings.tree.n_pose, fit.linear
    before, rows = linear.residual_px.copy(), np.einsum("fvkax,fkxp->fvkap", linear.rows, point_jacobian(fit)[..., :n])
    step = 1e-6
    for p in range(n):
        change = np.zeros((FRAMES, n))
        change[:, p] = step
        moved = PathFit(fit.state, fit.detections, settings)
        assert moved.move(change)
        moved.linearize()
        actual = (before - moved.linear.residual_px) / step
        np.testing.assert_allclose(actual, rows[..., p], rtol=1e-3, atol=0.05)


def test_velocity_that_decays_is_no_deviation_from_the_motion():
    decay_s = np.array([0.3, 0.6])
    times = np.array([0.0, 0.04, 0.08, 0.14, 0.2])
    rows, information = PathMotion(decay_s, np.array([60.0, 5.0])).rows(times)
    middle = 0.5 * (times[1:] + times[:-1])
    change = np.diff(times)[:, None] * np.exp(-middle[:, None] / decay_s)
    positions = np.concatenate([np.zeros((1, 2)), np.cumsum(change, axis=0)])
    windows = np.stack([positions[a : a + 3] for a in range(3)])
    np.testing.assert_allclose(np.einsum("rap,rap->rp", rows, windows), 0.0, atol=1e-9)
    assert (information > 0.0).all()


def test_fit_returns_to_exact_detections(settings, rng):
    truth = moving(settings, rng)
    fit = fit_of(settings, truth, rng, sd_px=0.0)
    assert fit.move(0.05 * rng.normal(size=(FRAMES, settings.tree.n_pose)))
    assert fit.fit(still(settings))
    expected, actual = (
        ProjectedBodies.of(each, settings.cameras, settings.node_body).points_m for each in (truth, fit.state)
    )
    np.testing.assert_allclose(actual, expected, atol=2e-4)
