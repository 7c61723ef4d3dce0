"""Runs that are killed during the calibration or the synchronization repeat no finished part."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse import Options, RunOptions
from posefuse.io.keypoints import native
from posefuse.pipeline import detect_board
from posefuse.pipeline.run import recipe
from tests.boards import SPEC, board_detections, render, small_rig

_CHILD = """
import os, signal, sys
import posefuse
from posefuse import Options, RunOptions
from posefuse.pipeline import calibrate_board
from posefuse.pipeline.run import recipe

def kill(*_, **__):
    os.kill(os.getpid(), signal.SIGKILL)

folder, output, board, stage = sys.argv[1:]
if stage == "calibrate":
    calibrate_board.calibrate_board = kill
else:
    recipe.measure = kill
posefuse.run(folder, output, RunOptions(board=board), Options(solve="frame"))
"""


@pytest.fixture
def session(tmp_path):
    """Keypoints, and videos of a board."""
    folder = tmp_path / "take"
    folder.mkdir()
    native.write(board_detections(small_rig(), n_frames=30, noise_px=0.5), folder / "keypoints.nc")
    render(small_rig(), folder / "calibration")
    return folder


@pytest.mark.parametrize("stage", ["calibrate", pytest.param("synchronize", marks=pytest.mark.long)])
def test_finished_parts_are_kept(session, tmp_path, monkeypatch, stage):
    monkeypatch.setenv("POSEFUSE_CACHE", str(tmp_path / "cache"))
    output = tmp_path / "out"
    call = [sys.executable, "-c", _CHILD, str(session), str(output), SPEC, stage]
    done = subprocess.run(call, capture_output=True, check=False, env=os.environ, timeout=120)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    assert (output / "calibration.toml").exists() == (stage == "synchronize")

    def repeated(*_, **__):
        raise AssertionError("The corners of the board were detected again.")

    monkeypatch.setattr(detect_board, "_examine", repeated)
    if stage == "synchronize":
        monkeypatch.setattr(recipe, "calibrate_board", repeated)
    outcome = posefuse.run(session, output, RunOptions(board=SPEC), Options(solve="frame"))
    assert ("calibrate" in outcome.kept) == (stage == "synchronize")
    assert outcome.reconstruction is not None
    assert np.isfinite(outcome.reconstruction.open().layers["measured"].points_m[:]).any()
    assert not list(Path(output).glob("*.tmp*"))
