"""With default settings and the keypoints of detectors, a change of one coordinate of the anatomical model is recovered
with its sign, and no other angle changes."""

import numpy as np
import pytest

from posefuse.biomechanics.anatomy.anatomy import read_anatomy
from posefuse.biomechanics.marker_model import marker_model
from posefuse.biomechanics.person_frames import model_world
from posefuse.model.joint_angles import OPENSIM, AngleStatus
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.motions import smooth_step
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import truth_of

ANATOMY = read_anatomy()
BENT_DEG = {"knee_angle": 40.0, "elbow_flex": 50.0, "arm_add": -30.0}
STEP_DEG, RATE_HZ, FRAMES = 12.0, 60.0, 180
BEFORE, AFTER = 10, 105
SHOWN = tuple(
    name
    for name, is_length in zip(ANATOMY.coordinates, ANATOMY.is_translation, strict=True)
    if not is_length and not name.startswith(("mtp", "wrist", "pro_sup"))
)
SHARED = {
    "pelvis_tilt": (2.1, 2.9),
    "lumbar_extension": (3.7, 2.9),
    "hip_rotation": (1.3, 2.0),
    "subtalar_angle": (2.6, 2.0),
}
"""Largest errors, of the angle itself and of any other, where keypoints show an angle only in part: two hips hardly
show the tilt of the pelvis, and toes and heel hardly the rotation of the foot about its own axis."""


def angles_of_step(name, skeleton_name):
    """Return the joint angles of a person in whom one coordinate increases by 12 degrees for a second."""
    skeleton = find_skeleton(skeleton_name)
    model = marker_model(skeleton)
    time_s = np.arange(FRAMES) / RATE_HZ
    coordinates = np.zeros((FRAMES, len(ANATOMY.coordinates)))
    for i, each in enumerate(ANATOMY.coordinates):
        coordinates[:, i] = np.radians(BENT_DEG.get(each[:-2], 0.0))
    coordinates[:, ANATOMY.coordinate_index("pelvis_ty")] = 0.93
    step = smooth_step((time_s - 0.5) / 0.5) * (1.0 - smooth_step((time_s - 2.0) / 0.5))
    coordinates[:, ANATOMY.coordinate_index(name)] += np.radians(STEP_DEG) * step
    markers = model.markers
    positions = ANATOMY.marker_positions(model.scales, coordinates, markers.bodies, markers.locations_m)
    points = np.full((FRAMES, len(skeleton), 3), np.nan)
    points[:, model.columns] = positions @ model_world(np.array([0.0, 0.0, 1.0]))
    for derived, ends in skeleton.derived.items():
        if np.isnan(points[:, skeleton.index(derived)]).all():
            points[:, skeleton.index(derived)] = points[:, [skeleton.index(end) for end in ends]].mean(axis=1)
    return with_joint_angles(truth_of(build_rig("ring", 5), skeleton, points, RATE_HZ)).joint_angles


def changes_deg(angles):
    own = [i for i, convention in enumerate(angles.conventions) if convention == OPENSIM]
    return {angles.names[i]: float(angles.degrees[AFTER, 0, i] - angles.degrees[BEFORE, 0, i]) for i in own}


@pytest.mark.parametrize("name", SHOWN)
def test_one_coordinate_is_recovered_by_default_settings(name):
    change = changes_deg(angles_of_step(name, "halpe_26"))
    most, most_other = SHARED.get(name.removesuffix("_r").removesuffix("_l"), (1.0, 2.0))
    assert change.pop(name) == pytest.approx(STEP_DEG, abs=most)
    assert max(abs(value) for value in change.values() if np.isfinite(value)) < most_other


@pytest.mark.parametrize("name", ["pro_sup_r", "pro_sup_l"])
def test_hands_show_the_rotation_of_the_forearm(name):
    change = changes_deg(angles_of_step(name, "coco_wholebody_133"))
    assert change.pop(name) == pytest.approx(STEP_DEG, abs=1.0)
    assert max(abs(value) for value in change.values() if np.isfinite(value)) < 2.0


def test_toes_without_keypoints_have_no_angle():
    angles = angles_of_step("mtp_angle_r", "halpe_26")
    assert angles.status[AFTER, 0, angles.index("mtp_angle_r")] == AngleStatus.NOT_OBSERVED
