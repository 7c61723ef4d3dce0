"""Identity scores against hand computations, and their invariances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.evaluation.identity import (
    THRESHOLDS,
    clear_scores,
    ghosts,
    hota_scores,
    identity_scores,
    longest_runs,
    recall_after_entry,
    since_entry_s,
)
from posefuse.evaluation.matching import is_here, match_frames, mean_distances_m
from tests.properties import examples

FRAMES = 20


def walkers(n: int, frames: int = FRAMES, keypoints: int = 3) -> np.ndarray:
    """People 2 m apart who walk side by side: shape (frame, person, keypoint, 3)."""
    points = np.zeros((frames, n, keypoints, 3))
    points[..., 0] = 2.0 * np.arange(n)[None, :, None]
    points[..., 1] = 0.05 * np.arange(frames)[:, None, None]
    points[..., 2] = 0.5 * np.arange(keypoints)
    return points


def scored(points: np.ndarray, truth: np.ndarray):
    apart, here, true_here = mean_distances_m(points, truth), is_here(points), is_here(truth)
    clear = clear_scores(match_frames(points, truth))
    return (
        clear,
        identity_scores(apart, clear.n_true, clear.n_found),
        hota_scores(apart, here, true_here),
    )


def test_perfect_tracks():
    truth = walkers(3)
    clear, identity, hota = scored(truth, truth)
    assert (clear.misses, clear.false_people, clear.switches, clear.fragments) == (0, 0, 0, 0)
    assert (clear.mota, clear.motp_mm, clear.recall, clear.mostly_tracked) == (1, 0, 1, 3)
    assert (identity.idf1, identity.idtp) == (1, 60)
    assert (hota.hota, hota.det_a, hota.ass_a) == pytest.approx((1, 1, 1))


def test_identity_swap_halfway():
    """Two switches of 40 person-frames; names are right in half of them; tracks share 10 of 30 frames."""
    truth = walkers(2)
    points = truth.copy()
    points[10:] = truth[10:, ::-1]
    clear, identity, hota = scored(points, truth)
    assert (clear.switches, clear.fragments, clear.misses, clear.false_people) == (2, 0, 0, 0)
    assert clear.mota == pytest.approx(1 - 2 / 40)
    assert identity.idf1 == pytest.approx(0.5)
    assert hota.det_a == pytest.approx(1)
    assert hota.ass_a == pytest.approx(10 / 30)
    assert hota.hota == pytest.approx(math.sqrt(1 / 3))


def test_missed_frames_in_the_middle():
    truth = walkers(2)
    points = truth.copy()
    points[7:9, 0] = np.nan
    clear, identity, hota = scored(points, truth)
    assert (clear.misses, clear.fragments, clear.switches) == (2, 1, 0)
    assert clear.mota == pytest.approx(1 - 2 / 40)
    assert identity.idf1 == pytest.approx(2 * 38 / 78)
    assert hota.det_a == pytest.approx(38 / 40)
    assert hota.ass_a == pytest.approx((18 * 18 / 20 + 20) / 38)


def test_fragmented_track():
    """One person as two tracks of 12 and 8 frames: one switch, no fragment."""
    truth = walkers(1)
    points = np.repeat(truth, 2, axis=1)
    points[12:, 0] = np.nan
    points[:12, 1] = np.nan
    clear, identity, hota = scored(points, truth)
    assert (clear.switches, clear.fragments, clear.mota) == (1, 0, pytest.approx(1 - 1 / 20))
    assert identity.idf1 == pytest.approx(2 * 12 / 40)
    assert hota.ass_a == pytest.approx((12 * 12 / 20 + 8 * 8 / 20) / 20)


def test_false_person_and_duplicate():
    truth = walkers(1)
    points = np.concatenate([truth, truth + np.array([0.1, 0, 0]), truth + np.array([5.0, 0, 0])], axis=1)
    points[5:, 2] = np.nan
    matches = match_frames(points, truth)
    clear = clear_scores(matches)
    assert (clear.false_people, clear.n_found, clear.mota) == (25, 45, pytest.approx(1 - 25 / 20))
    assert clear.false_share == pytest.approx(25 / 45)
    assert [(g.person, g.frames, g.longest, g.ever_matched) for g in ghosts(matches, "abc")] == [("c", 5, 5, False)]


def test_track_may_be_false_in_some_frames_only():
    truth = walkers(1)
    points = truth.copy()
    points[3:5] += 5.0
    points[8:11] += 5.0
    (life,) = ghosts(match_frames(points, truth), ["a"])
    assert (life.frames, life.longest, life.ever_matched) == (5, 3, True)


def test_switches_span_gaps_and_absences_are_not_fragments():
    truth = walkers(1)
    truth[8:12] = np.nan
    points = np.repeat(truth, 2, axis=1)
    points[8:, 0] = np.nan
    points[:8, 1] = np.nan
    clear, _, _ = scored(points, truth)
    assert (clear.switches, clear.fragments, clear.misses) == (1, 0, 0)


def test_half_similarity():
    """At 0.2 m of a reach of 0.5 m, 12 of 19 thresholds are met (0.05 to 0.6)."""
    truth = walkers(2)
    _, _, hota = scored(truth + np.array([0, 0, 0.2]), truth)
    assert hota.hota == pytest.approx(12 / len(THRESHOLDS))
    clear = clear_scores(match_frames(truth + np.array([0, 0, 0.2]), truth))
    assert clear.motp_mm == pytest.approx(200)
    assert clear_scores(match_frames(truth + np.array([0, 0, 0.2]), truth, 0.15)).matches == 0


def test_mostly_tracked_and_lost():
    truth = walkers(3)
    points = truth.copy()
    points[16:, 0] = np.nan
    points[10:, 1] = np.nan
    points[4:, 2] = np.nan
    clear, _, _ = scored(points, truth)
    assert (clear.mostly_tracked, clear.mostly_lost) == (1, 1)


def test_recall_after_entry():
    """Found 5 frames late each time; entries at frame 0 and 12."""
    truth = walkers(1)
    truth[10:12] = np.nan
    points = truth.copy()
    points[0:5] = points[12:15] = np.nan
    matches, time_s = match_frames(points, truth), np.arange(FRAMES) / 25.0
    assert recall_after_entry(matches, time_s, 0.0) == pytest.approx(10 / 18)
    assert recall_after_entry(matches, time_s, 3 / 25) == pytest.approx(10 / 12)
    assert recall_after_entry(matches, time_s, 5 / 25) == 1
    assert math.isnan(recall_after_entry(matches, time_s, 10.0))
    since = since_entry_s(matches.true_here, time_s)[:, 0] * 25
    np.testing.assert_allclose(since, [*range(10), np.nan, np.nan, *range(8)], atol=1e-9)


def test_result_or_truth_without_people():
    truth = walkers(2)
    empty = np.full((FRAMES, 0, 3, 3), np.nan)
    clear, identity, hota = scored(empty, truth)
    assert (clear.mota, clear.recall, identity.idf1, hota.hota) == (0, 0, 0, 0)
    assert math.isnan(clear.precision)
    assert math.isnan(clear.motp_mm)
    clear, identity, _ = scored(truth, empty)
    assert math.isnan(clear.mota)
    assert (clear.false_people, identity.idf1) == (40, 0)


def test_longest_runs():
    flags = np.array([[1, 1, 0, 1, 1, 1, 0], [0, 0, 0, 0, 0, 0, 0], [1, 1, 1, 1, 1, 1, 1]], dtype=bool).T
    assert longest_runs(flags).tolist() == [3, 0, 7]


def test_scores_match_the_published_code():
    """Figures of TrackEval 1.3.0 on the same distances; MOTA is not among them, its matches being sticky there."""
    f, t, p = np.ogrid[:40, :3, :4]
    near = 0.02 + ((7 * f + 13 * t) % 17) / 60
    far = 0.2 + ((7 * f + 13 * t + 29 * p + f * t * p) % 41) / 51.3
    true_here = ((5 * f + 3 * t) % 11 > 0)[:, :, 0]
    here = ((3 * f + 7 * p) % 13 > 1)[:, 0]
    apart = np.where((f // 13 + t) % 4 == p, near, far)
    apart[~(true_here[:, :, None] & here[:, None])] = np.nan
    hota = hota_scores(apart, here, true_here)
    identity = identity_scores(apart, int(true_here.sum()), int(here.sum()))
    assert (hota.hota, hota.det_a, hota.ass_a) == pytest.approx(
        (0.2310899436099506, 0.4420020002042236, 0.12120598026343359), abs=1e-12
    )
    assert identity.idf1 == pytest.approx(0.47107438016528924, abs=1e-12)


@examples(100)
@given(st.integers(0, 10_000))
def test_scores_are_independent_of_person_order_and_axes(seed):
    rng = np.random.default_rng(seed)
    truth = rng.normal(size=(12, 3, 4, 3))
    points = np.concatenate([truth, rng.normal(size=(12, 1, 4, 3))], axis=1) + 0.2 * rng.normal(size=(12, 4, 4, 3))
    points[rng.random((12, 4)) < 0.2] = np.nan
    truth[rng.random((12, 3)) < 0.2] = np.nan
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shift = rng.normal(size=3)
    moved = (
        points[:, rng.permutation(4)] @ rotation.T + shift,
        truth[:, rng.permutation(3)] @ rotation.T + shift,
    )
    for first, other in zip(scored(points, truth), scored(*moved), strict=True):
        for name, value in vars(first).items():
            assert getattr(other, name) == pytest.approx(value, abs=1e-9, nan_ok=True), name
