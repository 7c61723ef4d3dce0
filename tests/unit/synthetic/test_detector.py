"""The simulated detector of one subject."""

import numpy as np
import pytest
from scipy.stats import kstest, t

from posefuse.errors import OptionsError
from posefuse.synthetic.detector import detect, on_intervals
from posefuse.synthetic.options import CLEAN, CURRENT, DetectorOptions, SceneOptions
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import simulate
from tests.scenes import skeleton_of


class TestDetector:
    def noise(self, options: DetectorOptions, frames: int = 3000, rate_hz: float = 25.0):
        rig = build_rig("ring", 3)
        still = np.tile(np.array([0.1, 0.2, 1.0]), (frames, 3, 17, 1))
        detections = detect(rig, still, skeleton_of(17), rate_hz, options, np.random.default_rng(5))
        pixels, confidence = detections.dense()
        return pixels - rig.project(np.array([0.1, 0.2, 1.0]))[:, None], confidence

    def test_gaussian_error_model(self):
        errors, confidence = self.noise(CLEAN)
        assert errors.std() == pytest.approx(2.0, rel=0.01)
        assert np.abs(np.corrcoef(np.linalg.norm(errors, axis=-1).ravel(), confidence.ravel())[0, 1]) < 0.02

    def test_measured_error_model(self):
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

    def test_assumed_errors_of_a_current_detector_are_half_of_the_measured_ones(self):
        (measured, _), (current, _) = (
            self.noise(DetectorOptions(noise, outlier_share=0, miss_share=0, swap_share=0))
            for noise in ("measured", "rtmpose")
        )
        both = np.isfinite(measured) & np.isfinite(current)  # large errors leave the image
        assert both.mean() > 0.999
        assert current[both] == pytest.approx(measured[both] / 2)
        assert CURRENT.outlier_share < DetectorOptions().outlier_share

    def test_correlation_time_is_independent_of_the_frame_rate(self):
        only_noise = DetectorOptions(outlier_share=0, miss_share=0, swap_share=0)
        slow, _ = self.noise(only_noise, 4000, 25.0)
        fast, _ = self.noise(only_noise, 16000, 100.0)
        after = [np.nanmean(np.sign(e[lag:]) * np.sign(e[:-lag])) for e, lag in ((slow, 2), (fast, 8))]
        assert after[0] == pytest.approx(after[1], abs=0.03)

    @pytest.mark.parametrize(("fault", "share"), [("outlier_share", 0.1), ("miss_share", 0.15)])
    def test_faults_have_the_requested_frequency(self, fault, share):
        quiet = {"outlier_share": 0.0, "miss_share": 0.0, "swap_share": 0.0}
        errors, _ = self.noise(DetectorOptions("gaussian", 1.0, **(quiet | {fault: share})))
        sizes = np.linalg.norm(errors, axis=-1)
        actual = np.isnan(sizes).mean() if fault == "miss_share" else (sizes > 20).mean()
        assert actual == pytest.approx(share, abs=0.015)

    def test_missed_keypoints_are_correlated_in_time(self):
        errors, _ = self.noise(DetectorOptions("gaussian", 1.0, outlier_share=0, swap_share=0, miss_share=0.2))
        missing = np.isnan(errors[..., 0]).reshape(len(errors), -1)
        starts = (missing[1:] & ~missing[:-1]).sum()
        assert missing.sum() / starts == pytest.approx(0.2 * 25, rel=0.1)

    @pytest.mark.parametrize(("share", "rate_hz"), [(0.8, 5.0), (0.6, 2.0), (0.9, 30.0), (0.05, 100.0), (1.0, 30.0)])
    def test_swaps_last_for_the_requested_share(self, share, rate_hz):
        on = on_intervals((4000, 20), share, 0.2, rate_hz, np.random.default_rng(2))
        assert on.mean() == pytest.approx(share, abs=0.02)

    def test_limbs_swap_as_chains(self):
        options = DetectorOptions("gaussian", 0.0, outlier_share=0, miss_share=0, swap_share=0.3)
        scene = simulate(SceneOptions(skeleton="coco_17", duration_s=10, detector=options))
        pixels, _ = scene.detections.dense()
        truth = scene.rig.project(scene.truth.layers["measured"].points_m[:, 0])
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
        truth = scene.rig.project(scene.truth.layers["measured"].points_m[:, 0])
        skeleton = scene.truth.skeleton
        left = [skeleton.index(name) for name, _ in skeleton.pairs]
        return ~np.isclose(pixels[:, :, left], truth[:, :, left], atol=1e-6).all(axis=-1)

    def test_pairs_swap_independently(self):
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

    def test_clocks_may_have_offsets(self):
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
    def test_invalid_detector_options_are_refused(self, change):
        with pytest.raises(OptionsError):
            DetectorOptions(**change)

    def test_swap_shares_need_one_value_per_view(self):
        with pytest.raises(OptionsError, match="one fraction per view \\(5\\), got 2"):
            simulate(SceneOptions(duration_s=0.1, detector=DetectorOptions(swap_shares=(0.1, 0.2))))
