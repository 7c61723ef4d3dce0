"""Refined cameras: planted errors are corrected, correct cameras stay, and undetermined results are errors."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration import checks, refine
from posefuse.calibration.gauge import apply_similarity, pose_changes
from posefuse.calibration.parameters import N_PARAMETERS, apply_changes
from posefuse.errors import CalibrationError, MatchError, OptionsError
from posefuse.model.detections import Detections
from posefuse.model.options.refinement import RefineOptions
from posefuse.pipeline.refine_calibration import RecordingSource, refine_calibration
from posefuse.skeleton.skeletons import Skeleton
from tests.scenes import ring

from .conftest import NOISE_PX, ONE, moved, observe


@pytest.mark.parametrize("planted", [{"y_rad": np.radians(1.0)}, {"x_m": 0.02}, {"y_m": -0.05}])
def test_planted_error_is_corrected_and_other_cameras_stay(planted):
    truth = ring(4)
    result = refine_calibration(moved(truth, "cam_2", **planted), observe(truth), ONE)
    errors = pose_changes(truth, result.rig)
    sds = np.array([[np.radians(c.turn_sd_deg)] * 3 + [c.shift_sd_m] * 3 for c in result.cameras])
    assert np.abs(errors / sds).max() < 5.0
    assert np.sqrt(np.mean((errors / sds) ** 2)) < 1.5
    assert sds[:, 0].max() < np.radians(0.2)
    assert result.after_px < 2.0 * NOISE_PX
    assert result["cam_2"].before_px > result["cam_2"].after_px


def test_correct_rig_stays_within_its_uncertainty():
    truth = ring(4)
    result = refine_calibration(truth, observe(truth, seed=3), ONE)
    for camera in result.cameras:
        assert camera.role == "refined"
        assert camera.turn_deg < 4.0 * camera.turn_sd_deg
        assert camera.shift_m < 4.0 * camera.shift_sd_m


def test_result_is_independent_of_the_camera_order():
    truth, order = ring(4), ("cam_3", "cam_0", "cam_2", "cam_1")
    initial, observed = moved(truth, "cam_2", x_m=0.02), observe(truth, frames=20)
    one = refine_calibration(initial, observed, ONE).rig
    other = refine_calibration(initial.select(order), observed.views(order), ONE).rig
    assert np.abs(pose_changes(one, other.select(one.names))).max() < 1e-4


def test_result_moves_with_the_world():
    truth = ring(4)
    initial, observed = moved(truth, "cam_1", y_rad=0.02), observe(truth, frames=20)
    step, origin = np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.5, 0.0]), np.zeros(3)
    one = apply_similarity(refine_calibration(initial, observed, ONE).rig, np.zeros((1, 3)), step, origin)[0]
    other = refine_calibration(apply_similarity(initial, np.zeros((1, 3)), step, origin)[0], observed, ONE).rig
    assert np.abs(pose_changes(one, other)).max() < 1e-4


def test_fixed_cameras_define_the_world():
    truth = ring(4)
    result = refine_calibration(
        moved(truth, "cam_2", x_m=0.05), observe(truth), ONE, RefineOptions(fix=("cam_0", "cam_1"))
    )
    assert result.rig["cam_0"] == truth["cam_0"]
    assert result["cam_0"].role == "fixed"
    assert np.linalg.norm(result.rig["cam_2"].center_m - truth["cam_2"].center_m) < 0.01


def test_wrong_focal_length_is_corrected():
    truth = ring(4)
    wrong = np.zeros((4, N_PARAMETERS))
    wrong[3, 6] = 0.03
    observed = observe(truth, frames=60)
    result = refine_calibration(apply_changes(truth, wrong), observed, ONE, RefineOptions(refine="focal"))
    camera = result["cam_3"]
    assert camera.focal_share == pytest.approx(-0.03, abs=0.005 + 4 * camera.focal_sd)
    assert 0 < camera.focal_sd < 0.01


def test_copied_camera_is_left_out_or_relocated():
    truth = ring(4)
    copy = replace(truth["cam_0"], name="cam_3")
    initial, observed = replace(truth, cameras=(*truth.cameras[:3], copy)), observe(truth)
    result = refine_calibration(initial, observed, ONE)
    assert result.left_out == ("cam_3",)
    assert "cam_0" in result["cam_3"].why
    actual = refine_calibration(initial, observed, ONE, RefineOptions(relocate=("cam_3",)))
    assert actual["cam_3"].role == "located"
    assert np.linalg.norm(actual.rig["cam_3"].center_m - truth["cam_3"].center_m) < 0.03
    assert actual["cam_3"].after_px < 3 * NOISE_PX


def test_undetermined_results_are_errors():
    truth = ring(4)
    with pytest.raises(CalibrationError, match="points are observed by two"):
        refine_calibration(truth, observe(truth, frames=8), ONE)
    small = Detections.from_dense(
        Skeleton("points", ("a", "b", "c", "d")),
        truth.names,
        truth.project(np.random.default_rng(0).uniform(0.9, 1.0, (80, 4, 3)))
        + np.random.default_rng(1).normal(0.0, 3.0, (80, 4, 4, 2)),
    )
    with pytest.raises(CalibrationError, match="do not determine focal length and distortion"):
        refine_calibration(truth, small, ONE, RefineOptions(refine="focal"))
    with pytest.raises(CalibrationError, match=r"rotation .* degrees"):
        refine_calibration(truth, small, ONE)
    with pytest.raises(MatchError, match="No camera 'cam_9'"):
        refine_calibration(truth, small, ONE, RefineOptions(fix=("cam_9",)))
    with pytest.raises(OptionsError, match="must not name the same camera"):
        RefineOptions(fix=("a",), relocate=("a",))


@pytest.mark.parametrize("repetition", [1, 3])
def test_camera_that_loses_its_points_during_the_adjustment_is_left_out(repetition, monkeypatch):
    calls, find = [], checks.find_disconnected

    def lost(observations, n):
        calls.append(n)
        return {3: 5} if len(calls) == repetition else find(observations, n)

    monkeypatch.setattr(checks, "find_disconnected", lost)
    truth = ring(4)
    result = refine_calibration(moved(truth, "cam_0", x_m=0.02), observe(truth), ONE)
    assert result.rig.names == ("cam_0", "cam_1", "cam_2")
    assert list(result.left_out) == ["cam_3"]


@pytest.mark.parametrize("repetition", [1, 4])
def test_cameras_that_remain_are_adjusted_again(repetition, monkeypatch):
    calls = []

    def misfit(state, options, *, check_misfits):
        calls.append(check_misfits)
        return {"cam_3": "it does not fit."} if len(calls) == repetition else {}

    monkeypatch.setattr(refine, "_cameras_to_leave_out", misfit)
    monkeypatch.setattr(refine, "_has_converged", lambda *_: False)
    truth = ring(4)
    result = refine_calibration(moved(truth, "cam_0", x_m=0.02), observe(truth), ONE)
    assert result.rig.names == ("cam_0", "cam_1", "cam_2")
    assert len(calls) == max(4, repetition + 1)


def test_given_cameras_are_triangulated_once(monkeypatch):
    rigs, triangulate = [], RecordingSource.triangulate

    def counted(source, rig):
        rigs.append(rig)
        return triangulate(source, rig)

    monkeypatch.setattr(RecordingSource, "triangulate", counted)
    truth = ring(4)
    refine_calibration(moved(truth, "cam_2", x_m=0.02), observe(truth), ONE)
    assert not any(rig.cameras == rigs[0].cameras for rig in rigs[1:])
