"""Assignment of people who moved farther than predicted."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.proposals import Proposals
from posefuse.synthetic.crowds import CrowdScene
from posefuse.tracking import fast_motion
from tests.unit.tracking.mice import MOUSE, SETTINGS, TREE, standing
from tests.unit.tracking.stage_runs import (
    assert_equal_results,
    clean_scene,
    errors_m,
    events_of,
    run_without,
    scene_of_points,
    true_points_m,
)


def one_proposal(points_m: np.ndarray, views: int, log_odds: float) -> Proposals:
    """Return one proposal with a number of views."""
    none = Proposals.none(len(MOUSE), 3)
    rows = np.where(np.arange(3) < views, np.arange(3), -1)[None]
    return replace(
        none, rows=rows, swapped=np.zeros((1, 3), dtype=bool), points_m=points_m[None], log_odds=np.array([log_odds]),
        n_views=np.array([views]),
    )  # fmt: skip


POINTS = np.tile(np.arange(len(MOUSE))[:, None] * 1e-3, (1, 3))
NO_ROWS = np.full((1, 3), -1)


def count_fast_motions(
    points_m: np.ndarray, views: int, log_odds: float, rows: np.ndarray = NO_ROWS, unseen_s: float = 0.03
) -> int:
    proposals = one_proposal(points_m, views, log_odds)
    return len(
        fast_motion.find_fast_motions(np.array([0]), rows, POINTS[None], np.array([unseen_s]), proposals, SETTINGS)
    )


def test_candidates_lack_views_that_have_unassigned_detections() -> None:
    rows = np.array([[0, 1, 2], [-1, -1, 3], [-1, -1, -1]])
    free = np.array([True, True, False])
    may = np.array([True, True, True])
    assert fast_motion.find_candidates(rows, free, may).tolist() == [1, 2]
    assert fast_motion.find_candidates(rows, free, np.array([True, False, True])).tolist() == [2]
    assert fast_motion.find_candidates(rows, np.array([True, False, False]), may).tolist() == []


def test_fast_motion_is_within_reach_and_in_more_views() -> None:
    """The reach is 0.35 m for a human, 20 mm for a mouse, plus the distance at top speed."""
    births, motion = SETTINGS.options.initiation, SETTINGS.options.motion
    reach_m = births.gate_m + motion.top_speed_m_s * 0.03
    assert births.gate_m == pytest.approx(0.02)
    aside = np.array([1.0, 0.0, 0.0])
    assert count_fast_motions(POINTS + 0.99 * reach_m * aside, 3, 8.0) == 1
    assert count_fast_motions(POINTS + 1.01 * reach_m * aside, 3, 8.0) == 0
    assert count_fast_motions(POINTS + 1.01 * reach_m * aside, 3, 8.0, unseen_s=0.1) == 1
    assert count_fast_motions(POINTS, 2, 8.0, rows=np.array([[0, 1, -1]])) == 0
    assert count_fast_motions(POINTS, 3, 8.0, rows=np.array([[0, 1, -1]])) == 1


def test_weak_odds_suffice_only_for_tracks_without_detections() -> None:
    assert count_fast_motions(POINTS, 3, 1.0) == 1
    assert count_fast_motions(POINTS, 3, 1.0, rows=np.array([[0, -1, -1]])) == 0
    assert count_fast_motions(POINTS, 3, -1.0) == 0


def test_displaced_state_is_faster_and_less_certain() -> None:
    state, shift = standing(np.zeros(3)), np.array([0.02, -0.01, 0.0])
    after = fast_motion.displaced_state(state, fast_motion.FastMotion(0, 0, shift), 1.0 / 30.0, SETTINGS)
    np.testing.assert_allclose(after.root[0] - state.root[0], shift)
    assert (after.velocity[0, :3] @ shift) > 0.0
    assert (np.diagonal(after.covariance[0]) >= np.diagonal(state.covariance[0]) - 1e-15).all()
    assert np.linalg.eigvalsh(after.covariance[0]).min() > -1e-12
    n = TREE.n_pose
    np.testing.assert_allclose(after.covariance[0, :n, :n], after.covariance[0, :n, :n].T, atol=1e-15)
    np.testing.assert_array_equal(after.bones, state.bones)


@pytest.fixture(scope="module")
def jump() -> CrowdScene:
    """Return a person who moves 0.5 m to the side between frames 49 and 50."""
    scene = clean_scene(people=1, duration_s=3.0)
    points = true_points_m(scene)
    points[50:, ..., 1] += 0.5
    return scene_of_points(points, scene)


def test_stage_keeps_the_identity_of_a_person_who_jumps(jump: CrowdScene) -> None:
    """Without the stage the track stays behind and is lost, and the person becomes a second identity."""
    on, off = run_without(jump), run_without(jump, "fast_motion")
    truth = true_points_m(jump)[:, 0]
    assert [event.what for event in events_of(on)] == ["confirmed"]
    assert errors_m(on, "person_1", truth)[51:].max() < 0.03
    assert [event.what for event in events_of(off)] == ["confirmed", "confirmed", "lost"]
    assert np.nanmin(errors_m(off, "person_1", truth)[51:]) > 0.3


def test_stage_does_not_change_predictable_motion() -> None:
    scene = clean_scene(people=2, duration_s=2.0)
    assert_equal_results(run_without(scene), run_without(scene, "fast_motion"))
