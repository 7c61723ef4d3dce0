"""Standard deviations of angles against sampled poses and hand computations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kinematics.angle_sds import axes_covariance, joint_angle_sds, relative_angle_sds, root_angle_sds
from posefuse.kinematics.joint_angles import angle_names, axes_at, joint_angles, relative_angles
from posefuse.kinematics.twist import full_rotations
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.skeleton.trees import Tree

BODY = shipped_skeleton("halpe_26").tree
HAND = shipped_skeleton("coco_wholebody_133").parts[0].tree
MOUSE = shipped_skeleton("mouse_22").tree
assert BODY is not None
assert MOUSE is not None
DRAWS = 20_000


def some_pose(tree: Tree, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return an upright body whose limbs are bent enough to show their twists, shape (1, ...)."""
    turns = Rotation.from_rotvec(rng.normal(0.0, 0.3, (len(tree.segments), 3))).as_matrix()
    bones = np.empty((len(tree.bones), 3, 3))
    for b, rest in enumerate(tree.rest):
        along = rest + 0.6 * rng.normal(size=3)
        along /= np.linalg.norm(along)
        across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        across /= np.linalg.norm(across)
        bones[b] = np.stack([across, np.cross(along, across), along], axis=1)
    return turns[None], bones[None]


def sample_poses(tree: Tree, turns: np.ndarray, bones: np.ndarray, covariance: np.ndarray, rng: np.random.Generator):
    """Return poses sampled from the covariance."""
    errors = rng.multivariate_normal(np.zeros(len(covariance)), covariance, DRAWS)[:, 3:]
    n = 3 * len(tree.segments)
    by_segment = Rotation.from_rotvec(errors[:, :n].reshape(-1, 3)).as_matrix().reshape(DRAWS, -1, 3, 3)
    about = np.zeros((DRAWS, len(tree.bones), 3))
    about[..., :2] = errors[:, n:].reshape(DRAWS, -1, 2)
    by_bone = Rotation.from_rotvec(about.reshape(-1, 3)).as_matrix().reshape(DRAWS, -1, 3, 3)
    return turns @ by_segment, bones @ by_bone


def some_covariance(tree: Tree, rng: np.random.Generator, sd: float = 0.01) -> np.ndarray:
    root = rng.normal(0.0, sd, (tree.n_pose, 2 * tree.n_pose)) / np.sqrt(2 * tree.n_pose)
    return root @ root.T


def spread_of(angles: np.ndarray) -> np.ndarray:
    """Return circular standard deviations of sampled angles, in degrees."""
    middle = np.degrees(np.angle(np.exp(1j * np.radians(angles)).mean(axis=0)))
    return ((angles - middle + 180.0) % 360.0 - 180.0).std(axis=0)


@pytest.mark.parametrize("tree", [BODY, MOUSE], ids=["human", "mouse"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_sampled_poses_have_the_predicted_spread(tree, seed):
    rng = np.random.default_rng(seed)
    turns, bones = some_pose(tree, rng)
    covariance = some_covariance(tree, rng)
    messages = joint_angle_sds(tree, turns, bones, covariance[None])[0]
    many = sample_poses(tree, turns, bones, covariance, rng)
    angles = joint_angles(tree, many[0], many[1][..., 2])[1]
    reference = np.isfinite(messages) & np.isfinite(angles).all(axis=0) & (messages < 5.0)
    assert reference.sum() > 0.7 * len(messages)
    np.testing.assert_allclose(messages[reference], spread_of(angles[:, reference]), rtol=0.05)


def test_knee_angle_matches_hand_computed_value():
    """Errors of 3 and 4 degrees of thigh and shank in the plane of the knee add up to 5."""
    turns, bones = np.tile(np.eye(3), (1, len(BODY.segments), 1, 1)), np.empty((1, len(BODY.bones), 3, 3))
    bones[:] = np.diag([1.0, -1.0, -1.0])
    shank = BODY.bones.index("left_ankle")
    bones[0, shank] = Rotation.from_euler("y", 60.0, degrees=True).as_matrix() @ bones[0, shank]
    thigh = BODY.bones.index("left_knee")
    covariance = np.zeros((1, BODY.n_pose, BODY.n_pose))
    for bone, sd in ((thigh, 3.0), (shank, 4.0)):
        place = 3 + 3 * len(BODY.segments) + 2 * bone + 1
        covariance[0, place, place] = np.radians(sd) ** 2
    names, _ = joint_angles(BODY, turns, bones[..., 2])
    sds = dict(zip(names, joint_angle_sds(BODY, turns, bones, covariance)[0], strict=True))
    assert sds["left_knee.flexion"] == pytest.approx(5.0, abs=1e-3)
    assert sds["left_hip.flexion"] == pytest.approx(3.0, abs=1e-3)
    assert sds["right_knee.flexion"] == 0.0
    assert sds["thorax.bend"] == 0.0


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8)])
def test_root_sds_follow_from_the_covariance_of_the_roots_turn(rng, up):
    turns, bones = some_pose(BODY, rng)
    covariance = some_covariance(BODY, rng)
    expected = joint_angle_sds(BODY, turns, bones, covariance[None], up)[0, :3]
    assert angle_names(BODY)[:3] == ("mid_hip.heading", "mid_hip.tilt", "mid_hip.list")
    np.testing.assert_allclose(root_angle_sds(turns[0, 0], covariance[3:6, 3:6], up), expected, rtol=1e-5)


