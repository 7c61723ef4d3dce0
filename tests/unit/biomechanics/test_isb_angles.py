"""ISB angles against SciPy's Euler angles and against sampled errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.biomechanics.coordinate_priors import moving_prior
from posefuse.biomechanics.inverse_kinematics import solve
from posefuse.biomechanics.isb_angles import isb_angles, isb_joints, isb_names, successive_angles
from tests.unit.biomechanics.bodies import gait, model_of, points_of


@pytest.mark.parametrize("order", ["ZXY", "YXZ", "YXY"])
def test_successive_angles_are_those_of_an_independent_implementation(order):
    angles = np.random.default_rng(0).uniform(-80.0, 80.0, (50, 3))
    if order == "YXY":
        angles[:, 1] = -5.0 - 170.0 * np.random.default_rng(1).random(50)
    rotations = Rotation.from_euler(order, angles, degrees=True).as_matrix()
    assert successive_angles(rotations, order) == pytest.approx(angles, abs=1e-9)
    assert np.isnan(successive_angles(Rotation.identity(1).as_matrix(), "YXY")[0, [0, 2]]).all()


@pytest.fixture(scope="module")
def walking():
    model = model_of("coco_wholebody_133")
    coordinates = gait(model, 60)
    prior = moving_prior().with_habits(np.zeros(12))
    return model, solve(model, points_of(model, coordinates, 0.005), prior)


def test_angles_follow_from_independent_rotations_of_bodies(walking):
    model, solution = walking
    found, _ = isb_angles(solution.rotations, solution.angular, solution.covariance)
    place = isb_names().index
    at = model.anatomy.body_index
    mirror = np.diag([1.0, 1.0, -1.0])
    for side, mirrored in (("r", np.eye(3)), ("l", mirror)):
        thorax, arm = solution.rotations[:, at("torso")], solution.rotations[:, at(f"humerus_{side}")]
        relative = mirrored @ np.swapaxes(thorax, 1, 2) @ arm @ mirrored
        # The second angle of this sequence is defined with either sign; ISB takes elevation as its amount.
        plane, minus, turn = Rotation.from_matrix(relative).as_euler("YXY", degrees=True).T
        elevation = found[:, place(f"shoulder_elevation_{side}")]
        assert elevation == pytest.approx(minus, abs=1e-6)
        other_plane = (plane + 180.0 + 180.0) % 360.0 - 180.0
        assert found[:, place(f"shoulder_plane_{side}")] == pytest.approx(other_plane, abs=1e-6)
        other_turn = (turn + 180.0 + 180.0) % 360.0 - 180.0
        assert found[:, place(f"shoulder_internal_rotation_{side}")] == pytest.approx(other_turn, abs=1e-6)
    hip = model.anatomy.coordinate_index("hip_flexion_r")
    assert found[:, place("hip_flexion_r")] == pytest.approx(np.degrees(solution.coordinates[:, hip]), abs=1e-6)


def test_flexion_of_the_knee_is_positive_on_both_sides(walking):
    model, solution = walking
    found, _ = isb_angles(solution.rotations, solution.angular, solution.covariance)
    for side in "rl":
        knee = np.degrees(solution.coordinates[:, model.anatomy.coordinate_index(f"knee_angle_{side}")])
        assert found[:, isb_names().index(f"knee_flexion_{side}")] == pytest.approx(knee, abs=1.5)


def test_standard_deviations_are_those_of_sampled_coordinates(walking):
    model, solution = walking
    _, sds = isb_angles(solution.rotations[:1], solution.angular[:1], solution.covariance[:1])
    rng = np.random.default_rng(0)
    covariance = 0.01 * solution.covariance[0]
    samples = rng.multivariate_normal(solution.coordinates[0], covariance, 3000)
    rotations, _ = model.anatomy.body_poses(model.scales, samples)
    angular = np.zeros((len(samples), samples.shape[1], 3))
    found, _ = isb_angles(rotations, angular, np.zeros((len(samples), *covariance.shape)))
    assert 0.1 * sds[0] == pytest.approx(found.std(axis=0), rel=0.08)


def test_names_are_unique_and_sided():
    names = isb_names()
    assert len(set(names)) == len(names)
    assert sum(name.endswith("_r") for name in names) == sum(name.endswith("_l") for name in names)
    assert all(len(joint.names) == 3 for joint in isb_joints())
