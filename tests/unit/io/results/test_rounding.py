"""Rounding of stored results to the stated precision."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.io.results.rounding import ERROR_BITS, MAX_STEP, SD_BITS, rounded, smallest_variance, to_digits
from posefuse.model.reconstruction import pack_covariance, unpack_covariance


def covariances(rng, largest_ratio, n=2000):
    """Return covariances with a given ratio of the largest to the smallest standard deviation, shape (n, 6)."""
    turns = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    sds = 10.0 ** rng.uniform(-4.0, 0.0, (n, 1)) * largest_ratio ** rng.uniform(0.0, 1.0, (n, 3))
    sds[:, 0] = sds[:, 1:].max(axis=1) / largest_ratio
    return pack_covariance(turns @ (np.square(sds)[..., None] * np.swapaxes(turns, 1, 2)))


def with_points(result, points_m, covariance):
    """Return a result of one frame and person whose points have given covariances."""
    layer = result.layers["measured"].frames(0, 1)
    repeats = -(-layer.points_m[..., 0].size // len(covariance))
    shape = layer.covariance_m2.shape
    tiled = np.tile(covariance, (repeats, 1))[: layer.points_m[..., 0].size].reshape(shape)
    return replace(
        result.frames(0, 1),
        layers={
            "measured": replace(layer, covariance_m2=tiled, points_m=np.broadcast_to(points_m, layer.points_m.shape))
        },
    )


@pytest.mark.parametrize("condition", [1e6, 1e8, 1e9, 1e10, 1e12, 1e15])
def test_nearly_singular_covariances_stay_positive_definite(condition, rng, frame_result):
    turns = np.linalg.qr(rng.normal(size=(300, 3, 3)))[0]
    values = np.array([1.0, 1.0 / condition, 1.0 / condition])
    covariance = pack_covariance(turns * values @ np.swapaxes(turns, 1, 2))
    for scale in (1e-12, 1.0, 1e6):
        for each in scale * covariance[:100]:
            stored = rounded(with_points(frame_result, np.ones(3), each[None])).layers["measured"].covariance_m2
            eigenvalues = np.linalg.eigvalsh(unpack_covariance(stored[0, 0, 0].astype(np.float64)))
            assert eigenvalues[0] > 0.0
            assert eigenvalues[2] == pytest.approx(scale, rel=0.02)


class TestRounding:
    @pytest.mark.parametrize(("ratio", "limit"), [(1.0, 0.01), (10.0, 0.01), (300.0, 0.01), (1000.0, 0.05)])
    def test_standard_deviations_in_every_direction_stay_within_the_stated_share(self, ratio, limit, frame_result):
        for covariance in covariances(np.random.default_rng(0), ratio, 200):
            stored = rounded(with_points(frame_result, np.ones(3), covariance[None])).layers["measured"].covariance_m2
            assert stored.dtype == np.float32
            before, after = (unpack_covariance(each) for each in (covariance, stored[0, 0, 0].astype(np.float64)))
            # The extreme ratios over all directions are the eigenvalues of one matrix relative to the other.
            ratios = np.linalg.eigvals(np.linalg.solve(before, after)).real
            assert np.abs(np.sqrt(ratios) - 1.0).max() < limit

    def test_covariances_remain_positive_definite(self, frame_result):
        for covariance in covariances(np.random.default_rng(1), 1e5, 200):
            stored = rounded(with_points(frame_result, np.ones(3), covariance[None])).layers["measured"].covariance_m2
            assert np.linalg.eigvalsh(unpack_covariance(stored[0, 0, 0].astype(np.float64)))[0] > 0.0

    @pytest.mark.parametrize("sd_m", [1e-7, 1e-4, 0.01, 10.0])
    def test_points_move_by_less_than_their_uncertainty_and_the_largest_step(self, sd_m, frame_result):
        point = np.array([1.234567891, -0.000123456, 17.000001])
        covariance = pack_covariance(sd_m**2 * np.eye(3))[None]
        stored = rounded(with_points(frame_result, point, covariance)).layers["measured"].points_m
        moved = np.abs(stored - point).max()
        assert 0.0 < moved <= min(0.5 * MAX_STEP, sd_m / 128.0)

    def test_missing_values_stay_missing(self, frame_result):
        stored = rounded(frame_result).layers["measured"]
        layer = frame_result.layers["measured"]
        for name in ("points_m", "covariance_m2", "reprojection_error_px", "view_error_px"):
            before, after = (np.isnan(np.asarray(getattr(each, name))) for each in (layer, stored))
            np.testing.assert_array_equal(before, after)

    def test_a_rounded_result_keeps_its_status_and_frames(self, crowd_result):
        stored = rounded(crowd_result)
        for name, layer in crowd_result.layers.items():
            np.testing.assert_array_equal(stored.layers[name].status, layer.status)
            np.testing.assert_array_equal(stored.layers[name].view_status, layer.view_status)
        assert np.nanmax(np.abs(np.asarray(stored.poses.turns) - crowd_result.poses.turns)) < 1e-5

    @pytest.mark.parametrize("bits", [ERROR_BITS, SD_BITS])
    def test_numbers_are_rounded_to_the_nearest(self, bits):
        values = np.random.default_rng(0).lognormal(0.0, 5.0, 10_000).astype(np.float32)
        error = np.abs(to_digits(values, bits) - values) / values
        assert 0.4 * 2.0**-bits < error.max() <= 0.5 * 2.0**-bits
        special = to_digits(np.array([np.nan, np.inf, -np.inf, 0.0, -1.0]), bits)
        np.testing.assert_array_equal(special, [np.nan, np.inf, -np.inf, 0.0, -1.0])

    def test_the_smallest_variance_is_bounded_from_below(self):
        covariance = covariances(np.random.default_rng(0), 300.0)
        smallest = np.linalg.eigvalsh(unpack_covariance(covariance))[:, 0]
        share = smallest_variance(covariance) / smallest
        assert share.max() <= 1.0 + 1e-9
        assert share.min() >= 1.0 / 3.0 - 1e-9
