"""Agreement of joint angles: known differences, time shifts, gaps and whole turns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.errors import ResultError
from posefuse.evaluation.angle_agreement import AngleSeries, compare_angles

NAMES = ("knee_angle_r", "hip_flexion_r")


def curves(time_s: np.ndarray) -> np.ndarray:
    return np.stack([30.0 + 30.0 * np.sin(6.0 * time_s), 20.0 * np.cos(6.0 * time_s)], axis=1)


def series(name: str, time_s: np.ndarray, degrees: np.ndarray, names: tuple[str, ...] = NAMES) -> AngleSeries:
    return AngleSeries(name, time_s, names, degrees)


def test_bias_and_limits_are_those_of_known_differences():
    time_s = np.arange(2000) / 60.0
    noise = np.random.default_rng(3).normal(0.0, 2.0, (2000, 2))
    ours = series("ours", time_s, curves(time_s) + np.array([5.0, -1.0]) + noise)
    knee, hip = compare_angles(ours, series("reference", time_s, curves(time_s))).angles
    assert knee.bias_deg == pytest.approx(5.0, abs=0.2)
    assert hip.bias_deg == pytest.approx(-1.0, abs=0.2)
    assert knee.rmse_deg == pytest.approx(np.hypot(5.0, 2.0), abs=0.2)
    assert knee.limits_deg == pytest.approx((5.0 - 3.92, 5.0 + 3.92), abs=0.3)
    assert np.mean(np.abs(knee.differences_deg - knee.bias_deg) < 3.92) == pytest.approx(0.95, abs=0.02)
    assert knee.correlation > 0.99


@settings(deadline=None, max_examples=20)
@given(st.floats(-0.4, 0.4))
def test_a_time_shift_is_found_to_a_tenth_of_a_frame(shift_s):
    time_s = np.arange(400) / 60.0
    ours = series("ours", time_s, curves(time_s + shift_s) + 3.0)
    found = compare_angles(ours, series("reference", time_s, curves(time_s)), max_time_shift_s=0.5)
    assert found.time_shift_s == pytest.approx(shift_s, abs=0.0017)
    assert found.angles[0].rmse_deg == pytest.approx(3.0, abs=0.1)


def test_without_a_request_times_are_compared_as_they_are():
    time_s = np.arange(400) / 60.0
    ours = series("ours", time_s, curves(time_s + 0.2))
    found = compare_angles(ours, series("reference", time_s, curves(time_s)))
    assert found.time_shift_s == 0.0
    assert found.angles[0].rmse_deg > 10.0


def test_whole_turns_and_jumps_from_180_to_minus_180_do_not_count():
    time_s = np.arange(300) / 60.0
    heading = 170.0 + 20.0 * time_s
    wrapped = (heading + 180.0) % 360.0 - 180.0
    ours = series("ours", time_s, wrapped[:, None] + 1.0, ("pelvis_rotation",))
    later = series("reference", time_s[:-1] + 0.5 / 60.0, (heading[:-1, None] + 10.0 / 60.0), ("pelvis_rotation",))
    (angle,) = compare_angles(ours, later).angles
    assert angle.bias_deg == pytest.approx(1.0, abs=1e-6)
    assert angle.rmse_deg == pytest.approx(1.0, abs=1e-6)


def test_missing_frames_are_not_compared_and_nothing_is_extrapolated():
    time_s = np.arange(300) / 60.0
    degrees = curves(time_s)
    degrees[100:150, 0] = np.nan
    knee, hip = compare_angles(
        series("ours", time_s, degrees), series("reference", time_s[50:250], curves(time_s[50:250]))
    ).angles
    assert (knee.n, hip.n) == (150, 200)
    assert knee.rmse_deg == pytest.approx(0.0, abs=1e-9)


def test_a_constant_angle_has_no_correlation():
    time_s = np.arange(10) / 60.0
    ours = series("ours", time_s, np.full((10, 1), 2.0), ("subtalar_angle_r",))
    assert np.isnan(compare_angles(ours, ours).angles[0].correlation)


def test_translations_are_no_angles():
    time_s = np.arange(10) / 60.0
    names = ("pelvis_tx", "knee_angle_r")
    both = series("ours", time_s, curves(time_s), names)
    assert [angle.angle for angle in compare_angles(both, both).angles] == ["knee_angle_r"]


def test_without_common_angles_both_lists_are_named():
    time_s = np.arange(10) / 60.0
    ours = series("ours", time_s, curves(time_s))
    other = series("reference", time_s, curves(time_s), ("a_knee", "a_hip"))
    with pytest.raises(ResultError, match=r"share no angle.*knee_angle_r.*a_knee"):
        compare_angles(ours, other)


def test_without_common_times_both_ranges_are_named():
    time_s = np.arange(10) / 60.0
    ours = series("ours", time_s, curves(time_s))
    with pytest.raises(ResultError, match=r"0.00 to 0.15 s.*100.00 to 100.15 s"):
        compare_angles(ours, series("reference", time_s + 100.0, curves(time_s)))


@pytest.mark.parametrize("time_s", [np.array([0.0, 0.0, 1.0]), np.array([0.0, np.nan, 1.0])])
def test_times_must_increase(time_s):
    with pytest.raises(ResultError, match="increase"):
        series("ours", time_s, np.zeros((3, 2)))
