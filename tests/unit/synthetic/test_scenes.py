"""The synthetic world: constant bones, smooth motion, a detector that follows its law."""

import numpy as np
import pytest
from scipy.stats import kstest, t

from posefuse.errors import OptionsError
from posefuse.skeleton.skeletons import shipped_skeletons
from posefuse.synthetic.detector import detect, on_intervals
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import CreatureMotion, HumanMotion
from posefuse.synthetic.options import ACTIVITIES, CLEAN, MOST_CAMERAS, DetectorOptions, SceneOptions
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import simulate
from tests.scenes import skeleton_of

MOUSE = """
name = "mouse"
keypoints = ["snout", "left_ear", "right_ear", "back", "tail", "lone"]
edges = [["snout", "left_ear"], ["snout", "right_ear"], ["snout", "back"], ["back", "tail"]]
"""


class TestRigs:
    @pytest.mark.parametrize("layout", ["ring", "corners", "aisle"])
    @pytest.mark.parametrize("n", [1, 2, 3, 5, 8, MOST_CAMERAS])
    def test_every_camera_sees_the_middle(self, layout, n):
        rig = build_rig(layout, n)
        assert len(rig) == n
        np.testing.assert_allclose(rig.project(np.array([0, 0, 0.9])), [[959.5, 539.5]] * n, atol=1e-9)
        centers = np.array([camera.center_m for camera in rig.cameras])
        assert (centers[:, 2] > 0.5).all()
        apart = np.linalg.norm(centers[:, None] - centers[None], axis=-1) + np.eye(n) * 9
        assert apart.min() > 0.1

    @pytest.mark.parametrize("n", [0, MOST_CAMERAS + 1])
    def test_numbers_out_of_range(self, n):
        with pytest.raises(OptionsError, match=f"1 to {MOST_CAMERAS} cameras, got {n}"):
            build_rig("ring", n)

    def test_cameras_stand_upright(self):
        for camera in build_rig("ring", 5).cameras:
            top, bottom = camera.project(np.array([[0, 0, 1.7], [0, 0, 0.1]]))[0]
            assert top[1] < bottom[1]


class TestMotion:
    @pytest.fixture(scope="class")
    @classmethod
    def motion(cls):
        motion = HumanMotion.random(ACTIVITIES, np.random.default_rng(3))
        figure = human(1.7)
        times = np.arange(0, 18, 1 / 120)
        return figure, motion, times, motion.positions(figure, times)

    def test_bones_keep_their_length(self, motion):
        figure, _, _, positions = motion
        parents = np.array(figure.parents)
        lengths = np.linalg.norm(positions[:, 1:] - positions[:, parents[1:]], axis=-1)
        assert np.ptp(lengths, axis=0).max() < 1e-12

    def test_left_mirrors_right(self, motion):
        figure = motion[0]
        for name, offset in zip(figure.names, figure.offsets_m, strict=True):
            if name.startswith("left_"):
                other = figure.offsets_m[figure.names.index(f"right_{name[5:]}")]
                np.testing.assert_allclose(offset, other * [1, -1, 1])

    def test_motion_is_smooth_and_human(self, motion):
        figure, _, times, positions = motion
        step = times[1] - times[0]
        body = [figure.names.index(name) for name in ("mid_hip", "nose", "left_wrist", "right_ankle")]
        velocity = np.diff(positions[:, body], axis=0) / step
        acceleration = np.diff(velocity, axis=0) / step
        assert np.linalg.norm(velocity, axis=-1).max() < 8.0
        assert np.linalg.norm(acceleration, axis=-1).max() < 80.0
        assert np.linalg.norm(np.diff(acceleration, axis=0), axis=-1).max() < 30.0

    def test_feet_stand_on_the_floor_but_for_jumps(self, motion):
        figure, person, times, positions = motion
        feet = [figure.names.index(f"{side}_{part}") for side in ("left", "right") for part in ("heel", "big_toe")]
        lowest = positions[:, feet, 2].min(axis=1)
        activity = np.array(person.activities)[(times / person.activity_s).astype(int) % len(person.activities)]
        assert np.abs(lowest[activity != "jump"]).max() < 0.03
        assert lowest[activity == "jump"].max() > 0.15
        assert positions[..., 2].min() > -0.03

    def test_a_walker_walks(self):
        person = HumanMotion.random(("walk",), np.random.default_rng(0))
        hips = person.positions(human(), np.arange(0, 4, 0.01))[:, 0]
        speed = np.linalg.norm(np.diff(hips[:, :2], axis=0), axis=1) / 0.01
        assert np.median(speed) == pytest.approx(person.cadence_hz * person.stride_m, rel=0.05)

    def test_any_times_in_any_order(self, motion):
        figure, person, times, positions = motion
        chosen = np.array([1700, 3, 900])
        np.testing.assert_allclose(person.positions(figure, times[chosen]), positions[chosen], atol=1e-4)

    def test_unknown_activities(self):
        with pytest.raises(OptionsError, match="got the element 'dance'"):
            SceneOptions(activities=("dance",))  # type: ignore[arg-type]

    def test_creatures_have_constant_bones_too(self, tmp_path):
        (tmp_path / "mouse.toml").write_text(MOUSE)
        scene = simulate(SceneOptions(skeleton=str(tmp_path / "mouse.toml"), duration_s=2))
        points = scene.truth.layers["measured"].points_m[:, 0]
        edges = scene.truth.skeleton.edge_indices
        lengths = np.linalg.norm(points[:, edges[:, 0]] - points[:, edges[:, 1]], axis=-1)
        assert np.ptp(lengths, axis=0).max() < 1e-12
        assert lengths.min() > 0.02
        assert isinstance(CreatureMotion(0, 0.3), CreatureMotion)


