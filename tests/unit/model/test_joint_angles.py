"""Joint angles as a data type."""

import numpy as np
import pytest

from posefuse.errors import ResultError
from posefuse.model.joint_angles import ANGLE_STATUSES, ISB, OPENSIM, AngleStatus, JointAngles


def angles(frames: int = 6) -> JointAngles:
    values = np.arange(frames * 2 * 3, dtype=np.float32).reshape(frames, 2, 3)
    status = np.zeros((frames, 2, 3), dtype=np.int8)
    names, conventions = ("hip_flexion_r", "knee_angle_r", "hip_flexion_r"), (OPENSIM, OPENSIM, ISB)
    return JointAngles(names, conventions, "solved", values, values, status, np.zeros((frames, 2, 3)))


def test_ranges_of_frames_make_the_whole():
    whole = angles()
    parts = [whole.frames(0, 2), whole.frames(2, 6)]
    assert JointAngles.concatenate(parts) == whole
    assert whole.window(2, 6).frames(0, 4) == parts[1]
    assert parts[1].n_frames == 4


def test_angles_are_found_by_name_and_convention():
    assert angles().index("hip_flexion_r") == 0
    assert angles().index("hip_flexion_r", ISB) == 2
    with pytest.raises(ResultError, match="knee_angle_l"):
        angles().index("knee_angle_l")


def test_sides_pair_angles_of_one_convention():
    names = ("pelvis_tilt", "knee_angle_r", "knee_angle_l", "knee_angle_r", "arm_flex_l", "left_elbow")
    conventions = (OPENSIM, OPENSIM, OPENSIM, ISB, OPENSIM, OPENSIM)
    angles = JointAngles(names, conventions, "solved", *[np.zeros((2, 1, 6))] * 3, np.zeros((2, 1, 3)))
    expected = {"pelvis_tilt": (0, 0), "knee_angle": (2, 1), "arm_flex": (4, -1), "elbow": (5, -1)}
    assert angles.sides(OPENSIM) == expected
    assert angles.sides(ISB) == {"knee_angle": (-1, 3)}


def test_shapes_must_agree():
    with pytest.raises(ResultError, match="pelvis_m"):
        JointAngles(("a",), (OPENSIM,), "solved", *[np.zeros((2, 1, 1))] * 3, np.zeros((3, 1, 3)))
    with pytest.raises(ResultError, match="conventions"):
        JointAngles(("a",), (), "solved", *[np.zeros((2, 1, 1))] * 3, np.zeros((2, 1, 3)))


def test_every_status_is_explained():
    assert set(ANGLE_STATUSES) == set(AngleStatus)
