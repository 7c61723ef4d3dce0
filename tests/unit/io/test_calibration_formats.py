"""Calibrations of other programs: the same rig from every format, and error messages."""

import json
import pickle
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.errors import FileError, PosefuseError
from posefuse.io.calibration.projections import decompose_projection
from posefuse.io.recording import find_recording
from posefuse.model.cameras import Camera, CameraRig, LensModel
from tests import calibrations
from tests.broken import broken
from tests.calibrations import WRITERS
from tests.scenes import ring

FISHEYE = ("caliscope_new", "opencv_yaml", "acinoset", "scene", "scene_of_poses", "old_scene", "kalibr")
RENAMED = {
    "acinoset": "cam{}", "kalibr": "cam{}", "projections": "{}", "caliscope_old": "cam_{}", "caliscope_new": "cam_{}",
}  # fmt: skip
UP = {"vicon": "z", "panoptic": "-y", "pose2sim": "z", "qualisys": "z"}


def rig_for(name: str, lens: str = "mild") -> CameraRig:
    """A rig as the format can hold it."""
    cameras = []
    first = 1 if name == "acinoset" else 0
    world = ring(3).cameras[0].camera_from_world if name == "kalibr" else np.eye(4)
    for i, camera in enumerate(ring(3, lens).cameras):
        distortion = camera.distortion
        if camera.lens is LensModel.BROWN and name in ("kalibr", "pose2sim"):
            distortion = (*distortion[:4], 0.0)
        if name == "vicon":
            distortion = (*distortion[:2], 0.0, 0.0, 0.003)
        pose = camera.camera_from_world @ np.linalg.inv(world)
        called = RENAMED.get(name, "left_{}").format(i + first)
        size = (round(2 * camera.matrix[0, 2]), round(2 * camera.matrix[1, 2]))
        camera = replace(camera, name=called, distortion=distortion, camera_from_world=pose, size_px=size)
        if name.startswith("projection"):
            camera = replace(camera, lens=LensModel.PINHOLE, distortion=())
        cameras.append(camera)
    return CameraRig(tuple(cameras))


@pytest.mark.parametrize(
    ("name", "lens"),
    [(name, "mild") for name in WRITERS if name != "acinoset"] + [(name, "fisheye") for name in FISHEYE],
)
def test_same_rig_from_every_format(name, lens, tmp_path):
    rig = rig_for(name, lens)
    found = read_cameras(WRITERS[name](rig, tmp_path / "calibration"))
    assert found.names == rig.names
    assert found.up_axis == UP.get(name)
    for a, b in zip(found.cameras, rig.cameras, strict=True):
        np.testing.assert_allclose(a.matrix, b.matrix, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-9)
        np.testing.assert_allclose(a.distortion, b.distortion, atol=1e-12)
        assert (a.lens, a.size_px) == (b.lens, b.size_px)


@pytest.mark.parametrize("name", [name for name in WRITERS if name not in ("projections",)])
def test_recording_with_one_calibration_finds_one(name, tmp_path):
    WRITERS[name](rig_for(name, "fisheye" if name == "acinoset" else "mild"), tmp_path / "calibration")
    assert len(find_recording(tmp_path).calibrations) == 1


def test_one_file_selects_all(tmp_path):
    for name in ("easymocap", "opencv_yaml", "mc_dev", "opencap", "projection_texts", "opencv_xml"):
        folder = tmp_path / name
        WRITERS[name](rig_for(name), folder)
        one = min(file for file in folder.rglob("*") if file.is_file())
        assert len(read_cameras(one)) == 3, name


def test_vicon_radial_distortion_has_two_or_three_coefficients(tmp_path):
    path = calibrations.vicon(rig_for("vicon"), tmp_path)
    text = path.read_text()
    for given, read in (("VICON_RADIAL2='w 7 8 0.1 -0.2'", (0.1, -0.2, 0.0, 0.0, 0.0)),
                        ("VICON_RADIAL2='w 7 8 0.1 -0.2 0.3'", (0.1, -0.2, 0.0, 0.0, 0.3)),
                        ("VICON_RADIAL='0.1 -0.2'", (0.1, -0.2, 0.0, 0.0, 0.0))):  # fmt: skip
        path.write_text(re.sub('VICON_RADIAL2="[^"]*"', given, text))
        assert {camera.distortion for camera in read_cameras(path).cameras} == {read}


