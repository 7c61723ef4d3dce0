"""Poses of cameras from points of known position, measured in the pictures of a real scene.

A plate of 2.0 x 0.6 m lies on a treadmill, with a bar of 5 cm along its middle. The eight points are its four corners,
and the bottom and top of both ends of the bar. Their places were measured by hand in enlarged pictures, to 1 or 2 px;
two corners are hidden. The places of the bar's middle are the mean of its sides, 11 mm to the left and right.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posefuse

N = (np.nan, np.nan)
IMAGE_PX = {
    "cam01": [N, (227.9, 971.7), (230.4, 950.7), (118.3, 981.0), (833.0, 1443.5), (717.2, 1481.0), (721.8, 1458.5),
              (577.0, 1524.0)],
    "cam02": [(720.0, 998.0), (617.8, 996.5), (619.0, 979.8), (521.5, 994.5), N, (469.5, 1358.5), (469.3, 1334.0),
              (318.5, 1347.5)],
    "cam03": [(829.5, 1496.5), (922.0, 1407.5), (922.5, 1384.5), (992.5, 1330.5), (133.0, 1138.0), (224.3, 1085.3),
              (224.3, 1070.8), (312.0, 1043.0)],
    "cam04": [(385.5, 1616.0), (537.5, 1603.5), (528.2, 1582.5), (711.5, 1588.5), (631.0, 1005.5), (733.1, 976.0),
              (726.6, 964.0), (841.5, 950.0)],
}  # fmt: skip
WORLD_M = [[-2, 0.3, 0], [-2, 0, 0], [-2, 0, 0.05], [-2, -0.3, 0], [0, 0.3, 0], [0, 0, 0], [0, 0, 0.05], [0, -0.3, 0]]


@pytest.fixture
def scene():
    pixels = {name: np.array(places) for name, places in IMAGE_PX.items()}
    return posefuse.ScenePoints(np.array(WORLD_M, dtype=float), pixels, "z")


@pytest.fixture
def calibration(shared_data):
    return shared_data("pose2sim_videos") / "calibration"


def centers_from(found, truth):
    """Distances of the centers after a rigid alignment of the two worlds, in m."""
    a, b = (np.array([camera.center_m for camera in rig.cameras]) for rig in (found, truth))
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    return np.linalg.norm(Rotation.align_vectors(b, a)[0].apply(a) - b, axis=1)


def test_poses_from_points_with_given_lenses(scene, calibration):
    """Qualisys' cameras see the plate 12 px from where it is stated to lie, and not all in the same direction.

    No position of the plate explains its pictures with Qualisys' poses to less than that, so the difference of 0.7
    degrees and of several centimeters is theirs as much as ours, and most of it is common to all cameras.
    """
    truth = posefuse.read_cameras(calibration / "Calib.qca.txt")
    result = posefuse.calibrate_scene(scene, intrinsics=truth)
    assert result.error_px < 2.5
    for found, reference, report in zip(result.rig.cameras, truth.cameras, result.cameras, strict=True):
        turn = Rotation.from_matrix(found.rotation @ reference.rotation.T).magnitude()
        assert np.degrees(turn) < 0.85
        assert np.linalg.norm(found.center_m - reference.center_m) < 0.11
        assert report.center_sd_m < 0.04
    assert np.median(centers_from(result.rig, truth)) < 0.03


def test_poses_from_points_with_lenses_from_pictures(scene, calibration):
    """The pictures of the checkerboard give focal lengths within 0.7 %, but principal points 20 to 50 px away."""
    truth = posefuse.read_cameras(calibration / "Calib.qca.txt")
    result = posefuse.calibrate_scene(scene, calibration / "intrinsics", "checkerboard:4x7,square=60mm")
    assert result.rig.names == ("cam01", "cam02", "cam03", "cam04")
    assert result.error_px < 2.5
    assert all("cx_px" in each.parameters for each in result.rig.covariances)
    assert np.median(centers_from(result.rig, truth)) < 0.05
