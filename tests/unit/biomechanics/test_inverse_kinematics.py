"""Every coordinate is recovered with its sign, one at a time, and the standard deviations are those of the errors."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.biomechanics.anatomy.anatomy import read_anatomy
from posefuse.biomechanics.coordinate_priors import moving_prior
from posefuse.biomechanics.inverse_kinematics import PersonPoints, solve
from posefuse.biomechanics.marker_model import MarkerModel, coordinates_of, marker_model
from posefuse.kernels.biomechanics.inverse_kinematics import Markers
from posefuse.skeleton.skeletons import find_skeleton
from tests.unit.biomechanics.bodies import gait, model_of, points_of

ANATOMY = read_anatomy()
ANGLES = [name for name, is_length in zip(ANATOMY.coordinates, ANATOMY.is_translation, strict=True) if not is_length]
_BENT = {"knee_angle": 40.0, "elbow_flex": 50.0, "arm_add": -30.0}
_STEP_DEG = 12.0


def joint_centers() -> MarkerModel:
    """Return a model with markers at joint centers, and one beside each end of limbs, which keypoints of hands and feet
    would be."""
    places: dict[tuple[int, tuple[float, ...]], None] = {}
    for b, parent in enumerate(ANATOMY.chain.parent):
        places[(b, tuple(ANATOMY.chain.child_offset_m[b]))] = None
        if parent >= 0:
            places[(int(parent), tuple(ANATOMY.chain.parent_offset_m[b]))] = None
    for name in ("head", "hand_r", "hand_l", "toes_r", "toes_l", "calcn_r", "calcn_l"):
        for place in ((0.08, -0.03, 0.02), (0.02, -0.08, -0.03)):
            places[(ANATOMY.body_index(name), place)] = None
    bodies = np.array([body for body, _ in places], dtype=np.int64)
    lists = [coordinates_of(ANATOMY, int(body)) for body in bodies]
    ancestors = np.full((len(bodies), max(map(len, lists))), -1, dtype=np.int64)
    for row, found in zip(ancestors, lists, strict=True):
        row[: len(found)] = found
    n = len(bodies)
    names = tuple(f"point_{i}" for i in range(n))
    locations = np.array([place for _, place in places])
    markers = Markers(bodies, locations, ancestors)
    return MarkerModel(ANATOMY, names, np.arange(n), np.arange(n), np.ones((n, 3)), ANATOMY.unscaled(), markers)


CENTERS = joint_centers()


@pytest.mark.parametrize("name", ANGLES)
def test_one_coordinate_is_recovered_with_its_sign_and_no_other_moves(name):
    coordinates = np.zeros((2, len(ANATOMY.coordinates)))
    for i, each in enumerate(ANATOMY.coordinates):
        coordinates[:, i] = np.radians(_BENT.get(each[:-2], 0.0))
    c = ANATOMY.coordinate_index(name)
    coordinates[1, c] += np.radians(_STEP_DEG)
    markers = CENTERS.markers
    points = ANATOMY.marker_positions(CENTERS.scales, coordinates, markers.bodies, markers.locations_m)
    information = np.broadcast_to(np.eye(3) / 0.001**2, (2, len(markers.bodies), 3, 3)).copy()
    same = np.broadcast_to(np.eye(3), (2, 3, 3))
    person = PersonPoints(points, information, np.ones(2, dtype=bool), same, same, np.zeros((2, 3)))
    prior = moving_prior()
    solution = solve(CENTERS, person, prior.with_habits(np.zeros(len(prior.rows))))
    change = np.degrees(solution.coordinates[1] - solution.coordinates[0])
    angles = ~ANATOMY.is_translation
    assert change[c] == pytest.approx(_STEP_DEG, abs=1.0)
    assert np.abs(np.delete(change, c)[np.delete(angles, c)]).max() < 2.0


def test_standard_deviations_are_those_of_the_errors():
    model = model_of()
    coordinates = gait(model, 300)
    solution = solve(model, points_of(model, coordinates, 0.01), moving_prior().with_habits(np.zeros(12)))
    sds = np.sqrt(np.einsum("fii->fi", solution.covariance))
    for name in ("knee_angle_r", "hip_adduction_l", "ankle_angle_r", "elbow_flex_l", "lumbar_rotation"):
        c = model.anatomy.coordinate_index(name)
        ratio = np.std(solution.coordinates[:, c] - coordinates[:, c]) / sds[:, c].mean()
        # The standard deviation includes a model error that the points do not have.
        assert 0.6 < ratio < 1.1, name


def test_frames_without_enough_points_have_no_coordinates():
    model = model_of()
    person = points_of(model, gait(model, 5), 0.005)
    usable = person.usable.copy()
    usable[2] = False
    solution = solve(model, replace(person, usable=usable), moving_prior().with_habits(np.zeros(12)))
    assert np.isfinite(solution.coordinates).all(axis=1).tolist() == [True, True, False, True, True]


def test_a_gross_outlier_moves_the_angles_of_its_limb_only():
    model = model_of()
    coordinates = gait(model, 3)
    person = points_of(model, coordinates, 0.005)
    points = person.points_m.copy()
    points[:, model.keypoints.index("left_wrist")] += 1.0
    prior = moving_prior().with_habits(np.zeros(12))
    clean, disturbed = solve(model, person, prior), solve(model, replace(person, points_m=points), prior)
    knee = model.anatomy.coordinate_index("knee_angle_r")
    assert np.degrees(np.abs(disturbed.coordinates - clean.coordinates))[:, knee].max() < 1.0


def test_animals_have_no_model():
    assert marker_model(find_skeleton("mouse_22")) is None
    assert model_of("coco_17").keypoints[-1] == "right_ankle"
