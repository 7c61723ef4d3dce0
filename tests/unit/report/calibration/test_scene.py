"""The 3D scene of a calibration."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.report.calibration.scene import SHOWN_POSES, calibration_scene, shown_up
from tests.boards import board_rig
from tests.calibration_summaries import board_summary, people_summary


def test_long_calibrations_are_thinned():
    summary = board_summary()
    n = 5 * SHOWN_POSES
    many = replace(summary, frames=np.arange(n), points_m=np.repeat(summary.points_m[:1], n, axis=0))
    scene = calibration_scene(many)
    assert len(scene["frames"]) == SHOWN_POSES
    assert scene["frames"][1] == 5


def test_fields_of_view_end_before_the_middle():
    summary = board_summary()
    middle = summary.volume.middle_m
    for camera, drawn in zip(summary.rig.cameras, calibration_scene(summary)["cameras"], strict=True):
        depth = (np.mean(drawn["corners"], axis=0) - camera.center_m) @ camera.rotation[2]
        assert depth == pytest.approx(0.45 * np.linalg.norm(middle - camera.center_m), rel=0.01)


def test_scene_is_upright_without_an_up_axis():
    assert shown_up(board_rig()) == "z"
    assert calibration_scene(board_summary())["shownUp"] == "-y"


def test_missing_people_are_not_drawn():
    assert calibration_scene(people_summary())["people"] == ["person_1", "person_2"]
