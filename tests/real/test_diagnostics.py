"""Findings of the diagnostics in real recordings."""

import pytest

from posefuse.io.calibration.read import read_cameras
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.model.findings import FindingKind
from posefuse.model.options.options import Options
from posefuse.pipeline.diagnose import inspect_health
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
        ("caliscope_webcams", "config.toml", "xy_HOLISTIC.csv"),
        ("pose2sim", "calibration/Calib_qualisys.toml", "balancing_one_person/pose-associated"),
        ("pose2sim", "calibration/Calib_qualisys.toml", "static_one_person/pose-associated"),
    ],
)
def test_correct_calibrations_have_no_findings(shared_data, folder, calibration, keypoints):
    assert inspected(shared_data(folder), calibration, keypoints) == ()
