"""The recipes of docs/freemocap.md give the points of FreeMoCap's rules, by naive implementations of them."""

import re
import shlex
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from benchmarks.freemocap import Case, write_inputs
from benchmarks.rejection import freemocap_ring
from benchmarks.walking import walk
from scipy.signal import butter, filtfilt

import posefuse
from tests.conftest import ROOT
from tests.reference import rejection

PAGE = (ROOT / "docs" / "freemocap.md").read_text("utf-8")
KEYPOINTS = (0, 11, 16, 25)
MM_ARRAY = "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
FRAMES = 24


def block(language: str) -> str:
    """Return the only block of a language."""
    found = re.findall(rf"(?s)```{language}\n(.*?)```", PAGE)
    assert len(found) == 1
    return found[0]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with RECORDING as FreeMoCap writes it, and its simulated data."""
    folder = tmp_path_factory.mktemp("freemocap")
    recording = folder / "RECORDING"
    data = walk(FRAMES, rig=freemocap_ring(5), outlier_share=0.1, missing_share=0.1, skeleton="mediapipe_33", seed=6)
    raw = recording / "output_data" / "raw_data"
    raw.mkdir(parents=True)
    (recording / "synchronized_videos").mkdir()
    for name in data.rig.names:
        (recording / "synchronized_videos" / f"{name}.mp4").touch()
    rig = write_inputs(Case("", data.rig, data.pixels, None), recording)
    (recording / "calibration.toml").rename(recording / "rec_camera_calibration.toml")
    pixels = np.load(recording / "points.npy")
    (recording / "points.npy").unlink()
    np.save(raw / MM_ARRAY, np.concatenate([pixels, np.zeros((*pixels.shape[:3], 1))], axis=-1))
    return folder, in_mm(rig), data.pixels


def in_mm(rig):
    """Return the rig with the numbers that FreeMoCap sees, because linear points depend on the unit."""
    scale = np.ones((4, 4))
    scale[:3, 3] = 1000.0
    cameras = [replace(camera, camera_from_world=scale * camera.camera_from_world) for camera in rig.cameras]
    return replace(rig, cameras=tuple(cameras))


def test_command_gives_the_points_of_the_program(recorded):
    folder, rig_mm, pixels = recorded
    arguments = shlex.split(block("sh"))
    assert arguments[0] == "posefuse"
    command = [sys.executable, "-m", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result = posefuse.read_reconstruction(folder / "OUT" / "reconstruction.nc")
    measured, solved = (1000 * np.asarray(result.layers[name].points_m)[:, 0] for name in ("measured", "solved"))
    for keypoint in KEYPOINTS:
        expected = np.array(
            [rejection.program_weighted_subsets(rig_mm, pixels[f, :, keypoint], 0.01, 1, 3) for f in range(FRAMES)]
        )
        np.testing.assert_array_equal(np.isnan(measured[:, keypoint]), np.isnan(expected))
        np.testing.assert_allclose(measured[:, keypoint], expected, atol=1e-3)
        first, last = np.flatnonzero(np.isfinite(expected[:, 0]))[[0, -1]]
        span = slice(first, last + 1)
        filled = pd.DataFrame(expected[span]).interpolate("linear").to_numpy()
        smooth = filtfilt(*butter(4, 7.0, fs=30.0), filled, axis=0)
        # The page rounds the cutoff.
        np.testing.assert_allclose(solved[span, keypoint], smooth, atol=0.1)


def test_snippet_gives_the_points_of_the_program(recorded, monkeypatch):
    folder, rig_mm, pixels = recorded
    monkeypatch.chdir(folder)
    names: dict = {}
    exec(block("python"), names)
    body = np.moveaxis(pixels[:, :, :33], 2, 1)
    expected = rejection.program_percentile_filter(rig_mm, body.reshape(-1, 5, 2), 90.0, 3).reshape(FRAMES, 33, 3)
    assert 0.0 < np.isnan(expected[..., 0]).mean() < 0.5
    np.testing.assert_allclose(names["points_mm"], expected, atol=1e-3)
