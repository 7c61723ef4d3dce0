"""Lenses of the joint estimate: distortion is inverted, and derivatives agree with differences."""

import numpy as np
import pytest

from posefuse.calibration.joint.parameters import JointParameters, difference
from posefuse.kernels.calibration.joint import FOCAL, PRINCIPAL, RADIAL, joint_rows

N_VIEWS = 3


def parameters(log_focal: float, radial: float, principal: tuple[float, float] = (0.0, 0.0)) -> JointParameters:
    still = np.zeros(N_VIEWS)
    center = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    lens = still + log_focal, still + radial, np.tile(principal, (N_VIEWS, 1))
    return JointParameters(np.tile(np.eye(3), (N_VIEWS, 1, 1)), center, still, still, *lens)


@pytest.mark.parametrize("radial", [-0.28, 0.0, 0.2])
def test_lens_is_inverted(radial):
    exact = np.random.default_rng(1).uniform(-0.5, 0.5, (20, N_VIEWS, 2))
    squared = np.square(exact).sum(axis=-1, keepdims=True)
    seen = 1.2 * exact * (1.0 + radial * squared) + np.array([0.03, -0.02])
    xy, sigma = parameters(np.log(1.2), radial, (0.03, -0.02)).without_lens(seen, np.ones((20, N_VIEWS)))
    np.testing.assert_allclose(xy, exact, atol=1e-9)
    steep, ratio = 1.0 + 3.0 * radial * squared[..., 0], 1.0 + radial * squared[..., 0]
    np.testing.assert_allclose(sigma, 1.0 / (1.2 * np.sqrt(steep * ratio)))


def test_coordinates_beyond_the_fold_are_missing():
    seen = np.full((1, N_VIEWS, 2), 0.9)
    xy, sigma = parameters(0.0, -0.3).without_lens(seen, np.ones((1, N_VIEWS)))
    assert np.isnan(xy).all()
    assert not sigma.any()
    assert seen.min() == 0.9, "the recording is unchanged"


def test_derivatives_by_the_lens_agree_with_differences():
    rng = np.random.default_rng(2)
    seen = rng.uniform(-0.4, 0.4, (10, N_VIEWS, 2))
    points = rng.uniform(-0.5, 0.5, (10, 3)) + np.array([0.0, 0.0, 3.0])
    middle = parameters(0.1, -0.2, (0.02, -0.01))
    rows = by_view(middle, seen, points)[1]
    for column in (FOCAL, RADIAL, PRINCIPAL, PRINCIPAL + 1):
        change = np.zeros((N_VIEWS, middle.size))
        change[:, column] = 1e-6
        ends = [by_view(middle.changed(sign * change), seen, points)[0] for sign in (-1.0, 1.0)]
        # The derivative is taken at the projection, which the observation equals up to its error.
        np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, rows[..., column], atol=1e-4)
        np.testing.assert_allclose(difference(middle, middle.changed(change)), change, atol=1e-12)


def by_view(at: JointParameters, seen: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals of the same points, and the derivatives where the projections are the observations."""
    n = len(points)
    xy, sigma = at.without_lens(seen, np.ones((n, N_VIEWS)))
    residual, by_point = np.empty((n, N_VIEWS, 2)), np.empty((n, N_VIEWS, 2, 3))
    out = np.empty((n, N_VIEWS, 2, at.size))
    for k in range(n):
        for v in range(N_VIEWS):
            ray = np.append(xy[k, v], 1.0) * 3.0 + at.center_m[v]
            one = (xy[k : k + 1], sigma[k : k + 1], (at.rotation, at.center_m, at.lens), ray[None])
            parts = (np.empty((1, N_VIEWS, 2)), np.empty((1, N_VIEWS, 2, at.size)), np.empty((1, N_VIEWS, 2, 3)))
            joint_rows(*one, (np.zeros((1, 3)), np.zeros(1)), *parts)
            out[k, v] = parts[1][0, v]
    joint_rows(
        xy,
        np.ones((n, N_VIEWS)),
        (at.rotation, at.center_m, at.lens),
        points,
        (np.zeros((n, 3)), np.zeros(n)),
        residual,
        np.empty_like(out),
        by_point,
    )
    return residual, out * sigma[..., None, None]
