"""``posefuse board`` and ``posefuse calibrate`` on rendered videos of a board."""

import re

import numpy as np
import pytest

import posefuse
from posefuse.cli.main import main
from posefuse.io.calibration.anipose import write
from tests.boards import SPEC, render, small_rig


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board") / "videos"
    render(small_rig(), folder)
    return folder


def test_calibrate_writes_the_cameras(videos, tmp_path, capsys):
    lenses = tmp_path / "lenses.toml"
    write(small_rig(), lenses)
    output = tmp_path / "calibration.toml"
    main(["calibrate", str(videos), "--board", SPEC, "--intrinsics", str(lenses), "-o", str(output), "--jobs", "1"])
    text = capsys.readouterr().out
    assert "2 cameras" in text
    assert "in 16 frames" in text
    found, truth = posefuse.read_cameras(output), small_rig()
    distance = [np.linalg.norm(rig.cameras[0].center_m - rig.cameras[1].center_m) for rig in (found, truth)]
    assert distance[0] == pytest.approx(distance[1], rel=0.005)
    assert any("Calibrated by posefuse" in note for note in found.notes)


def test_number_of_processes_does_not_change_the_bytes(videos, tmp_path, capsys):
    lenses = tmp_path / "lenses.toml"
    write(small_rig(), lenses)
    files = [tmp_path / f"jobs_{jobs}.toml" for jobs in (1, 2)]
    for jobs, file in zip("12", files, strict=True):
        main(["calibrate", str(videos), "--board", SPEC, "--intrinsics", str(lenses), "-o", str(file), "--jobs", jobs])
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("charuco:6x5,square=80mm,dict=5X5_50", "write dict=4X4_50"),
        ("charuco:6x5,square=80mm,inverted", "remove inverted"),
        ("charuco:6x5,square=80", "a length with its unit"),
    ],
)
def test_wrong_boards_are_explained(spec, message, videos, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", str(videos), "--board", spec, "-o", str(tmp_path / "c.toml"), "--jobs", "1"])
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "c.toml").exists()


def test_mirrored_videos_are_named(tmp_path, capsys):
    render(small_rig(), tmp_path / "videos", mirrored=True)
    with pytest.raises(SystemExit):
        main(["calibrate", str(tmp_path / "videos"), "--board", SPEC, "-o", str(tmp_path / "c.toml"), "--jobs", "1"])
    assert "mirrored" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["board.pdf", "board.svg"])
def test_board_is_drawn_in_true_size(name, tmp_path, capsys):
    output = tmp_path / name
    main(["board", SPEC, "-o", str(output)])
    assert "480 x 400 mm" in capsys.readouterr().out
    again = tmp_path / f"again.{name[-3:]}"
    main(["board", SPEC, "-o", str(again)])
    assert output.read_bytes() == again.read_bytes()
    if name.endswith("svg"):
        width_pt = float(re.findall(r'width="([0-9.]+)pt"', output.read_text())[0])
        assert width_pt / 72 * 25.4 == pytest.approx(480 + 24, abs=0.5)
    else:
        box = re.findall(rb"/MediaBox \[ 0 0 ([0-9.]+)", output.read_bytes())[0]
        assert float(box) / 72 * 25.4 == pytest.approx(480 + 24, abs=0.5)


def test_board_needs_a_known_ending(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["board", SPEC, "-o", str(tmp_path / "board.png")])
    assert ".pdf, .svg" in capsys.readouterr().err


def test_folder_without_images_is_an_error(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", str(tmp_path), "--board", SPEC, "-o", str(tmp_path / "c.toml")])
    assert "neither videos" in capsys.readouterr().err
