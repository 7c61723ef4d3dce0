"""``posefuse refine-calibration`` on the command line: a rotated camera is corrected, in the format of the input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.calibration.gauge import pose_changes
from posefuse.io.calibration import pose2sim
from posefuse.io.keypoints import native
from posefuse.model.cameras import CameraRig, rotation_from_vector
from posefuse.model.detections import Detections
from tests.scenes import ring, skeleton_of

TURN_DEG = 1.0


def rotate_camera(rig: CameraRig) -> CameraRig:
    """Return the rig with its third camera rotated."""
    camera = rig.cameras[2]
    pose = camera.camera_from_world.copy()
    pose[:3] = rotation_from_vector(np.radians([0.0, TURN_DEG, 0.0])) @ pose[:3]
    return replace(rig, cameras=(*rig.cameras[:2], replace(camera, camera_from_world=pose), *rig.cameras[3:]))


@pytest.fixture
def truth() -> CameraRig:
    return replace(ring(4), up_axis="z")


@pytest.fixture
def turned_recording(tmp_path, truth, rng) -> Path:
    """Return a folder of random points in four views, with a calibration in which one camera is rotated by a degree."""
    folder = tmp_path / "recording"
    folder.mkdir()
    skeleton = skeleton_of(8)
    points = rng.uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 2.0], (40, 8, 3))
    pixels = truth.project(points)
    pixels += rng.normal(0.0, 1.0, pixels.shape)
    native.write(Detections.from_dense(skeleton, truth.names, pixels, rate_hz=30.0), folder / "keypoints.nc")
    pose2sim.write(rotate_camera(truth), folder / "Calib.toml")
    return folder


def test_turned_camera_is_corrected_and_the_input_is_kept(run, turned_recording, truth, tmp_path):
    before = (turned_recording / "Calib.toml").read_bytes()
    refined = tmp_path / "refined.toml"
    code, out, err = run("refine-calibration", turned_recording, "--output", refined, "--people", "one")
    assert code == 0, err
    assert (turned_recording / "Calib.toml").read_bytes() == before
    assert "px before" in out
    assert "in the format pose2sim" in " ".join(out.split())
    rig = posefuse.read_cameras(refined)
    assert np.degrees(np.abs(pose_changes(truth, rig)[:, :3]).max()) < 0.2 * TURN_DEG
    assert "SHA-256" in rig.notes[0]


def test_two_processes_write_the_same(run, turned_recording, tmp_path):
    """One checks the recording while the other refines."""
    printed = []
    for jobs in (1, 2):
        refined = tmp_path / f"{jobs}.toml"
        code, out, err = run("refine-calibration", turned_recording, "-o", refined, "--people", "one", "--jobs", jobs)
        assert code == 0, err
        printed.append(out.replace(str(refined), ""))
    assert printed[0] == printed[1]
    assert (tmp_path / "1.toml").read_bytes() == (tmp_path / "2.toml").read_bytes()


def test_input_calibration_is_not_overwritten(run, turned_recording):
    place = turned_recording / "Calib.toml"
    before = place.read_bytes()
    code, _, err = run("refine-calibration", turned_recording, "--output", place)
    assert code != 0
    assert "Choose another file" in err
    assert place.read_bytes() == before


def test_unknown_fixed_camera_is_an_error_and_nothing_is_written(run, turned_recording, tmp_path):
    refined = tmp_path / "refined.toml"
    code, _, err = run("refine-calibration", turned_recording, "--output", refined, "--fix", "cam_7")
    assert code != 0
    assert "cam_7" in err
    assert not refined.exists()