class TestDetector:
    def noise(self, options: DetectorOptions, frames: int = 3000, rate_hz: float = 25.0):
        rig = build_rig("ring", 3)
        still = np.tile(np.array([0.1, 0.2, 1.0]), (frames, 3, 17, 1))
        detections = detect(rig, still, skeleton_of(17), rate_hz, options, np.random.default_rng(5))
        pixels, confidence = detections.dense()
        return pixels - rig.project(np.array([0.1, 0.2, 1.0]))[:, None], confidence

    def test_gaussian_law(self):
        errors, confidence = self.noise(CLEAN)
        assert errors.std() == pytest.approx(2.0, rel=0.01)
        assert np.abs(np.corrcoef(np.linalg.norm(errors, axis=-1).ravel(), confidence.ravel())[0, 1]) < 0.02

    def test_measured_law(self):
        only_noise = DetectorOptions(outlier_share=0, miss_share=0, swap_share=0)
        errors, confidence = self.noise(only_noise, frames=8000)
        unit = errors * confidence[..., None] / (4.5 * 1.92)
        # Heavy tails of 2.7 degrees of freedom, per axis; every 60th frame is nearly independent.
        assert kstest(unit[::60, ..., 0][np.isfinite(unit[::60, ..., 0])], t(2.7).cdf).statistic < 0.02
        signs = np.sign(errors)
        assert 0.5 < np.nanmean(signs[1:] * signs[:-1]) < 0.75
        bounded = np.clip(unit, -4, 4)
        lag_1 = np.nanmean(bounded[1:] * bounded[:-1]) / np.nanmean(bounded**2)
        assert 0.78 < lag_1 < 0.9
        assert 0.6 < np.nanmedian(confidence) < 0.9
        assert np.nanmin(confidence) > 0
        assert np.nanmax(confidence) < 1

    def test_errors_last_as_long_at_any_rate(self):
        only_noise = DetectorOptions(outlier_share=0, miss_share=0, swap_share=0)
        slow, _ = self.noise(only_noise, 4000, 25.0)
        fast, _ = self.noise(only_noise, 16000, 100.0)
        after = [np.nanmean(np.sign(e[lag:]) * np.sign(e[:-lag])) for e, lag in ((slow, 2), (fast, 8))]
        assert after[0] == pytest.approx(after[1], abs=0.03)

    @pytest.mark.parametrize(("fault", "share"), [("outlier_share", 0.1), ("miss_share", 0.15)])
    def test_faults_come_as_often_as_asked(self, fault, share):
        quiet = {"outlier_share": 0.0, "miss_share": 0.0, "swap_share": 0.0}
        errors, _ = self.noise(DetectorOptions("gaussian", 1.0, **(quiet | {fault: share})))
        sizes = np.linalg.norm(errors, axis=-1)
        found = np.isnan(sizes).mean() if fault == "miss_share" else (sizes > 20).mean()
        assert found == pytest.approx(share, abs=0.015)

    def test_misses_come_inspells(self):
        errors, _ = self.noise(DetectorOptions("gaussian", 1.0, outlier_share=0, swap_share=0, miss_share=0.2))
        missing = np.isnan(errors[..., 0]).reshape(len(errors), -1)
        starts = (missing[1:] & ~missing[:-1]).sum()
        assert missing.sum() / starts == pytest.approx(0.2 * 25, rel=0.1)

    @pytest.mark.parametrize(("share", "rate_hz"), [(0.8, 5.0), (0.6, 2.0), (0.9, 30.0), (0.05, 100.0), (1.0, 30.0)])
    def testspells_last_the_share_asked_for(self, share, rate_hz):
        on = on_intervals((4000, 20), share, 0.2, rate_hz, np.random.default_rng(2))
        assert on.mean() == pytest.approx(share, abs=0.02)

    def test_limbs_swap_as_a_whole(self):
        options = DetectorOptions("gaussian", 0.0, outlier_share=0, miss_share=0, swap_share=0.3)
        scene = simulate(SceneOptions(skeleton="coco_17", duration_s=10, detector=options))
        pixels, _ = scene.detections.dense()
        truth = np.moveaxis(scene.rig.project(scene.truth.layers["measured"].points_m[:, 0]), 0, 1)
        skeleton = scene.truth.skeleton
        leg = [skeleton.index(name) for pair in skeleton.chains["leg"] for name in pair]
        mirrored = truth[:, :, skeleton.mirror]
        as_is = np.isclose(pixels[:, :, leg], truth[:, :, leg], atol=1e-6).all(axis=(2, 3))
        swapped = np.isclose(pixels[:, :, leg], mirrored[:, :, leg], atol=1e-6).all(axis=(2, 3))
        assert (as_is ^ swapped).all()
        assert swapped.mean() == pytest.approx(0.3, abs=0.12)

    def swapped_pairs(self, **options: object) -> np.ndarray:
        """Shape (frame, view, pair), bool: of a scene without other faults."""
        errors = DetectorOptions("gaussian", 0.0, outlier_share=0, miss_share=0, **options)  # type: ignore[arg-type]
        scene = simulate(SceneOptions(skeleton="coco_17", duration_s=40, cameras=4, detector=errors))
        pixels, _ = scene.detections.dense()
        truth = np.moveaxis(scene.rig.project(scene.truth.layers["measured"].points_m[:, 0]), 0, 1)
        skeleton = scene.truth.skeleton
        left = [skeleton.index(name) for name, _ in skeleton.pairs]
        return ~np.isclose(pixels[:, :, left], truth[:, :, left], atol=1e-6).all(axis=-1)

    def test_pairs_swap_each_by_itself(self):
        swapped = self.swapped_pairs(swap_share=0.25, swap_law="pair")
        assert swapped.mean() == pytest.approx(0.25, abs=0.01)
        flat = swapped.reshape(len(swapped), -1).astype(float)
        assert np.abs(np.corrcoef(flat.T) - np.eye(flat.shape[1])).max() < 0.15
        assert (swapped[1:] & swapped[:-1]).mean() == pytest.approx(0.25**2, abs=0.01)

    def test_bodies_swap_for_a_second(self):
        swapped = self.swapped_pairs(swap_share=0.25, swap_law="body")
        assert (swapped == swapped[..., :1]).all()
        starts = (swapped[1:, :, 0] & ~swapped[:-1, :, 0]).sum()
        assert swapped[..., 0].sum() / starts == pytest.approx(30.0, rel=0.5)

    def test_views_may_swap_differently(self):
        shares = (0.5, 0.25, 0.0, 0.1)
        swapped = self.swapped_pairs(swap_law="pair", swap_shares=shares)
        np.testing.assert_allclose(swapped.mean(axis=(0, 2)), shares, atol=0.02)
        one = self.swapped_pairs(swap_share=0.25)
        np.testing.assert_array_equal(one, self.swapped_pairs(swap_shares=(0.25,) * 4))

    def test_clocks_may_be_off(self):
        options = DetectorOptions("gaussian", 0.0, outlier_share=0, miss_share=0, swap_share=0, max_offset_s=0.05)
        scene = simulate(SceneOptions(duration_s=2, detector=options))
        assert scene.offsets_s.any()
        pixels, _ = scene.detections.dense()
        truth = scene.truth.layers["measured"].points_m[:, 0]
        times = np.arange(len(truth)) / 30.0
        for v, camera in enumerate(scene.rig.cameras):
            moved = np.stack(
                [[np.interp(times + scene.offsets_s[v], times, x) for x in k.T] for k in truth.swapaxes(0, 1)]
            )
            inner = slice(3, -3)
            expected = camera.project(np.moveaxis(moved, -1, 0))[0]
            assert np.nanmedian(np.abs(expected - pixels[:, v])[inner]) < 0.5

    @pytest.mark.parametrize(
        "change",
        [
            {"miss_share": 1.0},
            {"sigma_px": -1},
            {"outlier_px": (5.0, 3.0)},
            {"swap_shares": (0.2, 1.0)},
            {"swap_law": "limb"},
        ],
    )
    def test_impossible_detectors(self, change):
        with pytest.raises(OptionsError):
            DetectorOptions(**change)

    def test_one_share_for_each_view(self):
        with pytest.raises(OptionsError, match="one fraction per view \\(5\\), got 2"):
            simulate(SceneOptions(duration_s=0.1, detector=DetectorOptions(swap_shares=(0.1, 0.2))))


class TestScenes:
    @pytest.mark.parametrize("skeleton", shipped_skeletons())
    def test_every_shipped_skeleton(self, skeleton):
        scene = simulate(SceneOptions(skeleton=skeleton, duration_s=0.3, cameras=3))
        assert scene.detections.skeleton.name == skeleton
        assert np.isfinite(scene.truth.layers["measured"].points_m).all()

    def test_the_seed_decides(self):
        one, same, other = (simulate(SceneOptions(duration_s=1, seed=seed)) for seed in (4, 4, 5))
        assert one.detections == same.detections
        assert one.truth == same.truth
        assert one.detections != other.detections

    @pytest.mark.parametrize("change", [{"duration_s": 0}, {"rate_hz": -1}, {"activities": ()}, {"cameras": 33}])
    def test_impossible_scenes(self, change):
        with pytest.raises(OptionsError):
            SceneOptions(**change)
