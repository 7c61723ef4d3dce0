"""Calibrations of other programs: the same rig from every format, and error messages."""

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.errors import FileError, PosefuseError
from posefuse.io.recording import find_recording
from posefuse.model.cameras import Camera
from tests import calibrations
from tests.broken import broken
from tests.calibrations import WRITERS, rig_for

FISHEYE = ("caliscope_new", "opencv_yaml", "acinoset", "scene", "scene_of_poses", "old_scene", "kalibr")
UP = {"vicon": "z", "panoptic": "-y", "pose2sim": "z", "qualisys": "z"}


@pytest.mark.parametrize(
    ("name", "lens"),
    [(name, "mild") for name in WRITERS if name != "acinoset"] + [(name, "fisheye") for name in FISHEYE],
)
def test_same_rig_from_every_format(name, lens, tmp_path):
    rig = rig_for(name, lens)
    read_rig = read_cameras(WRITERS[name](rig, tmp_path / "calibration"))
    assert read_rig.names == rig.names
    assert read_rig.up_axis == UP.get(name)
    for a, b in zip(read_rig.cameras, rig.cameras, strict=True):
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


def test_conflicting_file_endings_are_an_error(tmp_path):
    folder = calibrations.mc_dev(rig_for("mc_dev"), tmp_path)
    shutil.copy(folder / "left_0.mp4.calib", folder / "left_0.mp4-mocAligned.calib")
    with pytest.raises(FileError, match="several endings"):
        read_cameras(folder)
    assert read_cameras(folder / "left_0.mp4-mocAligned.calib").names == ("left_0",)


def test_unknown_extrinsic_format_is_an_error(tmp_path):
    path = calibrations.scene(rig_for("scene"), tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"extrinsic_format": "opencv"}))
    with pytest.raises(FileError, match=r"extrinsic_format is 'opencv'. Choose one of: opencv_world_to_camera"):
        read_cameras(path)


def read_broken(name: str, folder: Path, cases: int) -> int:
    """Read a number of damaged files of a format and return how many were accepted."""
    path = WRITERS[name](rig_for(name, "fisheye" if name == "acinoset" else "mild"), folder)
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    rng = np.random.default_rng(len(name))
    read = 0
    for case in range(cases):
        file = files[case % len(files)]
        original = file.read_bytes()
        file.write_bytes(broken(original, rng))
        try:
            rig = read_cameras(path)
        except PosefuseError:
            pass
        else:
            assert all(isinstance(camera, Camera) for camera in rig.cameras)
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
