"""Simulated scenarios with several people."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import OptionsError, SkeletonError
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdFaults, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, crowd_of_points, simulate_crowd
from posefuse.synthetic.options import CLEAN, DetectorOptions
from posefuse.synthetic.rigs import build_rig
from tests.scenes import skeleton_of

EXACT = replace(CLEAN, sigma_px=0.0)


def points_of(scene: CrowdScene) -> np.ndarray:
    """Shape (frame, person, keypoint, 3)."""
    return np.asarray(scene.truth.layers["measured"].points_m)


def cells_of(scene: CrowdScene) -> tuple[np.ndarray, np.ndarray]:
    """Frame and view of each row."""
    actual = scene.detections
    cell = np.repeat(np.arange(actual.n_frames * actual.n_views), actual.people_counts.ravel())
    return cell // actual.n_views, cell % actual.n_views


def has_detection(scene: CrowdScene) -> np.ndarray:
    """Shape (frame, person, view), bool: whether a person has a part in a detection."""
    frame, view = cells_of(scene)
    visible = np.zeros((scene.detections.n_frames, points_of(scene).shape[1], scene.detections.n_views), dtype=bool)
    for who in (scene.owner, scene.other):
        real = who >= 0
        visible[frame[real], who[real], view[real]] = True
    return visible


def errors_of(scene: CrowdScene, rig=None) -> np.ndarray:
    """Shape (row, keypoint), px: from the owner's true projection; NaN where there is none."""
    frame, view = cells_of(scene)
    exact = (rig or scene.rig).project(points_of(scene))
    error = np.linalg.norm(np.asarray(scene.detections.keypoints_px) - exact[frame, view, scene.owner], axis=-1)
    error[scene.owner < 0] = np.nan
    return error


def gaps_of(scene: CrowdScene) -> np.ndarray:
    """Shape (frame,): the least distance of two torso axes, m; infinite where fewer than two are there."""
    skeleton, points = scene.truth.skeleton, points_of(scene)
    low, high = (points[:, :, skeleton.index(name)] for name in ("mid_hip", "neck"))
    axes = low[:, :, None] + np.linspace(0, 1, 6)[:, None] * (high - low)[:, :, None]
    n = points.shape[1]
    pairs = [(p, q) for p in range(n) for q in range(p)]
    apart = [np.linalg.norm(axes[:, p, :, None] - axes[:, q, None], axis=-1).min(axis=(1, 2)) for p, q in pairs]
    return np.nan_to_num(np.array(apart), nan=np.inf).min(axis=0)


def span_of(scene: CrowdScene, what: str):
    return next(span for span in scene.spans if span.what == what)


def during(scene: CrowdScene, span) -> np.ndarray:
    time_s = scene.truth.time_s
    return (time_s >= span.from_s) & (time_s < span.to_s)


class TestScenarios:
    @pytest.mark.parametrize("seed", range(3))
    def test_hug_is_merged_in_all_views_for_at_most_1_5_s(self, seed):
        scene = simulate_crowd(CrowdOptions("hug", seed=seed))
        frame, view = cells_of(scene)
        merged = np.zeros((scene.detections.n_frames, len(scene.rig)), dtype=bool)
        merged[frame[scene.other >= 0], view[scene.other >= 0]] = True
        everywhere = merged.all(axis=1).sum() / 25.0
        assert 0.7 < everywhere <= 1.5
        hug = span_of(scene, "hug")
        assert 1.0 <= hug.to_s - hug.from_s <= 2.0
        assert gaps_of(scene)[during(scene, hug)].max() < 0.45

    @pytest.mark.parametrize("equal", [False, True])
    def test_people_in_a_hug_swap_places_and_differ_in_stature_by_8_percent(self, equal):
        scene = simulate_crowd(CrowdOptions("hug", seed=4, equal_statures=equal))
        skeleton, points = scene.truth.skeleton, points_of(scene)
        apart = np.subtract(*(points[:, p, skeleton.index("mid_hip")] for p in (0, 1)))
        before = apart[during(scene, span_of(scene, "hug"))][0]
        assert np.dot(before, apart[-1]) / np.linalg.norm(before) / np.linalg.norm(apart[-1]) < -0.95
        thigh = np.linalg.norm(
            points[0, :, skeleton.index("left_hip")] - points[0, :, skeleton.index("left_knee")], axis=-1
        )
        assert thigh.max() / thigh.min() == pytest.approx(1.0 if equal else 1.08)

    def test_one_person_leaves_for_five_seconds(self):
        scene = simulate_crowd(CrowdOptions("leave", seed=2))
        present = np.isfinite(points_of(scene)[..., 0]).all(axis=-1)
        assert present[:, 0].all()
        assert (~present[:, 1]).sum() == pytest.approx(125, abs=1)
        assert present[[0, -1], 1].all()

    @pytest.mark.parametrize("cameras", [5, 8])
    def test_single_camera_shows_a_person_for_two_seconds(self, cameras):
        scene = simulate_crowd(CrowdOptions("one_camera", cameras=cameras, seed=3))
        span = span_of(scene, "hidden")
        observed = has_detection(scene)[during(scene, span), span.person]
        assert len(observed) == pytest.approx(50, abs=1)
        assert not np.delete(observed, span.view, axis=1).any()
        assert observed[:, span.view].mean() > 0.9
        assert has_detection(scene)[during(scene, span), 1 - span.person].sum(axis=1).mean() > 0.6 * cameras

    def test_dark_camera_has_no_detections_for_ten_seconds(self):
        scene = simulate_crowd(CrowdOptions("dark"))
        span = span_of(scene, "dark")
        assert span.to_s - span.from_s == pytest.approx(10.0)
        counts = scene.detections.people_counts
        assert not counts[during(scene, span), span.view].any()
        assert counts[~during(scene, span), span.view].mean() > 2
        assert np.delete(counts[during(scene, span)], span.view, axis=1).mean() > 2

    def test_bumped_camera_is_rotated_by_twenty_degrees(self):
        scene = simulate_crowd(CrowdOptions("bumped", detector=EXACT, faults=NO_FAULTS))
        span = span_of(scene, "bumped")
        old, new = scene.rig.cameras[span.view], scene.true_rig.cameras[span.view]
        np.testing.assert_allclose(old.center_m, new.center_m, atol=1e-12)
        turn = np.degrees(np.arccos((np.trace(old.rotation @ new.rotation.T) - 1) / 2))
        assert turn == pytest.approx(20.0)
        frame, view = cells_of(scene)
        after = during(scene, span)[frame] & (view == span.view)
        assert np.nanmax(errors_of(scene)[~after]) < 1e-6
        assert np.nanmin(errors_of(scene)[after]) > 100
        assert np.nanmax(errors_of(scene, scene.true_rig)[after]) < 1e-6


