"""The share of errors that close keypoints have in common is recovered, and widens the covariance of the score."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from posefuse.calibration.joint.covariance import score_covariance
from posefuse.calibration.joint.equations import Rows
from posefuse.calibration.joint.noise_law import NoiseLaw
from posefuse.calibration.joint.similar_errors import error_mixing

SAMPLES, COLUMNS, VIEWS = 60, 24, 4


def rows_with(share: float, rng: np.random.Generator) -> tuple[Rows, np.ndarray]:
    """Return rows whose errors are similar within 0.18 of a body of 1 m, and their true correlation."""
    points = np.linspace(0.0, 1.0, COLUMNS)[:, None] * np.array([0.0, 0.0, 1.0])
    apart = np.abs(points[:, 2:] - points[:, 2])
    correlation = (1.0 - share) * np.eye(COLUMNS) + share * np.exp(-np.square(apart / 0.18))
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    errors = np.einsum("cd,tdvk->tcvk", root, rng.standard_normal((SAMPLES, COLUMNS, VIEWS, 2)))
    seen = np.ones((SAMPLES * COLUMNS, VIEWS), dtype=bool)
    rows = SimpleNamespace(
        points_m=np.tile(points, (SAMPLES, 1, 1)),
        seen=seen,
        scores=errors.reshape(-1, VIEWS, 2),
        time_s=10.0 * np.arange(SAMPLES),
        frames=np.arange(SAMPLES),
        n_views=VIEWS,
        leverage=lambda: np.zeros(seen.shape),
    )
    return cast("Rows", rows), correlation


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_share_of_similar_errors_is_recovered(rng, share):
    rows, correlation = rows_with(share, rng)
    mixing = error_mixing(rows, np.zeros(COLUMNS, dtype=int))
    assert mixing is not None
    assert mixing @ mixing.T == pytest.approx(correlation, abs=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_independent_errors_stay_independent(seed):
    rows, _ = rows_with(0.0, np.random.default_rng(seed))
    assert error_mixing(rows, np.zeros(COLUMNS, dtype=int)) is None


def test_errors_of_different_people_are_independent(rng):
    rows, _ = rows_with(0.7, rng)
    people = np.repeat([0, 1], COLUMNS // 2)
    mixing = error_mixing(rows, people)
    assert mixing is not None
    correlation = mixing @ mixing.T
    assert correlation[people == 0][:, people == 1] == pytest.approx(0.0, abs=1e-12)


def test_score_covariance_is_the_sum_over_similar_errors(rng):
    """At times far apart, the covariance is the sum over all pairs of columns of one view and coordinate."""
    rows, correlation = rows_with(0.5, rng)
    rays = rng.standard_normal((SAMPLES * COLUMNS, VIEWS, 2, 3))
    values, vectors = np.linalg.eigh(correlation)
    mixing = vectors * np.sqrt(np.maximum(values, 0.0))
    found = score_covariance(rays, rows, NoiseLaw(0.0, mixing))
    sd = np.sqrt(0.5 * np.square(rows.scores).sum(axis=-1).mean(axis=0))
    streams = (rays * sd[:, None, None]).reshape(SAMPLES, COLUMNS, -1, 3)
    expected = np.einsum("tcep,cd,tdeq->pq", streams, correlation, streams)
    assert found == pytest.approx(expected)
