"""Kalman filter and smoother."""

import numpy as np
import pytest

from posefuse.model.options.postprocess import (
    KalmanOptions,
)
from posefuse.postprocess.kalman import smooth_kalman, tempering
from posefuse.postprocess.points import Clock

from .conftest import RATE_HZ, clock_of, points_of


def random_walk(rng: np.random.Generator, frames: int, points: int, acceleration: float) -> np.ndarray:
    """Return positions with white accelerations of a spectral density."""
    dt = 1 / RATE_HZ
    walk = acceleration * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    kicks = rng.multivariate_normal([0, 0], walk, size=(frames, points, 3))
    state = np.zeros((points, 3, 2))
    out = []
    for kick in kicks:
        state = np.stack([state[..., 0] + dt * state[..., 1], state[..., 1]], axis=-1) + kick
        out.append(state[..., 0])
    return np.stack(out)


def test_smoother_covariances_match_the_errors():
    rng = np.random.default_rng(5)
    truth = random_walk(rng, 150, 40, 20.0)
    sd = 0.01
    noisy = truth + sd * rng.normal(size=truth.shape)
    noisy[rng.random(truth.shape[:2]) < 0.2] = np.nan
    out = smooth_kalman(points_of(noisy, sd), clock_of(150), KalmanOptions(20.0, 0.0))
    inside = out.known
    error = (out.xyz_m - truth)[inside]
    variance = out.covariance_m2[inside][:, [0, 3, 5]]
    assert (error**2 / variance).mean() == pytest.approx(1.0, abs=0.06)
    assert error.std() < 0.75 * sd
    assert np.isfinite(out.covariance_m2[inside]).all()
    missing = inside & np.isnan(noisy[..., 0])
    assert out.covariance_m2[missing][:, 0].mean() > 1.5 * out.covariance_m2[inside & ~missing][:, 0].mean()


def test_smoother_equals_the_dense_solution():
    """Solve all positions and velocities as one Gaussian."""
    rng = np.random.default_rng(7)
    frames, sd, q = 12, 0.01, 20.0
    time = np.cumsum(rng.uniform(0.5, 1.5, frames)) / RATE_HZ
    z = rng.normal(size=(frames, 1, 3)) * 0.05
    z[4:6] = np.nan
    out = smooth_kalman(points_of(z, sd), Clock.of(time, None), KalmanOptions(q, 0.0))
    information, vector = np.zeros((2 * frames, 2 * frames)), np.zeros((2 * frames, 3))
    information[:2, :2] += np.diag([1.0, 1 / 25.0])
    vector[0] += z[0, 0]
    for f in range(frames - 1):
        dt = time[f + 1] - time[f]
        inverse = np.linalg.inv(q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
        step = np.hstack([-np.array([[1, dt], [0, 1]]), np.eye(2)])
        information[2 * f : 2 * f + 4, 2 * f : 2 * f + 4] += step.T @ inverse @ step
    for f in range(frames):
        if np.isfinite(z[f, 0, 0]):
            information[2 * f, 2 * f] += 1 / sd**2
            vector[2 * f] += z[f, 0] / sd**2
    covariance = np.linalg.inv(information)
    np.testing.assert_allclose(out.xyz_m[:, 0], (covariance @ vector)[::2], atol=1e-7)
    np.testing.assert_allclose(out.covariance_m2[:, 0, 0], np.diag(covariance)[::2], rtol=1e-6)
    np.testing.assert_allclose(out.covariance_m2[:, 0, [1, 2, 4]], 0.0, atol=1e-12)


def test_correlated_errors_have_less_weight():
    assert tempering(1 / 60, 0.0) == 1.0
    assert tempering(1.0, 0.001) == 1.0
    assert tempering(0.01, 1.0) == pytest.approx(200, rel=0.01)
