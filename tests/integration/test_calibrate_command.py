"""``posefuse board`` and ``posefuse calibrate`` on rendered videos of a board."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import posefuse
from posefuse.cli.main import main
from posefuse.io.board_specs import read_board_spec
from posefuse.io.calibration.anipose import write
from posefuse.io.videos.writer import write_video
from posefuse.model.cameras import Camera, CameraRig
from tests.boards import RATE_HZ, board_poses, board_rig, picture

SPEC = "charuco:6x5,square=80mm"
PX_PER_M, MARGIN_PX = 1000.0, 60
N_FRAMES = 16
SIZE_PX = (960, 540)


def small_rig(n: int = 2) -> CameraRig:
    """Pinhole cameras with small images, which a homography renders exactly."""
    cameras = []
    for camera in board_rig(n).cameras:
        matrix = camera.matrix * 0.75
        matrix[2, 2] = 1.0
        cameras.append(Camera(camera.name, SIZE_PX, matrix, camera.camera_from_world))
    return CameraRig(tuple(cameras))


def render(rig: CameraRig, folder: Path, spec: str = SPEC, *, mirrored: bool = False) -> None:
    """Write one video per camera of a board that is carried about."""
    drawn = picture(read_board_spec(spec), PX_PER_M, MARGIN_PX)
    times = 0.6 * np.arange(N_FRAMES)
    rotations, origins = board_poses(times)
    board_from_picture = np.array(
        [
            [1 / PX_PER_M, 0.0, (0.5 - MARGIN_PX) / PX_PER_M],
            [0.0, 1 / PX_PER_M, (0.5 - MARGIN_PX) / PX_PER_M],
            [0.0, 0.0, 1.0],
        ]
    )
    folder.mkdir()
    for camera in rig.cameras:
        with write_video(folder / f"{camera.name}.mp4", camera.size_px, RATE_HZ) as video:
            for k in range(N_FRAMES):
                rotation = camera.rotation @ rotations[k]
                place = camera.rotation @ origins[k] + camera.translation_m
                plane = camera.matrix @ np.stack([rotation[:, 0], rotation[:, 1], place], axis=1)
                image = cv2.warpPerspective(
                    drawn, plane @ board_from_picture, camera.size_px, flags=cv2.INTER_AREA, borderValue=127
                )
                image = image[:, ::-1] if mirrored else image
                video.add(np.repeat(image[:, :, None], 3, axis=2), k / RATE_HZ)


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
    render(replace(small_rig(2)), tmp_path / "videos", mirrored=True)
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
