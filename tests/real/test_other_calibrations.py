"""Calibrations of other programs on data that shows whether their conventions are read right."""

import json

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.io.matlab import read_mat
from posefuse.model.cameras import vector_from_rotation


def test_dannce_labels_reproject(shared_data):
    path = shared_data("dannce_mouse") / "label3d_demo.mat"
    rig = read_cameras(path)
    errors = []
    for camera, cell in zip(rig.cameras, read_mat(path, ("labelData",))["labelData"].ravel(), strict=True):
        labels = cell.ravel()[0] if isinstance(cell, np.ndarray) else cell
        points_m = 0.001 * labels["data_3d"].reshape(-1, 3)
        pixels = labels["data_2d"].reshape(-1, 2)
        errors.append(np.nanmedian(np.linalg.norm(camera.project(points_m)[0] - pixels, axis=-1)))
    assert max(errors) < 1e-6  # the demonstration's labels are projected points


def test_fisheye_views_agree(shared_data):
    folder = shared_data("calibration_formats") / "acinoset_fisheye"
    rig = read_cameras(folder / "4_cam_scene_sba_thursday_kiara.json")
    corners = json.loads((folder / "corners_cam1_cam2_subset.json").read_text())
    first, second = (np.array([corners[name][k] for k in corners["cam1"]]) for name in ("cam1", "cam2"))
    errors = []
    pair = rig.select(["cam1", "cam2"])
    for a, b in zip(first.reshape(-1, 2), second.reshape(-1, 2), strict=True):
        point = nearest_to_rays(pair, [a, b])
        errors += [np.linalg.norm(pair.project(point)[v] - pixel) for v, pixel in enumerate((a, b))]
    assert np.median(errors) < 0.85


def nearest_to_rays(rig, pixels) -> np.ndarray:
    system, right = np.zeros((3, 3)), np.zeros(3)
    for camera, pixel in zip(rig.cameras, pixels, strict=True):
        direction = camera.rotation.T @ camera.rays(pixel)[0]
        across = np.eye(3) - np.outer(direction, direction)
        system += across
        right += across @ camera.center_m
    return np.linalg.solve(system, right)


def test_both_rotation_formats_of_caliscope_agree(shared_data, tmp_path):
    path = shared_data("caliscope_webcams") / "config.toml"
    rig = read_cameras(path)
    text = path.read_text()
    start = text.index("rotation = [ [")
    for camera in rig.cameras:
        start = text.index("rotation = [ [", start)
        end = text.index("\n", start)
        text = text[:start] + f"rotation = {vector_from_rotation(camera.rotation).tolist()}" + text[end:]
    (tmp_path / "config.toml").write_text(text)
    for a, b in zip(read_cameras(tmp_path / "config.toml").cameras, rig.cameras, strict=True):
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-12)


@pytest.mark.parametrize(
    ("path", "unit", "names"),
    [
        ("easymocap", None, ("2", "3", "4", "5", "6", "7")),
        ("avian/utils/extrinsic_calib_v2.yaml", None, tuple(f"cam{i}" for i in range(8))),
        (
            "wildtrack/ms_glmb_ukf/wildtrack/calibrations/intrinsic_zero",
            "cm",
            ("CVLab1", "CVLab2", "CVLab3", "CVLab4", "IDIAP1", "IDIAP2", "IDIAP3"),
        ),
    ],
)
def test_optical_axes_of_a_scene_meet(shared_data, path, unit, names):
    rig = read_cameras(shared_data("calibration_formats") / path, length_unit=unit)
    assert rig.names == names
    middle = nearest_to_rays(rig, [camera.matrix[:2, 2] for camera in rig.cameras])
    depths = [(camera.rotation @ middle + camera.translation_m)[2] for camera in rig.cameras]
    assert min(depths) > 1.0
    assert max(depths) < 30.0