def test_pickled_code_is_not_executed(tmp_path):
    class Evil:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "ran",))

    path = tmp_path / "Cam0" / "cameraIntrinsicsExtrinsics.pickle"
    path.parent.mkdir()
    path.write_bytes(pickle.dumps({"intrinsicMat": Evil()}))
    with pytest.raises(FileError, match="not allowed"):
        read_cameras(path)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "text",
    [
        "a: &x [1, 2]\nb: *x\n",
        "!!python/object/apply:os.system ['true']\n",
        "cam0: {camera_model: pinhole, intrinsics: !!opencv-matrix {rows: 9, cols: 9, data: [1]}}\n",
    ],
)
def test_yaml_with_aliases_or_objects_is_an_error(text, tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(text)
    with pytest.raises(FileError, match="not valid YAML"):
        read_cameras(path)


def test_two_lenses_of_a_camera_are_an_error(tmp_path):
    folder = calibrations.opencv_xml(rig_for("opencv_xml"), tmp_path)
    shutil.copytree(folder / "intrinsic", folder / "intrinsic_other")
    with pytest.raises(FileError, match="intrinsic/intr_left_0.xml and intrinsic_other"):
        read_cameras(folder)
    assert len(read_cameras(folder / "intrinsic_other")) == 3


def test_two_endings_are_an_error(tmp_path):
    folder = calibrations.mc_dev(rig_for("mc_dev"), tmp_path)
    shutil.copy(folder / "left_0.mp4.calib", folder / "left_0.mp4-mocAligned.calib")
    with pytest.raises(FileError, match="several endings"):
        read_cameras(folder)
    assert read_cameras(folder / "left_0.mp4-mocAligned.calib").names == ("left_0",)


def test_caliscope_leaves_out_ignored_and_unposed_cameras(tmp_path):
    path = calibrations.caliscope_old(rig_for("caliscope_old"), tmp_path)
    path.write_text(path.read_text().replace("ignore = false", "ignore = true", 1))
    found = read_cameras(path)
    assert found.names == ("cam_1", "cam_2")
    assert "cam_0" in found.notes[0]


def test_an_unknown_extrinsic_format_is_an_error(tmp_path):
    path = calibrations.scene(rig_for("scene"), tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"extrinsic_format": "opencv"}))
    with pytest.raises(FileError, match=r"extrinsic_format is 'opencv'. Choose one of: opencv_world_to_camera"):
        read_cameras(path)


def test_averaged_rotation_vectors_give_a_note(tmp_path):
    path = calibrations.parameter_table(rig_for("parameter_table"), tmp_path)
    assert "biased" in read_cameras(path).notes[0]


def test_unsupported_kalibr_model_error_lists_the_supported_ones(tmp_path):
    path = calibrations.kalibr(rig_for("kalibr"), tmp_path)
    path.write_text(path.read_text().replace("pinhole", "omni", 1))
    with pytest.raises(FileError, match="cam0: camera model 'omni'"):
        read_cameras(path)


@pytest.mark.parametrize("factor", [1.0, -1.0, 1e-3, -250.0])
def test_projection_is_decomposed_at_any_scale(factor):
    camera = ring(3).cameras[1]
    projection = factor * camera.matrix @ camera.camera_from_world[:3]
    matrix, rotation, translation = decompose_projection(projection, "here")
    np.testing.assert_allclose(matrix, camera.matrix, atol=1e-8)
    np.testing.assert_allclose(rotation, camera.rotation, atol=1e-12)
    np.testing.assert_allclose(translation, camera.translation_m, atol=1e-10)


def test_invalid_projection_is_an_error():
    with pytest.raises(FileError, match="is not a projection matrix"):
        decompose_projection(np.zeros((3, 4)), "here")


def read_broken(name: str, folder: Path, cases: int) -> int:
    """Read so many broken files of a format; how many were still read."""
    path = WRITERS[name](rig_for(name, "fisheye" if name == "acinoset" else "mild"), folder)
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    rng = np.random.default_rng(len(name))
    read = 0
    for case in range(cases):
        file = files[case % len(files)]
        original = file.read_bytes()
        file.write_bytes(broken(original, rng))
        try:
            found = read_cameras(path)
        except PosefuseError:
            pass
        else:
            assert all(isinstance(camera, Camera) for camera in found.cameras)
            read += 1
        file.write_bytes(original)
    return read


@pytest.mark.parametrize("name", WRITERS)
def test_corrupt_files_are_errors(name, tmp_path):
    assert read_broken(name, tmp_path / "c", 200) < 200


@pytest.mark.long
@pytest.mark.parametrize("name", WRITERS)
def test_many_corrupt_files(name, tmp_path):
    assert read_broken(name, tmp_path / "c", 10_000) < 10_000
