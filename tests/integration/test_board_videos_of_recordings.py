"""Recordings with videos of a board instead of a calibration."""

import shutil

import numpy as np
import pytest

import posefuse
from posefuse.io.keypoints import native
from tests.boards import SPEC, board_detections, render, small_rig

FAST = ("--solve", "frame", "--pairs", "labels", "--accept-findings")


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board") / "videos"
    render(small_rig(), folder)
    return folder


@pytest.fixture
def session(tmp_path, videos):
    """Two recordings, and the videos of a board beside them."""
    detections = board_detections(small_rig(), n_frames=30, noise_px=0.5)
    for name in ("one", "two"):
        folder = tmp_path / "session" / name
        folder.mkdir(parents=True)
        native.write(detections, folder / "keypoints.nc")
    shutil.copytree(videos, tmp_path / "session" / "calibration")
    return tmp_path / "session"


def test_message_names_the_command(session, tmp_path, run):
    code, _, err = run("reconstruct", session / "one", "-o", tmp_path / "out")
    assert code == 1
    assert f"posefuse calibrate {session / 'calibration'} --board charuco:" in err
    assert "--board" in err
    assert not (tmp_path / "out").exists()


def test_board_is_used_and_the_calibration_is_kept(session, tmp_path, run):
    shutil.move(session / "calibration", session / "one" / "calibration")
    code, _, err = run("reconstruct", session / "one", "-o", tmp_path / "out", "--board", SPEC, *FAST)
    assert code == 0, err
    rig = posefuse.read_cameras(session / "one" / "calibration.toml")
    assert rig.names == ("cam_0", "cam_1")
    assert (session / "one" / "calibration.html").is_file()
    result = posefuse.read_reconstruction(tmp_path / "out" / "reconstruction.nc")
    assert np.isfinite(result.layers["measured"].points_m[:]).any()
    # The next command finds the calibration.
    code, _, err = run("reconstruct", session / "one", "-o", tmp_path / "again", *FAST)
    assert code == 0, err


def test_batch_calibrates_once_for_a_session(session, tmp_path, run, monkeypatch):
    from posefuse.pipeline import calibrate_board

    (session / "calibration" / "board.toml").write_text(
        '[board]\nkind = "charuco"\ncolumns = 6\nrows = 5\nsquare_m = 0.08\n'
    )
    calls = []
    calibrate = calibrate_board.calibrate_by_board
    monkeypatch.setattr(calibrate_board, "calibrate_by_board", lambda *a, **k: (calls.append(a), calibrate(*a, **k))[1])
    code, out, err = run("batch", session / "one", session / "two", "-o", tmp_path / "out", "--jobs", "1", *FAST)
    assert code == 0, out + err
    assert len(calls) == 1
    assert (session / "calibration" / "calibration.toml").is_file()
    results = [tmp_path / "out" / name / "keypoints.csv" for name in ("one", "two")]
    assert results[0].read_bytes() == results[1].read_bytes()


def test_batch_states_why_a_calibration_failed(session, tmp_path, run):
    board = "charuco:6x5,square=80mm,dict=5X5_50"
    code, _, err = run("batch", session / "one", session / "two", "-o", tmp_path / "out", "--board", board, *FAST)
    assert code == 1
    for name in ("one", "two"):
        assert f"failed: {name}: No image shows the board {board[:20]}" in err
    assert not (session / "calibration" / "calibration.toml").exists()
