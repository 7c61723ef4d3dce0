"""Matching detections to people."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from posefuse.kernels.records import Detections
from posefuse.kernels.tracking.error_model import ErrorModel
from posefuse.kernels.tracking.matching import keypoint_log_odds, match_views, score_detections
from posefuse.kernels.tracking.records import DetectionScores, MatchParameters, ProjectedKeypoints, SideGroups
from tests.kernels import from_python
from tests.properties import examples


def best_gain(scores: np.ndarray, least: float) -> float:
    """Match with SciPy, with one additional column per row."""
    own = np.full((len(scores), len(scores)), -1e9)
    np.fill_diagonal(own, least)
    gain = np.hstack([np.where(scores > least, scores, -1e9), own])
    return float(gain[linear_sum_assignment(gain, maximize=True)].sum())


@examples(60)
@given(st.integers(1, 6), st.integers(0, 7), st.integers(0, 5), st.integers(0, 10**6))
def test_matching_has_the_maximum_gain(people, first, second, seed):
    rng = np.random.default_rng(seed)
    scores = rng.normal(size=(people, first + second))
    scores[rng.random(scores.shape) < 0.2] = -np.inf
    views = np.repeat([0, 1], [first, second])
    rows = np.empty((people, 2), dtype=np.int64)
    match_views(scores, views, 2, 0.1, rows)
    for v in range(2):
        mine = np.flatnonzero(views == v)
        taken = rows[rows[:, v] >= 0, v]
        assert len(set(taken)) == len(taken)
        assert set(taken) <= set(mine)
        gained = sum(scores[p, rows[p, v]] if rows[p, v] >= 0 else 0.1 for p in range(people))
        np.testing.assert_allclose(gained, best_gain(scores[:, mine], 0.1))


@pytest.mark.parametrize("nu", [0.5, 2.5, 1e6])
def test_log_odds_are_bounded_below_and_exact_otherwise(nu):
    of_residual = from_python(keypoint_log_odds)
    uu, uv, vv, area, least = 9.0, 2.0, 16.0, 4e4, -3.0
    determinant = uu * vv - uv * uv
    found, told = [], []
    for du in np.geomspace(0.1, 1e5, 2000):
        squared = (vv * du * du - 2.0 * uv * du * 2.0 * du + uu * 4.0 * du * du) / determinant
        ratio = math.log(area / (2.0 * math.pi * math.sqrt(determinant))) - (nu / 2 + 1) * math.log1p(squared / nu)
        told.append(max(ratio, least))
        found.append(of_residual(du, 2.0 * du, uu, uv, vv, nu, area, least, math.exp(-least)))
    np.testing.assert_allclose(found, told, rtol=1e-9, atol=1e-9)
    assert found[0] > 0.0
    assert found[-1] == least


LEFT_RIGHT = SideGroups(np.array([0, 2, 1, 4, 3, 5]), np.array([-1, 0, 0, 1, 1, -1]), 2)
MIN_LOG_ODDS, MAX_KEYPOINTS, PEOPLE, VIEWS = -3.0, 4.0, 5, 2


def crowd_of(rng: np.random.Generator) -> tuple[ProjectedKeypoints, Detections]:
    """Return predicted people and their detections, near and far, some with missing or swapped keypoints."""
    keypoints = len(LEFT_RIGHT.mirror)
    pixels = rng.uniform(0.0, 1500.0, (PEOPLE, VIEWS, 1, 2)) + rng.normal(scale=60.0, size=(1, 1, keypoints, 2))
    sd = rng.uniform(2.0, 30.0, (PEOPLE, VIEWS, keypoints, 2))
    uv = rng.uniform(-0.9, 0.9, sd.shape[:-1]) * sd[..., 0] * sd[..., 1]
    covariance = np.stack([sd[..., 0] ** 2, uv, sd[..., 1] ** 2], axis=-1)
    nothing = np.empty((PEOPLE, keypoints, 3)), np.empty((PEOPLE, keypoints, 6))
    shown = pixels.transpose(1, 0, 2, 3) + rng.normal(scale=15.0, size=(VIEWS, PEOPLE, keypoints, 2))
    shown[:, 0] = shown[:, 0][:, LEFT_RIGHT.mirror]
    shown = shown.reshape(-1, keypoints, 2)
    shown[rng.random(shown.shape[:2]) < 0.15] = np.nan
    shown[-1] = np.nan
    pixels[1, 0, 2] = np.nan
    scale = rng.uniform(80.0, 200.0, pixels.shape[:-1])
    confidence = np.where(rng.random(shown.shape[:2]) < 0.1, np.nan, rng.uniform(0.02, 1.0, shown.shape[:2]))
    view = np.repeat(np.arange(VIEWS), PEOPLE)
    return ProjectedKeypoints(*nothing, pixels, covariance, scale), Detections(shown, confidence, view)


def scores_of(
    projected: ProjectedKeypoints, detections: Detections, law: ErrorModel, swap: np.ndarray, p: int, row: int
) -> tuple[float, np.ndarray]:
    """Return the score of a pair and the log odds of swapped limbs, keypoint by keypoint."""
    v = int(detections.view[row])

    def log_odds(k: int, label: int) -> float:
        trust = detections.confidence[row, label]
        if trust < law.min_confidence:
            return math.nan
        noise = (law.scale_px[v] * max(1.0 if math.isnan(trust) else trust, 0.05) ** -law.exponent) ** 2
        noise += (law.floor_m * projected.scale_px_per_m[p, v, k]) ** 2
        uu, uv, vv = projected.pixel_covariance[p, v, k] + np.array([noise, 0.0, noise])
        covariance = np.array([[uu, uv], [uv, vv]])
        off = detections.keypoints_px[row, label] - projected.pixels[p, v, k]
        squared = off @ np.linalg.solve(covariance, off)
        density = projected.scale_px_per_m[p, v, k] ** 2 / (2.0 * math.pi * math.sqrt(np.linalg.det(covariance)))
        ratio = math.log(density) - (1.0 + law.nu / 2.0) * math.log1p(squared / law.nu)
        return ratio if math.isnan(ratio) else max(ratio, MIN_LOG_ODDS)

    plain = np.array([log_odds(k, k) for k in range(len(LEFT_RIGHT.mirror))])
    mirrored = np.array([log_odds(k, int(label)) for k, label in enumerate(LEFT_RIGHT.mirror)])
    total, odds = np.nansum(plain[LEFT_RIGHT.group_of < 0]), np.empty(LEFT_RIGHT.n_groups)
    for g in range(LEFT_RIGHT.n_groups):
        own = LEFT_RIGHT.group_of == g
        odds[g] = np.nansum(mirrored[own]) - np.nansum(plain[own]) + math.log(swap[p, v, g] / (1.0 - swap[p, v, g]))
        total += np.nansum((mirrored if odds[g] > 0.0 else plain)[own])
    count = int(np.isfinite(plain).sum())
    return (total / count * min(count, MAX_KEYPOINTS) if count else -math.inf), odds


@pytest.mark.no_jit
@pytest.mark.parametrize("nu", [1.5, 2.5, 3.0, 1e6])
@pytest.mark.parametrize("seed", range(6))
def test_pairs_that_count_have_the_score_of_all_keypoints(nu, seed):
    """Screening changes nothing where the score reaches the least one that counts, and gives -inf only below it."""
    rng = np.random.default_rng(seed)
    projected, detections = crowd_of(rng)
    law = ErrorModel(np.array([6.0, 9.0]), 1.0, 0.015, nu, 60.0, 0.1, 0.05)
    swap = rng.uniform(0.01, 0.6, (PEOPLE, VIEWS, LEFT_RIGHT.n_groups))
    least, rows = -2.0, len(detections.view)
    out = DetectionScores(
        np.empty((PEOPLE, rows)), np.empty((PEOPLE, rows, 2), dtype=np.int8), np.empty((PEOPLE, rows, 2))
    )
    parameters = MatchParameters(1.0, MIN_LOG_ODDS, MAX_KEYPOINTS, least)
    compared = score_detections(projected, detections, LEFT_RIGHT, law, swap, parameters, out)
    assert PEOPLE <= compared < PEOPLE * rows
    for p in range(PEOPLE):
        for row in range(rows):
            score, odds = scores_of(projected, detections, law, swap, p, row)
            if out.scores[p, row] == -np.inf:
                assert score <= least
                continue
            np.testing.assert_allclose(out.scores[p, row], score, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(out.swap_odds[p, row], odds, rtol=1e-9, atol=1e-9)
            assert ((out.swapped[p, row] != 0) == (odds > 0.0)).all()
