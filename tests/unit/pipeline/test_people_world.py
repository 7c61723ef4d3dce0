"""The world of a calibration by people: size, up and floor."""

import numpy as np
import pytest

from posefuse.alignment.apply import aligned_rig
from posefuse.errors import DetectionsError
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import rotation_from_vector
from posefuse.model.options.calibration import PeopleOptions
from posefuse.pipeline.people_world import people_world
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate

TURN = rotation_from_vector(np.array([0.7, -0.4, 1.1]))


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(cameras=3, duration_s=12.0, rate_hz=10.0, activities=("walk",), seed=3))


def moved(scene, scale=1.7):
    """Return the true points and cameras in a world of another orientation and size."""
    other = Alignment(TURN, np.array([1.0, 2.0, 3.0]), scale)
    rig = aligned_rig(scene.rig.with_up(None), other)
    return other.points(np.asarray(scene.truth.layers["measured"].points_m)), rig, other


def test_floor_and_up_are_those_of_the_walking_person(scene):
    points, rig, other = moved(scene)
    world = people_world(
        points,
        scene.detections.skeleton,
        rig,
        10.0,
        PeopleOptions(length_m=0.4, length_between=("left_knee", "left_ankle")),
    )
    up = world.alignment.rotation @ other.rotation @ np.array([0.0, 0.0, 1.0])
    assert np.degrees(np.arccos(up[2])) < 3.0
    assert world.alignment.up_axis == "z"
    assert world.alignment.inferred_up is not None
    feet = world.alignment.points(points)[
        :, 0, [k for k, n in enumerate(scene.detections.skeleton.keypoints) if "ankle" in n]
    ]
    assert abs(np.nanmin(feet[..., 2])) < 0.12


def test_a_length_sets_the_scale(scene):
    points, rig, _ = moved(scene)
    i, j = (scene.detections.skeleton.index(name) for name in ("left_knee", "left_ankle"))
    options = PeopleOptions(length_m=0.43, length_between=("left_knee", "left_ankle"))
    world = people_world(points, scene.detections.skeleton, rig, 10.0, options)
    placed = world.alignment.points(points)
    assert np.nanmedian(np.linalg.norm(placed[:, 0, i] - placed[:, 0, j], axis=-1)) == pytest.approx(0.43, rel=1e-6)


@pytest.mark.parametrize("scale", [0.01, 1.0, 30.0])
def test_proportions_give_the_same_world_from_any_scale(scene, scale):
    points, rig, other = moved(scene, scale)
    world = people_world(points, scene.detections.skeleton, rig, 10.0, PeopleOptions())
    size = world.alignment.scale * other.scale
    assert size == pytest.approx(1.0, abs=3.0 * world.scale_sd)
    assert "6 %" in world.notes[0]


def test_a_child_does_not_change_the_scale(scene):
    points, rig, _ = moved(scene)
    alone = people_world(points, scene.detections.skeleton, rig, 10.0, PeopleOptions())
    both = np.concatenate([points, 0.7 * points], axis=1)
    together = people_world(both, scene.detections.skeleton, rig, 10.0, PeopleOptions())
    assert together.alignment.scale == pytest.approx(alone.alignment.scale, rel=1e-9)


def test_a_stature_that_nobody_shows_is_an_error(scene):
    points, rig, _ = moved(scene)
    hidden = np.full_like(points, np.nan)
    with pytest.raises(DetectionsError):
        people_world(hidden, scene.detections.skeleton, rig, 10.0, PeopleOptions(stature_m=1.8))


def test_without_posture_the_first_camera_is_the_world_and_up_is_unknown(scene):
    points, rig, _ = moved(scene, 1.0)
    knees = np.full_like(points, np.nan)
    for name in ("left_knee", "left_hip"):
        k = scene.detections.skeleton.index(name)
        knees[:, :, k] = points[:, :, k]
    world = people_world(knees, scene.detections.skeleton, rig, 10.0, PeopleOptions())
    assert world.alignment.up_axis is None
    assert np.allclose(aligned_rig(rig, world.alignment).cameras[0].camera_from_world, np.eye(4))
    assert any("up axis is unknown" in note for note in world.notes)