def test_unknown_angles_have_no_standard_deviation(rng):
    turns, bones = some_pose(BODY, rng)
    covariance = some_covariance(BODY, rng)[None]
    elbow, wrist = (BODY.bones.index(f"left_{name}") for name in ("elbow", "wrist"))
    bones[0, wrist] = bones[0, elbow]
    names, angles = joint_angles(BODY, turns, bones[..., 2])
    sds = joint_angle_sds(BODY, turns, bones, covariance)
    assert np.isnan(sds[0, names.index("left_shoulder.rotation")])
    np.testing.assert_array_equal(np.isnan(sds), np.isnan(angles))
    wide = joint_angle_sds(BODY, turns, bones, 1e6 * covariance)
    assert np.nanmax(wide) == pytest.approx(180.0 / np.sqrt(3.0))
    assert np.isnan(joint_angle_sds(BODY, turns, bones, np.nan * covariance)).all()


def test_sds_grow_with_errors_and_do_not_depend_on_the_world(rng):
    turns, bones = some_pose(BODY, rng)
    covariance = some_covariance(BODY, rng)[None]
    names, _ = joint_angles(BODY, turns, bones[..., 2])
    sds = joint_angle_sds(BODY, turns, bones, covariance)[0]
    np.testing.assert_allclose(joint_angle_sds(BODY, turns, bones, 4.0 * covariance)[0], 2.0 * sds)
    world = Rotation.random(rng=rng).as_matrix()
    inner = [not name.startswith("mid_hip.") for name in names]
    turned = joint_angle_sds(BODY, world @ turns, world @ bones, covariance)[0]
    np.testing.assert_allclose(turned[inner], sds[inner], rtol=1e-3)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_angles_of_a_part_on_a_forearm(seed):
    rng = np.random.default_rng(seed)
    turns, bones = some_pose(BODY, rng)
    elbow, wrist = (BODY.bones.index(f"left_{name}") for name in ("elbow", "wrist"))
    bones[0, wrist] = bones[0, elbow] @ Rotation.from_euler("x", 50.0, degrees=True).as_matrix()
    covariance = some_covariance(BODY, rng)
    at = next(n for n, node in enumerate(BODY.nodes) if node.name == "left_wrist")
    palm, palm_covariance = Rotation.random(rng=rng).as_matrix(), np.diag([1e-4, 2e-4, 3e-4])
    palm = palm if abs(palm[1, 2]) < 0.8 else palm.T
    own_deg2 = axes_covariance(BODY, at, turns, bones, covariance[None])
    own = axes_at(BODY, BODY.nodes[at], turns, full_rotations(BODY, turns, bones[..., 2])[0])
    messages = relative_angle_sds(own, own_deg2, palm[None], palm_covariance[None])[0]
    many = sample_poses(BODY, turns, bones, covariance, rng)
    axes = axes_at(BODY, BODY.nodes[at], many[0], full_rotations(BODY, many[0], many[1][..., 2])[0])
    palms = palm @ Rotation.from_rotvec(rng.multivariate_normal(np.zeros(3), palm_covariance, DRAWS)).as_matrix()
    np.testing.assert_allclose(messages, spread_of(relative_angles(axes, palms)), rtol=0.1)


def test_hand_has_an_sd_for_each_angle(rng):
    turns, bones = some_pose(HAND, rng)
    names, angles = joint_angles(HAND, turns, bones[..., 2])
    sds = joint_angle_sds(HAND, turns, bones, some_covariance(HAND, rng)[None])
    assert sds.shape == angles.shape == (1, len(names))
    np.testing.assert_array_equal(np.isnan(sds), np.isnan(angles))
