"""Bodies without a kinematic tree: bones are measured, and the bodies are tracked."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.errors import SkeletonError
from posefuse.kernels.tracking import body_kinematics
from posefuse.kernels.tracking.records import Pose
from posefuse.kinematics.initial_pose import pose_from_points
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.skeleton.skeletons import Skeleton, parse_skeleton, shipped_skeleton
from posefuse.synthetic.crowds import crowd_of_points
from posefuse.synthetic.figures import creature
from posefuse.synthetic.motions import CreatureMotion
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import body_of
from posefuse.tracking.unknown_bodies import measured_tree
from tests.kernels import from_python

locate = from_python(body_kinematics.locate_nodes)

MOUSE = """
name = "mouse"
keypoints = ["snout", "left_ear", "right_ear", "neck", "spine", "hip", "tail_base", "tail_mid", "left_paw", "right_paw"]
edges = [
    ["snout", "neck"], ["left_ear", "neck"], ["right_ear", "neck"], ["neck", "spine"], ["spine", "hip"],
    ["hip", "tail_base"], ["tail_base", "tail_mid"], ["left_paw", "spine"], ["right_paw", "spine"],
]
"""
BARE = Skeleton("dots", parse_skeleton(MOUSE, "mouse.toml").keypoints)


def small_rig(size: float) -> CameraRig:
    """Return five cameras around a body of a size."""
    rig = build_rig("ring", 5, radius_m=7.0, focal_px=3000.0, target_m=(0.0, 0.0, 1.0))
    cameras = []
    for camera in rig.cameras:
        pose = np.array(camera.camera_from_world)
        pose[:3, 3] *= size
        cameras.append(replace(camera, camera_from_world=pose))
    return replace(rig, cameras=tuple(cameras))


def two_creatures(size: float, seed: int) -> np.ndarray:
    """Return the points of two bodies, shape (60, 2, keypoint, 3)."""
    skeleton, rng, points = parse_skeleton(MOUSE, "mouse.toml"), np.random.default_rng(seed), []
    for i, x in enumerate((-1.2, 1.2)):
        figure = creature(skeleton, size, rng)
        motion = CreatureMotion(10 * seed + i, 0.5 * size, height_m=size)
        other = motion.positions(figure, np.arange(60) / 25.0)[:, figure.columns(skeleton)]
        points.append(other + np.array([x * size, 0.0, 0.0]))
    return np.stack(points, axis=1)


@pytest.mark.parametrize(
    ("size", "tree", "edges"), [(1.0, "", True), (0.1, "[tree]\nsize_m = 0.1", True), (0.1, "", True), (0.1, "", False)]
)
def test_two_unknown_bodies_are_tracked(size, tree, edges):
    skeleton = parse_skeleton(MOUSE + tree, "mouse.toml") if edges else BARE
    truth, rig = two_creatures(size, seed=2), small_rig(size)
    scene = crowd_of_points(truth, rig, parse_skeleton(MOUSE, "mouse.toml"), 25.0, seed=2)
    detections = replace(scene.detections, skeleton=skeleton)
    result = reconstruct(rig, detections, Options(people="many"))
    assert result.tracks is not None
    assert result.poses is not None
    active = np.asarray(result.tracks.state[:]) == TrackState.ACTIVE
    assert active[5:, :2].all()
    assert not active[:, 2:].any()
    apart = np.linalg.norm(result.layers["model"].points_m[5:, :2, None] - truth[5:, None], axis=-1).mean(axis=(0, 3))
    order = apart.argmin(axis=1)
    assert sorted(order) == [0, 1]
    assert apart.min(axis=1).max() < 0.06 * size
    np.testing.assert_allclose(np.linalg.norm(result.poses.directions[5:, :2], axis=-1), 1.0, rtol=1e-9)


def test_live_tracking_needs_the_body_size():
    skeleton, rig = parse_skeleton(MOUSE, "mouse.toml"), small_rig(0.1)
    with pytest.raises(SkeletonError, match="has no kinematic tree.*size_m"):
        tracker_of(rig, skeleton, default_noise(rig, Options()), Options())


def chain_bodies(rng: np.random.Generator, n: int, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return randomly turned chains of four points with bones of 3, 1 and 2, and noise covariances."""
    directions = rng.normal(size=(n, 3, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    steps = directions * np.array([3.0, 1.0, 2.0])[:, None]
    points = np.concatenate([np.zeros((n, 1, 3)), np.cumsum(steps, axis=1)], axis=1) + rng.normal(size=(n, 1, 3))
    points = points[:, [2, 0, 3, 1]]
    covariance = np.tile(noise_m**2 * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]), (n, 4, 1))
    return points + noise_m * rng.normal(size=points.shape), covariance


