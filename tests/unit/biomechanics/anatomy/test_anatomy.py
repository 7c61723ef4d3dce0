"""Facts of the anatomical chain: names, order, symmetry, and the meaning of the signs."""

import numpy as np
import pytest

from posefuse.biomechanics.anatomy.anatomy import Anatomy, read_anatomy

FORWARD, UP, RIGHT = np.eye(3)
MIRROR = np.diag([1.0, 1.0, -1.0])


def pose_with(anatomy: Anatomy, **coordinates_deg: float) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return rotations and origins by body with some coordinates set."""
    q = anatomy.defaults.copy()
    for name, value in coordinates_deg.items():
        q[anatomy.coordinate_index(name)] = np.radians(value)
    rotations, origins = anatomy.body_poses(anatomy.unscaled(), q[None])
    return dict(zip(anatomy.bodies, rotations[0], strict=True)), dict(zip(anatomy.bodies, origins[0], strict=True))


def test_parents_come_before_children_and_every_coordinate_moves_one_joint() -> None:
    anatomy = read_anatomy()
    assert (anatomy.chain.parent < np.arange(len(anatomy.bodies))).all()
    owners = [np.flatnonzero((anatomy.chain.coordinate == c).any(axis=1)) for c in range(len(anatomy.coordinates))]
    assert all(len(owner) == 1 for owner in owners)
    assert (anatomy.ranges[:, 0] < anatomy.ranges[:, 1]).all()


def test_mass_is_that_of_the_published_model_without_its_patellae() -> None:
    # 75.337 kg less two patellae of 0.0862 kg.
    assert read_anatomy().masses_kg.sum() == pytest.approx(75.1645, abs=1e-3)


def test_left_and_right_are_mirror_images_in_every_coordinate() -> None:
    anatomy = read_anatomy()
    rng = np.random.default_rng(0)
    q = np.zeros(len(anatomy.coordinates))
    for name in anatomy.coordinates:
        if name.endswith("_r"):
            low, high = anatomy.ranges[anatomy.coordinate_index(name)]
            both = [anatomy.coordinate_index(name), anatomy.coordinate_index(name[:-1] + "l")]
            q[both] = rng.uniform(low, high)
    rotations, origins = anatomy.body_poses(anatomy.unscaled(), q[None])
    # The published axes of wrists and toes are angles of six digits such as 1.5708, on both sides.
    for b, name in enumerate(anatomy.bodies):
        if name.endswith("_r"):
            left = anatomy.body_index(name[:-1] + "l")
            np.testing.assert_allclose(rotations[0, left], MIRROR @ rotations[0, b] @ MIRROR, atol=1e-5)
            np.testing.assert_allclose(origins[0, left], MIRROR @ origins[0, b], atol=1e-5)


@pytest.mark.parametrize(
    ("coordinate", "body", "axis", "direction"),
    [
        # Positive moves the body's axis toward the direction.
        ("pelvis_tilt", "pelvis", FORWARD, UP),
        ("pelvis_list", "pelvis", UP, RIGHT),
        ("pelvis_rotation", "pelvis", RIGHT, FORWARD),
        ("hip_flexion_r", "femur_r", -UP, FORWARD),
        ("hip_flexion_l", "femur_l", -UP, FORWARD),
        ("hip_adduction_r", "femur_r", -UP, -RIGHT),
        ("hip_adduction_l", "femur_l", -UP, RIGHT),
        ("hip_rotation_r", "femur_r", FORWARD, -RIGHT),
        ("hip_rotation_l", "femur_l", FORWARD, RIGHT),
        ("knee_angle_r", "tibia_r", -UP, -FORWARD),
        ("knee_angle_l", "tibia_l", -UP, -FORWARD),
        ("ankle_angle_r", "talus_r", FORWARD, UP),
        ("ankle_angle_l", "talus_l", FORWARD, UP),
        ("subtalar_angle_r", "calcn_r", UP, RIGHT),
        ("subtalar_angle_l", "calcn_l", UP, -RIGHT),
        ("mtp_angle_r", "toes_r", FORWARD, -UP),
        ("lumbar_extension", "torso", UP, -FORWARD),
        ("lumbar_bending", "torso", UP, RIGHT),
        ("lumbar_rotation", "torso", FORWARD, -RIGHT),
        ("neck_extension", "head", UP, -FORWARD),
        ("arm_flex_r", "humerus_r", -UP, FORWARD),
        ("arm_add_r", "humerus_r", -UP, -RIGHT),
        ("arm_add_l", "humerus_l", -UP, RIGHT),
        ("arm_rot_r", "humerus_r", FORWARD, -RIGHT),
        ("elbow_flex_r", "ulna_r", -UP, FORWARD),
    ],
)
def test_signs(coordinate: str, body: str, axis: np.ndarray, direction: np.ndarray) -> None:
    anatomy = read_anatomy()
    before, after = (pose_with(anatomy, **{coordinate: angle})[0][body] for angle in (0.0, 20.0))
    assert (after @ axis - before @ axis) @ direction > 0.2
