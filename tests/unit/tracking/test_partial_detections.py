"""Partial and duplicate detections of one person."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.options import CLEAN
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.partial_detections import merge_partial_detections
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import MatchScores
from posefuse.tracking.tracker import ArticulatedTracker
from tests.unit.tracking.stage_runs import active_people, assert_equal_results, clean_scene, run_without, true_points_m

SKELETON = shipped_skeleton("body_20")
LEGS = np.array([any(part in name for part in ("hip", "knee", "ankle", "toe")) for name in SKELETON.keypoints])


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    rig = build_rig("ring", 2)
    return TrackerSettings.of(rig, SKELETON, default_noise(rig, Options()), TrackerOptions())


def frame_of(rows: np.ndarray, view: list[int]) -> Frame:
    """Return a frame of detections with equal confidence."""
    present = np.isfinite(rows[..., 0])
    return Frame(
        rows, np.where(present, 0.8, np.nan), np.array(view, dtype=np.int64), np.full(len(rows), -1), np.zeros(2),
        np.ones(2, dtype=bool),
    )  # fmt: skip


def match_scores(gain: np.ndarray, settings: TrackerSettings) -> MatchScores:
    swapped = np.zeros((*gain.shape, settings.n_groups), dtype=np.int8)
    return MatchScores(gain, 0.0, swapped, np.zeros(swapped.shape), (gain > 3.0).any(axis=0))


def upper_and_lower_part(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a person's pixels, shape (keypoint, 2), and those above and below the hips."""
    whole = np.random.default_rng(seed).uniform(100.0, 900.0, (len(SKELETON), 2))
    return whole, np.where(LEGS[:, None], np.nan, whole), np.where(LEGS[:, None], whole, np.nan)


def test_two_partial_detections_are_merged(settings: TrackerSettings):
    whole, above, below = upper_and_lower_part()
    frame = frame_of(np.stack([above, below]), [0, 0])
    actual = match_scores(np.array([[9.0, 8.0]]), settings)
    joined = merge_partial_detections(frame, np.array([[0, -1]]), actual, settings)
    np.testing.assert_array_equal(joined.keypoints_px[0], whole)
    assert (joined.confidence[0] == 0.8).all()
    np.testing.assert_array_equal(joined.keypoints_px[1], below)
    np.testing.assert_array_equal(frame.keypoints_px[0], above)


def test_merged_limb_keeps_the_sides_of_its_part(settings: TrackerSettings):
    _, above, below = upper_and_lower_part()
    actual = match_scores(np.array([[9.0, 8.0]]), settings)
    legs = int(settings.group_of[SKELETON.index("left_knee")])
    arms = int(settings.group_of[SKELETON.index("left_wrist")])
    actual.swapped[0, 1], actual.swap_odds[0, 1] = 1, 4.0
    merge_partial_detections(frame_of(np.stack([above, below]), [0, 0]), np.array([[0, -1]]), actual, settings)
    assert actual.swapped[0, 0, legs] == 1
    assert actual.swapped[0, 0, arms] == 0
    assert actual.swap_odds[0, 0, [legs, arms]].tolist() == [4.0, 0.0]


@pytest.mark.parametrize(
    ("gain", "rows", "view"),
    [
        ([[9.0, 2.0]], [[0, -1]], [0, 0]),  # not where this person should have them
        ([[9.0, 8.0]], [[0, -1]], [0, 1]),  # another view's
        ([[9.0, 5.0], [1.0, 8.0]], [[0, -1], [-1, -1]], [0, 0]),  # fits another person better
        ([[9.0, 8.0], [1.0, 7.0]], [[0, -1], [1, -1]], [0, 0]),  # assigned to another person
    ],
)
def test_detections_of_others_are_not_merged(gain: list, rows: list, view: list[int], settings: TrackerSettings):
    _, above, below = upper_and_lower_part()
    frame = frame_of(np.stack([above, below]), view)
    actual = match_scores(np.array(gain), settings)
    assert merge_partial_detections(frame, np.array(rows, dtype=np.int64), actual, settings) is frame


def test_second_full_detection_is_not_merged(settings: TrackerSettings):
    whole, above, _ = upper_and_lower_part()
    frame = frame_of(np.stack([above, whole]), [0, 0])
    actual = match_scores(np.array([[9.0, 8.0]]), settings)
    assert merge_partial_detections(frame, np.array([[0, -1]]), actual, settings) is frame


def split_into_parts(scene: CrowdScene) -> Detections:
    """Return the detections with the legs separated from the rest in all views and frames."""
    whole = scene.detections
    pixels = np.repeat(np.asarray(whole.keypoints_px), 2, axis=0)
    pixels[::2, LEGS] = np.nan
    pixels[1::2, ~LEGS] = np.nan
    confidence = np.where(np.isfinite(pixels[..., 0]), np.repeat(np.asarray(whole.confidence), 2, axis=0), np.nan)
    return replace(
        whole, offsets=2 * np.asarray(whole.offsets), keypoints_px=pixels, confidence=confidence,
        track_ids=np.full(len(pixels), -1),
    )  # fmt: skip


def test_person_in_partial_detections_is_one_person_with_the_same_accuracy():
    """Two proposals of one body do not become two people, from the first frame on."""
    scene = simulate_crowd(CrowdOptions(people=2, duration_s=1.6, seed=3, detector=CLEAN, faults=NO_FAULTS))
    errors = []
    for detections in (scene.detections, split_into_parts(scene)):
        options = Options()
        tracker: ArticulatedTracker = tracker_of(scene.rig, SKELETON, default_noise(scene.rig, options), options)
        results = [tracker.update(Frame.of(detections, i)) for i in range(detections.n_frames)]
        active = [[p for p in people.people if p.state == TrackState.ACTIVE] for people in results]
        present = np.isfinite(scene.truth.layers["measured"].points_m[..., 0, 0]).sum(axis=1)
        assert all(len(people) <= n for people, n in zip(active, present, strict=True))
        assert len(active[-1]) == present[-1]
        truth = np.asarray(scene.truth.layers["measured"].points_m)[-1]
        errors.append(
            np.mean(
                [np.linalg.norm(truth - p.points_m, axis=-1).mean(axis=-1)[is_present(truth)].min() for p in active[-1]]
            )
        )
    assert errors[1] == pytest.approx(errors[0], rel=0.3)


def is_present(truth: np.ndarray) -> np.ndarray:
    return np.isfinite(truth[:, 0, 0])


def test_stage_uses_the_keypoints_of_both_partial_detections():
    """Without the stage only the upper parts are used, and the legs stay in their prior pose."""
    scene = clean_scene(people=1, duration_s=1.6, seed=0)
    truth, detections = true_points_m(scene)[:, 0], split_into_parts(scene)
    leg_error_m = []
    for stages in ((), ("partial_detections",)):
        results = run_without(scene, *stages, detections=detections)
        people = [active_people(each)["person_1"] for each in results[5:]]
        used = np.mean([person.used[:, LEGS].mean() for person in people])
        assert used > 0.95 if not stages else used == 0.0
        errors = [np.linalg.norm(p.points_m - t, axis=-1)[LEGS].mean() for p, t in zip(people, truth[5:], strict=True)]
        leg_error_m.append(np.mean(errors))
    assert leg_error_m[0] < 0.02
    assert leg_error_m[1] > 0.1


def test_stage_does_not_change_whole_detections():
    scene = clean_scene(people=2, duration_s=2.0)
    assert_equal_results(run_without(scene), run_without(scene, "partial_detections"))
