"""A run from real videos by MediaPipe: one person balancing, four cameras, with and without their calibration."""

import json
import shutil

import numpy as np
import pytest

import posefuse
from posefuse import RunOptions
from posefuse.model.options.detection import DetectOptions
from tests.installed import installed_home

LEGS = {"left_knee": "LKnee", "right_knee": "RKnee", "left_ankle": "LAnkle", "right_ankle": "RAnkle"}


@pytest.fixture
def detect(monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(installed_home("mediapipe")))
    return DetectOptions(detector="mediapipe")


def check_errors(result: posefuse.Reconstruction, measured_px: float) -> None:
    """Check the errors of measured points, and that the best layer predicts left-out views best.

    Smoothing increases the errors in the views that were used.
    """
    assert np.nanmedian(result.layers["measured"].reprojection_error_px) < measured_px
    errors = {each.layer: each.mean_px for each in result.layer_scores}
    assert errors[result.best_layer()[0]] == min(errors.values())


@pytest.mark.long
def test_no_leg_is_exchanged_with_the_other(shared_data, detect, tmp_path):
    """The given calibration explains the keypoints to 12.8 px, and sees points of known position 10 px off."""
    shutil.copytree(shared_data("pose2sim_videos"), tmp_path / "take")
    outcome = posefuse.run(tmp_path / "take", tmp_path / "out", RunOptions(detect=detect))
    result = outcome.reconstruction.open()
    check_errors(result, 13.8)
    trial = shared_data("pose2sim") / "balancing_one_person" / "pose-3d"
    reference = posefuse.read_points(trial / "S00_P00_T01_BalancingTrial_0-100.trc")
    exported = posefuse.read_points(tmp_path / "out" / "result" / "person_1.trc")
    for own, place in LEGS.items():
        other = LEGS[own.replace("left", "x").replace("right", "left").replace("x", "right")]
        points = exported.points_m[:, 0, exported.keypoints.index(own)]
        away = [
            np.linalg.norm(points - reference.points_m[:, 0, reference.keypoints.index(name)], axis=1)
            for name in (place, other)
        ]
        assert not (away[1] < away[0]).any()


@pytest.mark.long
def test_calibration_from_the_person_alone(shared_data, detect, tmp_path):
    shutil.copytree(shared_data("pose2sim_videos") / "videos", tmp_path / "take")
    outcome = posefuse.run(tmp_path / "take", tmp_path / "out", RunOptions(detect=detect))
    result = outcome.reconstruction.open()
    check_errors(result, 8.0)
    assert set(json.loads((tmp_path / "out" / "run.json").read_text())["stages"]) == {
        "calibrate", "synchronize", "report",
    }  # fmt: skip