class TestSceneOptions:
    def test_seed_determines_the_scene(self):
        one, same, other = (simulate_crowd(CrowdOptions(duration_s=2, seed=seed)) for seed in (4, 4, 5))
        assert one.detections == same.detections
        assert one.truth == same.truth
        np.testing.assert_array_equal(one.owner, same.owner)
        assert one.detections != other.detections

    def test_walks_are_independent_of_the_detector(self):
        one, other = (simulate_crowd(CrowdOptions(duration_s=2, detector=law)) for law in (CLEAN, DetectorOptions()))
        np.testing.assert_array_equal(points_of(one), points_of(other))

    @pytest.mark.parametrize("skeleton", ["coco_17", "halpe_26", "coco_wholebody_133"])
    def test_any_human_skeleton(self, skeleton):
        scene = simulate_crowd(CrowdOptions(skeleton=skeleton, duration_s=0.5))
        assert scene.detections.skeleton.name == skeleton

    def test_views_may_swap_differently(self):
        law = replace(EXACT, swap_law="pair", swap_shares=(0.3, 0.0, 0.0))
        scene = simulate_crowd(CrowdOptions(duration_s=4, cameras=3, detector=law, faults=NO_FAULTS))
        wrong = errors_of(scene) > 1
        _, view = cells_of(scene)
        assert wrong[view == 0].mean() > 0.1
        assert not wrong[view > 0].any()

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"scenario": "dance"}, "scenario must be one of crowd.* got 'dance'"),
            ({"people": 0}, "from 1 to 30, got 0"),
            ({"scenario": "hug", "people": 3}, "hug needs 2 people, got 3"),
            ({"scenario": "leave", "people": 1}, "2 to 30 people"),
            ({"scenario": "hug", "duration_s": 5.0}, "at least 16 s"),
            ({"cameras": 1}, "from 2 to 32, got 1"),
            ({"rate_hz": 0.0}, "rate_hz must be a finite number above 0 Hz"),
            ({"statures_m": (1.7,)}, "one value for each of 4 people, got 1"),
            ({"statures_m": (1.7, 1.7, 1.7, 17.0)}, "from 0.5 to 2.5 m"),
            ({"detector": DetectorOptions(max_offset_s=0.1)}, "one clock"),
        ],
    )
    def test_invalid_scenes_are_refused(self, change, words):
        with pytest.raises(OptionsError, match=words):
            CrowdOptions(**change)

    @pytest.mark.parametrize(
        "change",
        [{"merge_share": 1.5}, {"hidden_confidence": 0.0}, {"smallest_px": -1.0}, {"visible_share": float("nan")}],
    )
    def test_invalid_faults_are_refused(self, change):
        with pytest.raises(OptionsError, match=next(iter(change))):
            CrowdFaults(**change)

    def test_skeletons_of_animals_are_refused(self, tmp_path):
        (tmp_path / "fly.toml").write_text('name = "fly"\nkeypoints = ["antenna"]')
        with pytest.raises(SkeletonError, match="is not human: the human figure has no antenna"):
            simulate_crowd(CrowdOptions(skeleton=str(tmp_path / "fly.toml")))

    def test_points_of_another_shape_are_refused(self):
        with pytest.raises(OptionsError, match=r"expected \(frame, person, 17"):
            crowd_of_points(np.zeros((5, 17, 3)), build_rig("ring", 3), skeleton_of(17), 25.0)

    def test_points_of_a_skeleton_without_a_tree(self):
        points = np.random.default_rng(0).normal(0, 0.3, (10, 2, 5, 3)) + np.array([0.0, 0.0, 1.0])
        scene = crowd_of_points(points, build_rig("ring", 3), skeleton_of(5), 25.0, faults=NO_FAULTS)
        assert has_detection(scene).all()
