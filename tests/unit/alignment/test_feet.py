"""Floor from feet."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.alignment.feet import floor_from_feet, foot_columns
from posefuse.alignment.world_axes import find_alignment
from posefuse.errors import DetectionsError
from posefuse.model.options.alignment import AlignOptions

from .conftest import rotate_points


@pytest.mark.parametrize("seed", range(3))
def test_floor_is_found_in_any_world(walker, true_points, seed):
    rng = np.random.default_rng(seed)
    rotation, shift = Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3)
    noisy = rotate_points(true_points, rotation, shift) + 0.004 * rng.normal(size=true_points.shape)
    wild = rng.random(true_points.shape[:3]) < 0.05
    noisy[wild] += rng.normal(size=(int(wild.sum()), 3))
    plane = floor_from_feet([noisy], walker.truth.skeleton, None)
    assert np.degrees(np.arccos(plane.normal @ rotation[:, 2])) < 1.0
    # Toes and heels are a few centimeters above their soles.
    assert abs((shift - plane.point_m) @ plane.normal) < 0.06


def test_feet_in_one_place_need_an_up_axis(walker, true_points):
    standing = np.broadcast_to(true_points[:1, :, 11:17], (60, 1, 6, 3))
    skeleton = replace(
        walker.truth.skeleton,
        keypoints=walker.truth.skeleton.keypoints[11:17],
        edges=(),
        rigid=(),
        pairs=(),
        chains={},
        derived={},
        plausible_m=(),
        names={},
        core=(),
        tree=None,
        parts=(),
    )
    noisy = standing + 0.002 * np.random.default_rng(0).normal(size=standing.shape)
    with pytest.raises(DetectionsError, match="one line"):
        floor_from_feet([noisy], skeleton, None)
    plane = floor_from_feet([noisy], skeleton, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(plane.normal, [0, 0, 1])
    assert abs(plane.point_m[2]) < 0.1


UP = np.array([0.0, 0.0, 1.0])


def tilt_deg(normal: np.ndarray, up: np.ndarray = UP) -> float:
    return float(np.degrees(np.arccos(min(normal @ up, 1.0))))


def correlated_errors(points: np.ndarray, size_m: float, seed: int) -> np.ndarray:
    """Return errors with a correlation time of about half a second at 30 Hz."""
    rng = np.random.default_rng(seed)
    errors = [rng.normal(size=points.shape[1:])]
    for _ in points[1:]:
        errors.append(0.94 * errors[-1] + np.sqrt(1.0 - 0.94**2) * rng.normal(size=points.shape[1:]))
    return points + size_m * np.array(errors)


@pytest.mark.parametrize("seed", range(3))
def test_uncertain_feet_are_combined_with_the_calibrated_up(walker, true_points, seed):
    noisy, skeleton = correlated_errors(true_points, 0.03, seed), walker.truth.skeleton
    alone = floor_from_feet([noisy], skeleton, None)
    both = floor_from_feet([noisy], skeleton, UP)
    assert alone.tilt_sd_deg > 0.5
    assert tilt_deg(alone.normal) < 3.0 * alone.tilt_sd_deg
    assert both.uses_up
    assert tilt_deg(both.normal) < tilt_deg(alone.normal)
    assert tilt_deg(both.normal) < 2.0
    # A wrong up axis contradicts the feet and is ignored.
    leaning = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    against = floor_from_feet([noisy], skeleton, leaning)
    assert not against.uses_up
    np.testing.assert_array_equal(against.normal, alone.normal)


def test_certain_feet_override_the_calibrated_up(walker, true_points):
    leaning = np.array([0.0, np.sin(np.radians(2.0)), np.cos(np.radians(2.0))])
    plane = floor_from_feet([true_points], walker.truth.skeleton, leaning)
    assert plane.tilt_sd_deg < 1.0
    assert tilt_deg(plane.normal) < 1.0
    for turn_deg, says in ((0.0, "which is combined with the feet"), (20.0, "which contradicts the feet")):
        rotation = Rotation.from_euler("x", turn_deg, degrees=True).as_matrix()
        steps = find_alignment(
            [true_points @ rotation.T], walker.truth.skeleton, walker.rig, AlignOptions(floor="feet")
        ).steps
        assert says in steps[0]


def test_unknown_heights_of_keypoints_do_not_override_the_calibrated_up(walker, true_points):
    """All frames show the same heights, so that the feet of a standing person look certain."""
    rng = np.random.default_rng(0)
    columns, _ = foot_columns(walker.truth.skeleton)
    standing = np.broadcast_to(true_points[:1], (200, *true_points.shape[1:])).copy()
    standing[:, :, columns, :2] = rng.uniform(-0.2, 0.2, (len(columns), 2))
    standing[:, :, columns, 2] = 0.02 + 0.15 * standing[:, :, columns, 0] * rng.uniform(0.8, 1.2, len(columns))
    noisy = standing + 0.003 * rng.normal(size=standing.shape)
    alone = floor_from_feet([noisy], walker.truth.skeleton, None)
    assert tilt_deg(alone.normal) > 6.0
    plane = floor_from_feet([noisy], walker.truth.skeleton, UP)
    assert plane.uses_up
    assert tilt_deg(plane.normal) < 4.0
