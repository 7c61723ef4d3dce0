"""Per-frame statistics against NumPy."""

import numpy as np
import pytest

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import (
    accumulate_view_support,
    add_identity_scores,
    assign_labels,
    clear_majority_swaps,
    predict_visibility,
    record_matches,
    update_gated_time,
)
from posefuse.kernels.tracking.records import GATED, UNOBSERVED, USED, ViewSupport
from posefuse.tracking.body_states import KeypointUses

SEEDS = range(5)


@pytest.mark.parametrize("seed", SEEDS)
def test_observation_counts_match_numpy(seed):
    use = np.random.default_rng(seed).choice([USED, GATED, UNOBSERVED], size=(3, 4, 7))
    uses = KeypointUses.of(use)
    np.testing.assert_array_equal(uses.of_view, (use == USED).sum(axis=2))
    np.testing.assert_array_equal(uses.used, (use == USED).sum(axis=1))
    np.testing.assert_array_equal(uses.gated, (use == GATED).sum(axis=1))


@pytest.mark.parametrize("seed", SEEDS)
def test_predicted_visibility_matches_numpy(seed):
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(-50.0, 150.0, size=(3, 4, 7, 2))
    pixels[rng.random((3, 4, 7)) < 0.3] = np.nan
    sizes, chosen = np.tile([100.0, 80.0], (4, 1)), np.array([0, 2, 3, 6])
    expected = np.empty((3, 4), dtype=bool)
    predict_visibility(pixels, sizes, chosen, 0.5, expected)
    inside = ((pixels[:, :, chosen] >= 0.0) & (pixels[:, :, chosen] < sizes[:, None])).all(axis=-1)
    np.testing.assert_array_equal(expected, inside.mean(axis=2) >= 0.5)


def test_visibility_needs_half_of_the_core_inside_the_image():
    pixels = np.array([[[[0.0, 0.0], [100.0, 0.0]], [[-0.1, 0.0], [0.0, 80.0]]]])
    expected = np.empty((1, 2), dtype=bool)
    sizes, chosen = np.tile([100.0, 80.0], (2, 1)), np.arange(2)
    predict_visibility(pixels, sizes, chosen, 0.5, expected)
    assert expected.tolist() == [[True, False]]


@pytest.mark.parametrize("seed", SEEDS)
def test_view_support_matches_numpy(seed):
    rng = np.random.default_rng(seed)
    supported, expected = rng.random((5, 4)) < 0.6, rng.random((5, 4)) < 0.7
    free, before, dt_s, fade = rng.integers(0, 3, 4), rng.random((3, 4)), 0.04, 0.9
    after = before.copy()
    due = np.empty(4, dtype=np.int64)
    accumulate_view_support(supported, expected, free, fade, dt_s, ViewSupport(*after, due))
    sure = expected & (supported.sum(axis=1, keepdims=True) - supported >= 2)
    np.testing.assert_array_equal(due, sure.sum(axis=0))
    missed = (sure & ~supported).sum(axis=0)
    now = np.stack([sure.sum(axis=0), (sure & supported).sum(axis=0), np.minimum(free, missed)])
    np.testing.assert_allclose(after, fade * before + dt_s * now)


@pytest.mark.parametrize("seed", SEEDS)
def test_recorded_matches_match_numpy(seed):
    rng = np.random.default_rng(seed)
    rows, swapped = rng.integers(-1, 6, (5, 4)), rng.integers(0, 2, (5, 6, 2)).astype(np.int8)
    odds = rng.normal(0.0, 3.0, (5, 6, 2))
    ids, single_view_s = rng.integers(-1, 9, 6), rng.random(5)
    rows[0] = [-1, 3, -1, -1]
    was, known, before = rng.random((5, 4, 2)), rng.integers(-1, 9, (5, 4)), single_view_s.copy()
    was_then, ids_then = was.copy(), known.copy()
    record_matches(rows, swapped, odds, frozen(ids, np.int64), 0.04, single_view_s, was, known)
    there = rows >= 0
    probable = 1.0 / (1.0 + np.exp(-np.where(swapped != 0, odds, -np.abs(odds))))
    np.testing.assert_array_equal(known, np.where(there, ids[rows], ids_then))
    np.testing.assert_allclose(was, np.where(there[..., None], probable[np.arange(5)[:, None], rows], was_then))
    np.testing.assert_allclose(single_view_s, np.where(there.sum(axis=1) == 1, before + 0.04, 0.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_gated_time_matches_numpy(seed):
    rng = np.random.default_rng(seed)
    used, gated, displaced_s = rng.integers(0, 4, (3, 7)), rng.integers(0, 4, (3, 7)), rng.random((3, 7))
    expected = np.where((gated >= 2) & (gated > used), displaced_s + 0.1, 0.0)
    assert update_gated_time(used, gated, 0.1, displaced_s) == expected.max()
    np.testing.assert_array_equal(displaced_s, expected)


@pytest.mark.parametrize("seed", SEEDS)
def test_label_assignment_matches_numpy(seed):
    rng = np.random.default_rng(seed)
    rows, swapped = rng.integers(-1, 6, (5, 4)), rng.integers(0, 2, (5, 6, 2)).astype(np.int8)
    rows[0] = -1
    turned = lambda: (swapped[np.arange(5)[:, None], rows] != 0) & (rows >= 0)[..., None]  # noqa: E731
    most = 2 * turned().sum(axis=1) >= np.maximum((rows >= 0).sum(axis=1), 1)[:, None]
    expected = swapped * ~most[:, None]
    clear_majority_swaps(rows, swapped)
    np.testing.assert_array_equal(swapped, expected)
    group_of, mirror = np.array([-1, 0, 0, 1, 1]), np.array([0, 2, 1, 4, 3])
    labels = np.empty((5, 4, 5), dtype=np.int64)
    assign_labels(rows, swapped, frozen(group_of, np.int64), frozen(mirror, np.int64), labels)
    exchanged = turned()[:, :, group_of] & (group_of >= 0)
    np.testing.assert_array_equal(labels, np.where(exchanged, mirror, np.arange(5)))


@pytest.mark.parametrize("seed", SEEDS)
def test_identity_scores_match_numpy(seed):
    rng = np.random.default_rng(seed)
    ids, view, track_ids = rng.integers(-1, 3, (4, 3)), rng.integers(0, 3, 7), rng.integers(-1, 3, 7)
    scores, explained = rng.normal(size=(4, 7)), np.empty(7, dtype=bool)
    expected = scores + 1.5 * ((ids[:, view] == track_ids) & (track_ids >= 0))
    add_identity_scores(ids, view, frozen(track_ids, np.int64), 1.5, 0.5, scores, explained)
    np.testing.assert_allclose(scores, expected)
    np.testing.assert_array_equal(explained, (expected > 0.5).any(axis=0))
