"""Findings of the diagnostics in real recordings."""

import pytest

from posefuse.io.calibration.read import read_cameras
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.io.open_recording import RecordingInputs
from posefuse.model.findings import FindingKind
from posefuse.model.options.options import Options
from posefuse.pipeline.diagnose import inspect_health, judge_sync
from posefuse.pipeline.refine_recording import refine_recording
from posefuse.progress import Silent


def inspected(folder, calibration: str, keypoints: str):
    detections = read_keypoints(folder / keypoints, Request.of(Options(), Silent()))
    return inspect_health(read_cameras(folder / calibration), detections)


def test_copied_mouse_camera_is_identified(shared_data):
    worst = inspected(shared_data("sleap_mouse"), "calibration.toml", ".")[0]
    assert (worst.kind, worst.cameras) == (FindingKind.COPIED_POSE, ("side",))
    assert "'top'" in worst.sentence


@pytest.mark.parametrize(
    ("folder", "calibration", "keypoints"),
    [
        ("sleap_mouse", "calibration_0b26179_good.toml", "."),
        ("pose2sim", "calibration/Calib_qualisys.toml", "balancing_one_person/pose-associated"),
        ("pose2sim", "calibration/Calib_qualisys.toml", "static_one_person/pose-associated"),
    ],
)
def test_correct_calibrations_have_no_findings(shared_data, folder, calibration, keypoints):
    assert inspected(shared_data(folder), calibration, keypoints) == ()


@pytest.mark.long
def test_webcams_are_unsynchronized_until_corrected(shared_data):
    """Their timestamps are within 3 ms, but the offsets of more than a frame predict left-out views better."""
    folder = shared_data("caliscope_webcams")
    detections = read_keypoints(folder / "xy_HOLISTIC.csv", Request.of(Options(), Silent()))
    rig = read_cameras(folder / "config.toml")
    _, sync, (finding,) = judge_sync(rig, detections)
    assert finding.kind is FindingKind.UNSYNCHRONIZED
    assert finding.cameras == sync.cameras == ("cam_1", "cam_3")
    _, again, findings = judge_sync(rig, detections, Options(sync=sync))
    assert again.does_nothing
    assert findings == ()


@pytest.mark.long
def test_refined_outdoor_rig_has_no_findings(shared_data, tmp_path):
    """One camera is left out; the views of the others have numbers only, so the order names all twelve."""
    folder = shared_data("mouse_outdoor_12cam")
    given = folder / "calibration_right_4_10_2026_adjusted.toml"
    detections = read_keypoints(folder / "points_right_4_10_2026_sub.npz", Request.of(Options(), Silent()))
    names = read_cameras(given).names
    options = Options(camera_order=names, rate_hz=30.0)
    refined = tmp_path / "refined.toml"
    result, _ = refine_recording(folder, refined, options, inputs=RecordingInputs(given))
    assert result.left_out == ("18",)
    assert result.is_better
    again = read_cameras(refined)
    assert inspect_health(again, detections, options) == ()
    _, sync, findings = judge_sync(again, detections, options)
    assert sync.does_nothing
    assert findings == ()
    inputs = RecordingInputs(refined)
    unchanged, _ = refine_recording(folder, tmp_path / "again.toml", options, inputs=inputs)
    assert not unchanged.is_better
    assert unchanged.findings == ()
