"""A real Anipose calibration: reprojection errors confirm its conventions."""

import h5py
import numpy as np
import pytest

import posefuse
from posefuse.skeleton.skeletons import Skeleton


def test_correct_mouse_calibration_has_small_reprojection_errors(shared_data):
    folder = shared_data("sleap_mouse")
    rig = posefuse.read_cameras(folder / "calibration_0b26179_good.toml")
    assert rig.names == ("back", "mid", "side", "top")
    assert rig.up_axis is None
    views, names = [], []
    for name in rig.names:
        with h5py.File(next((folder / name).glob("*.analysis.h5"))) as file:
            views.append(np.asarray(file["tracks"])[0].transpose(2, 1, 0))
            names = [node.decode() for node in file["node_names"][:]]
    detections = posefuse.Detections.from_dense(Skeleton("mouse", tuple(names)), rig.names, np.stack(views, axis=1))
    layer = posefuse.reconstruct(rig, detections).layers["measured"]
    error = np.nanmedian(layer.reprojection_error_px)
    assert 3 < error < 9
    extent = np.nanmax(layer.points_m, axis=2) - np.nanmin(layer.points_m, axis=2)
    assert 0.03 < np.nanmedian(np.linalg.norm(extent, axis=-1)) < 0.3


@pytest.mark.parametrize("name", ["calibration.toml", "calibration_0b26179_good.toml"])
def test_camera_distances_are_plausible_in_millimeters(name, shared_data):
    """Anipose calibrations are in millimeters by default, so that the cameras are some decimeters apart."""
    rig = posefuse.read_cameras(shared_data("sleap_mouse") / name)
    assert rig.meters_per_unit == 0.001
    centers = np.array([camera.center_m for camera in rig.cameras])
    assert 0.1 < np.linalg.norm(centers - centers[0], axis=1).max() < 2.0