def test_bones_have_constant_lengths(rng):
    tree = measured_tree(Skeleton("chain", ("c", "a", "d", "b")), *chain_bodies(rng, 400, 0.2))
    joined = {frozenset((node.name, tree.nodes[node.parent].name)) for node in tree.nodes[1:]}
    assert joined == {frozenset("ab"), frozenset("bc"), frozenset("cd")}
    lengths = {frozenset((n.name, tree.nodes[n.parent].name)): n.place_m[2] for n in tree.nodes[1:]}
    # Without taking its noise off, the bone of 1 would be 1.06; all of it off, 0.93.
    assert lengths[frozenset("bc")] == pytest.approx(1.0, abs=0.04)
    assert lengths[frozenset("ab")] == pytest.approx(3.0, abs=0.06)


def test_edges_of_the_skeleton_are_bones_before_other_distances(rng):
    skeleton = Skeleton("chain", ("c", "a", "d", "b"), edges=(("a", "d"),))
    tree = measured_tree(skeleton, *chain_bodies(rng, 100, 0.01))
    assert frozenset("ad") in {frozenset((node.name, tree.nodes[node.parent].name)) for node in tree.nodes[1:]}


def test_bones_are_independent_of_the_position_of_bodies(rng):
    points, covariance = chain_bodies(rng, 50, 0.02)
    skeleton = Skeleton("chain", ("c", "a", "d", "b"))
    here = measured_tree(skeleton, points, covariance)
    other = measured_tree(skeleton, points[::-1] + np.array([5.0, -3.0, 8.0]), covariance)
    np.testing.assert_allclose(here.shape_m, other.shape_m, rtol=1e-9)
    assert here.bones == other.bones


def test_too_few_bodies_are_an_error(rng):
    points, covariance = chain_bodies(rng, 4, 0.02)
    with pytest.raises(SkeletonError, match="fewer than 5 show any two keypoints.*size_m"):
        measured_tree(Skeleton("chain", ("c", "a", "d", "b")), points, covariance)


def test_options_scale_with_the_body():
    options = TrackerOptions()
    assert options.in_proportion(1.0) is options
    small = options.in_proportion(0.125)
    assert small.initiation.apart_m == pytest.approx(0.125 * options.initiation.apart_m)
    assert small.lost_after_s == options.lost_after_s
    # Speeds: a length over a time.
    before, after = options.motion, small.motion
    speed = 0.125 / 0.5
    assert after.top_speed_m_s == pytest.approx(speed * before.top_speed_m_s)
    fading = (before.root_acceleration * before.root_decay_s, after.root_acceleration * after.root_decay_s)
    assert fading[1] == pytest.approx(speed**2 * fading[0])


@pytest.mark.parametrize("name", ["mouse_22", "body_20"])
def test_initial_pose_fits_points_of_any_size(name, rng):
    tree = shipped_skeleton(name).tree
    assert tree is not None
    shape, has = np.asarray(tree.shape_m), tree.keypoint_nodes >= 0
    turns = Rotation.random(len(tree.segments), rng=rng).as_matrix()
    bones = Rotation.random(len(tree.bones), rng=rng).as_matrix()
    nodes, again = np.empty((len(tree.nodes), 3)), np.empty((len(tree.nodes), 3))
    locate(body_of(tree), Pose(rng.normal(size=3), turns, bones, shape), nodes)
    points = np.where(has[:, None], nodes[tree.keypoint_nodes], np.nan)
    locate(body_of(tree), Pose(*pose_from_points(tree, points, shape), shape), again)
    off = np.linalg.norm(again[tree.keypoint_nodes[has]] - points[has], axis=-1)
    assert off.max() < 0.05 * tree.size_m
