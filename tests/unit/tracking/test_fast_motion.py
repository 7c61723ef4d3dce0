"""Fast motion, reinitialization after long gaps, and re-identification before a track is lost."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.animal_scenes import animal_rig

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.proposals import Proposals
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.tracking import fast_motion, reinitialize
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track
from posefuse.tracking.records import Track
from posefuse.tracking.reidentification import find_lost_track, population_is_known
from posefuse.tracking.settings import TrackerSettings

MOUSE = shipped_skeleton("mouse_22")
RIG = animal_rig(3, 0.5)
SETTINGS = TrackerSettings.of(RIG, MOUSE, NoiseModel(np.full(3, 5.0), 1.0), TrackerOptions())
TREE = SETTINGS.tree


def standing(at_m: np.ndarray) -> State:
    """Return the state of a mouse at rest with a small covariance."""
    points = np.full((len(MOUSE), 3), np.nan)
    points[MOUSE.index("spine_middle")] = at_m
    state = initial_state(
        TREE, points, np.asarray(TREE.shape_m), np.asarray(TREE.shape_covariance), SETTINGS.options.motion
    )
    state.covariance[:] *= 1e-3
    return state


def proposed(points_m: np.ndarray, views: int, log_odds: float) -> Proposals:
    """Return one proposal with a number of views."""
    none = Proposals.none(len(MOUSE), 3)
    rows = np.where(np.arange(3) < views, np.arange(3), -1)[None]
    return replace(
        none, rows=rows, swapped=np.zeros((1, 3), dtype=bool), points_m=points_m[None], log_odds=np.array([log_odds]),
        n_views=np.array([views]),
    )  # fmt: skip


POINTS = np.tile(np.arange(len(MOUSE))[:, None] * 1e-3, (1, 3))
NOBODY = np.full((1, 3), -1)


def leaps_of(points_m: np.ndarray, views: int, log_odds: float, rows: np.ndarray = NOBODY, gone_s: float = 0.03) -> int:
    proposals = proposed(points_m, views, log_odds)
    return len(
        fast_motion.find_fast_motions(np.array([0]), rows, POINTS[None], np.array([gone_s]), proposals, SETTINGS)
    )


def test_candidates_are_missing_while_views_have_unassigned_detections() -> None:
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
    assert leaps_of(POINTS + 0.99 * reach_m * aside, 3, 8.0) == 1
    assert leaps_of(POINTS + 1.01 * reach_m * aside, 3, 8.0) == 0
    assert leaps_of(POINTS + 1.01 * reach_m * aside, 3, 8.0, gone_s=0.1) == 1
    assert leaps_of(POINTS, 2, 8.0, rows=np.array([[0, 1, -1]])) == 0
    assert leaps_of(POINTS, 3, 8.0, rows=np.array([[0, 1, -1]])) == 1


def test_weak_odds_suffice_only_for_tracks_without_detections() -> None:
    assert leaps_of(POINTS, 3, 1.0) == 1
    assert leaps_of(POINTS, 3, 1.0, rows=np.array([[0, -1, -1]])) == 0
    assert leaps_of(POINTS, 3, -1.0) == 0


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


def test_long_gap_depends_on_how_far_limbs_turn() -> None:
    human = TrackerSettings.of(RIG, shipped_skeleton("body_20"), SETTINGS.noise, TrackerOptions())
    assert [reinitialize.is_long_gap(1.0 / rate_hz, SETTINGS) for rate_hz in (100, 30, 2)] == [False, False, True]
    assert [reinitialize.is_long_gap(1.0 / rate_hz, human) for rate_hz in (25, 5, 2)] == [False, False, True]


def test_directions_with_initial_variance_are_unknown() -> None:
    state = standing(np.zeros(3))
    columns = np.arange(TREE.n_pose)
    state.covariance[:, columns, columns] = SETTINGS.most
    assert reinitialize.has_unknown_directions(state, SETTINGS).all()
    state.covariance[:, columns, columns] = 0.1 * SETTINGS.most
    assert not reinitialize.has_unknown_directions(state, SETTINGS).any()


def test_reinitialized_bones_follow_their_points_and_others_stay() -> None:
    state, points = standing(np.zeros(3)), np.full((len(MOUSE), 3), np.nan)
    points[MOUSE.index("tail_base")], points[MOUSE.index("tail_middle")] = [0.0, 0.0, 0.0], [0.0, 0.02, 0.0]
    which = np.zeros(len(TREE.segments) + len(TREE.bones), dtype=bool)
    which[len(TREE.segments) :] = True
    before = state.bones.copy()
    reinitialize.reinitialize_directions(state, 0, which, points, SETTINGS)
    tail = TREE.bones.index("tail_middle")
    np.testing.assert_allclose(state.bones[0, tail, :, 2], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(np.delete(state.bones[0], tail, axis=0), np.delete(before[0], tail, axis=0))


def tracked_person(last_seen_s: float, state: TrackState = TrackState.ACTIVE) -> Track:
    track = new_track(1, 0.0, LifecycleThresholds(3.0, -2.0, 6.0))
    track.last_seen_s, track.state, track.established = last_seen_s, state, True
    return track


def returns(track: Track, settings: TrackerSettings, at_m: float = 0.01) -> bool:
    """Return whether a person first seen at 0.8 s, and now at 1 s, is re-identified at a distance."""
    state = standing(np.zeros(3))
    found = find_lost_track([track], state, state, np.array([at_m, 0.0, 0.0]), 0.8, 1.0, settings)
    return found is not None


def test_unsupported_track_can_be_reidentified_before_it_is_lost() -> None:
    assert returns(tracked_person(0.7), SETTINGS)
    assert returns(tracked_person(0.85), SETTINGS)
    assert not returns(tracked_person(0.95), SETTINGS)
    assert not returns(tracked_person(0.7), SETTINGS, at_m=0.4)


def test_closed_population_has_no_new_identities() -> None:
    closed = replace(SETTINGS, options=replace(SETTINGS.options, population=1))
    track = tracked_person(0.0, TrackState.LOST)
    assert population_is_known([track], closed)
    assert not population_is_known([track], SETTINGS)
    assert not population_is_known([replace(track, established=False)], closed)
    assert not returns(track, SETTINGS, at_m=5.0)
    assert returns(track, closed, at_m=5.0)
