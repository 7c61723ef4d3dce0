"""``posefuse board`` and ``posefuse calibrate`` on rendered videos of a board."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.cli.main import main
from posefuse.detection.boards.detector import BoardDetector
from posefuse.io.board_images import find_images
from posefuse.io.board_specs import read_board_spec
from posefuse.io.calibration.anipose import write
from posefuse.io.videos.reader import open_video
from posefuse.io.videos.writer import write_video
from posefuse.pipeline.detect_board import detect_board
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
    page = (tmp_path / "calibration.html").read_text("utf-8")
    assert "Calibration of 2 cameras" in page
    assert "http" not in page


def test_number_of_processes_does_not_change_the_bytes(videos, tmp_path, capsys):
    lenses = tmp_path / "lenses.toml"
    write(small_rig(), lenses)
    files = [tmp_path / f"jobs_{jobs}.toml" for jobs in (1, 2)]
    for jobs, file in zip("12", files, strict=True):
        main(["calibrate", str(videos), "--board", SPEC, "--intrinsics", str(lenses), "-o", str(file), "--jobs", jobs])
    assert files[0].read_bytes() == files[1].read_bytes()
    assert files[0].with_suffix(".html").read_bytes() == files[1].with_suffix(".html").read_bytes()


def test_report_is_written_unless_it_is_declined(videos, tmp_path, capsys):
    lenses = tmp_path / "lenses.toml"
    write(small_rig(), lenses)
    output = tmp_path / "calibration.toml"
    words = ["calibrate", str(videos), "--board", SPEC, "--intrinsics", str(lenses), "-o", str(output), "--jobs", "1"]
    main([*words, "--no-report"])
    assert not output.with_suffix(".html").exists()
    output.unlink()
    output.with_suffix(".html").write_text("mine")
    with pytest.raises(SystemExit):
        main(words)
    assert "calibration.html already exists" in " ".join(capsys.readouterr().err.split())
    assert not output.exists()


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("charuco:6x5,square=80mm,dict=5X5_50", "write dict=4X4_50"),
        ("charuco:6x5,square=80mm,inverted", "remove inverted"),
        ("charuco:7x5,square=80mm", "fewer squares than stated, 6 columns and at least 5 rows: write charuco:6x5"),
        (
            "charuco:5x6,square=80mm",
            "6 columns and at least 5 rows of squares: columns come before rows, write charuco:6x5",
        ),
        ("charuco:6x4,square=80mm", "more squares than stated, 6 columns and at least 5 rows"),
        ("charuco:6x5,square=80mm,dict=4X4_1000,inverted", "remove inverted"),
        ("charuco:6x5,square=80", "a positive length with its unit"),
    ],
)
def test_wrong_boards_are_explained(spec, message, videos, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", str(videos), "--board", spec, "-o", str(tmp_path / "c.toml"), "--jobs", "1"])
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "c.toml").exists()


def test_checkerboard_of_another_size_is_named(tmp_path, capsys):
    render(small_rig(), tmp_path / "videos", "checkerboard:6x4,square=70mm")
    with pytest.raises(SystemExit):
        main(["calibrate", str(tmp_path / "videos"), "--board", "checkerboard:7x5,square=70mm", "--jobs", "1",
              "-o", str(tmp_path / "c.toml")])  # fmt: skip
    text = " ".join(capsys.readouterr().err.split())
    assert "6 x 4 inner corners, fewer than stated: write checkerboard:6x4" in text


def test_another_kind_of_board_is_named(videos, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", str(videos), "--board", "checkerboard:7x5,square=80mm", "--jobs", "1",
              "-o", str(tmp_path / "c.toml")])  # fmt: skip
    text = " ".join(capsys.readouterr().err.split())
    assert "The images show another board: write charuco:6x5,square=30mm,marker=0.75,dict=4X4_50" in text


def test_board_seen_by_one_camera_only_is_named(videos, tmp_path, capsys):
    copied = tmp_path / "videos"
    copied.mkdir()
    shutil.copy(videos / "cam_0.mp4", copied / "left.mp4")
    for name in ("middle", "right"):
        with write_video(copied / f"{name}.mp4", (320, 240), 10.0) as video:
            for k in range(5):
                video.add(np.full((240, 320, 3), 90, dtype=np.uint8), k / 10.0)
    with pytest.raises(SystemExit):
        main(["calibrate", str(copied), "--board", SPEC, "-o", str(tmp_path / "c.toml"), "--jobs", "1"])
    assert "Only camera 'left' shows the board" in " ".join(capsys.readouterr().err.split())


def test_truncated_video_is_read_up_to_the_break(videos, tmp_path, capsys):
    """Images of a Matroska file are stored in order, so that its beginning can be read."""
    copied, lenses = tmp_path / "videos", tmp_path / "lenses.toml"
    copied.mkdir()
    write(small_rig(), lenses)
    for source in videos.iterdir():
        convert(source, copied / f"{source.stem}.mkv")
    broken = copied / "cam_1.mkv"
    broken.write_bytes(broken.read_bytes()[: int(0.9 * broken.stat().st_size)])
    output = tmp_path / "c.toml"
    main(["calibrate", str(copied), "--board", SPEC, "--intrinsics", str(lenses), "-o", str(output), "--jobs", "1"])
    text = " ".join(capsys.readouterr().out.split())
    assert "The video of camera 'cam_1' breaks off after" in text
    assert any("breaks off" in note for note in posefuse.read_cameras(output).notes)


def convert(source, target):
    """Write the images of a video to a file of another format."""
    reader = open_video(source)
    with write_video(target, reader.info.size_px, 10.0) as video:
        for image in reader.images():
            video.add(image.rgb, image.time_s)


def test_corners_are_detected_once(videos, tmp_path, monkeypatch):
    """A second run with the same images and board examines no image; another board or interval does."""
    monkeypatch.setenv("POSEFUSE_CACHE", str(tmp_path / "cache"))
    views, board = find_images(videos), read_board_spec(SPEC)
    first = detect_board(views, board, jobs=1)
    examined = []
    examine = BoardDetector.corners_px
    monkeypatch.setattr(BoardDetector, "corners_px", lambda *given: examined.append(1) or examine(*given))
    moved = tmp_path / "moved"
    shutil.copytree(videos, moved)
    again = detect_board(find_images(moved), board, jobs=1)
    assert not examined
    for a, b in zip(first, again, strict=True):
        assert (a.name, a.size_px, a.labels, a.notes) == (b.name, b.size_px, b.labels, b.notes)
        for field in ("numbers", "time_s", "corners_px"):
            assert np.array_equal(getattr(a, field), getattr(b, field), equal_nan=True)
    detect_board(views, board, every=2, jobs=1)
    assert len(examined) > 5
    before = len(examined)
    detect_board(views, read_board_spec(SPEC.replace("80mm", "81mm")), jobs=1)
    assert len(examined) > before + 5


def test_unusable_cache_is_ignored(videos, tmp_path, monkeypatch):
    (tmp_path / "cache").write_text("a file instead of a folder")
    monkeypatch.setenv("POSEFUSE_CACHE", str(tmp_path / "cache"))
    assert detect_board(find_images(videos), read_board_spec(SPEC), jobs=1)[0].n_found > 5


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


SCENE_M = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])


def write_scene(rig, path):
    """A file of the corners of a box and their places in the images."""
    places = "".join(f"{c.name} = {c.project(SCENE_M)[0].round(2).tolist()}\n" for c in rig.cameras)
    path.write_text(f"world_m = {SCENE_M.tolist()}\n[image_px]\n{places}")
    return path


def test_scene_points_give_the_poses(videos, tmp_path, capsys):
    """Lenses from the board, or from a file; the world is that of the points."""
    truth, lenses, output = small_rig(), tmp_path / "lenses.toml", tmp_path / "calibration.toml"
    write(truth, lenses)
    points = write_scene(truth, tmp_path / "points.toml")
    main(["calibrate", "--scene-points", str(points), "--intrinsics", str(lenses), "-o", str(output)])
    assert "Points of known position" in output.with_suffix(".html").read_text("utf-8")
    assert "2 cameras, 16 places of points" in capsys.readouterr().out
    found = posefuse.read_cameras(output)
    assert found.up_axis == "z"
    for a, b in zip(found.cameras, truth.cameras, strict=True):
        assert np.linalg.norm(a.center_m - b.center_m) < 1e-3
    sds = [each.sd("center_z_m") for each in found.covariances]
    again = tmp_path / "again.toml"
    main(["calibrate", str(videos), "--board", SPEC, "--scene-points", str(points), "-o", str(again), "--jobs", "1"])
    found = posefuse.read_cameras(again)
    for a, b, c, sd in zip(found.cameras, truth.cameras, found.covariances, sds, strict=True):
        assert np.linalg.norm(a.center_m - b.center_m) < 0.03
        assert "fx_px" in c.parameters
        assert c.sd("center_z_m") > sd


def test_known_points_define_the_world_of_a_calibration_by_a_board(videos, tmp_path, capsys):
    truth, lenses, output = small_rig(), tmp_path / "lenses.toml", tmp_path / "calibration.toml"
    write(truth, lenses)
    points = write_scene(truth, tmp_path / "points.toml")
    words = ["calibrate", str(videos), "--board", SPEC, "--intrinsics", str(lenses), "--jobs", "1", "-o", str(output)]
    main([*words, "--origin-points", str(points)])
    assert "The world is that of 8 points of known position" in " ".join(capsys.readouterr().out.split())
    found = posefuse.read_cameras(output)
    assert found.up_axis == "z"
    for a, b in zip(found.cameras, truth.cameras, strict=True):
        assert np.linalg.norm(a.center_m - b.center_m) < 0.01
    assert found.covariance() is not None
    output.unlink()
    with pytest.raises(SystemExit):
        main([*words, "--origin-points", str(points), "--scene-points", str(points), "--overwrite"])
    assert "define the world already" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cam_1", "other", "'other' of the scene points has no lens"),
        ("image_px", "pixels", "has no scene points"),
        (r"cam_0 = \[\[[0-9., ]+\]", "cam_0 = [[-50.0, 10.0]", "have 960 x 540 px"),
    ],
)
def test_wrong_scene_points_are_named(old, new, message, tmp_path, capsys):
    write(small_rig(), tmp_path / "lenses.toml")
    points = write_scene(small_rig(), tmp_path / "points.toml")
    points.write_text(re.sub(old, new, points.read_text()))
    with pytest.raises(SystemExit):
        main(["calibrate", "--scene-points", str(points), "--intrinsics", str(tmp_path / "lenses.toml"),
              "-o", str(tmp_path / "c.toml")])  # fmt: skip
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "c.toml").exists()


def test_poses_need_a_board_or_points(videos, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", str(videos), "-o", str(tmp_path / "c.toml")])
    assert "--scene-points" in capsys.readouterr().err


@pytest.mark.parametrize(("shift_m", "message"), [(0.0, "No camera moved"), (0.3, "No two cameras kept their pose")])
def test_earlier_calibration_keeps_its_world(shift_m, message, videos, tmp_path, capsys):
    truth = small_rig()
    pose = truth.cameras[1].camera_from_world.copy()
    pose[0, 3] += shift_m
    moved = (truth.cameras[0], replace(truth.cameras[1], camera_from_world=pose))
    write(replace(truth, cameras=moved), tmp_path / "old.toml")
    output = tmp_path / "new.toml"
    main(["calibrate", str(videos), "--board", SPEC, "--from", str(tmp_path / "old.toml"), "-o", str(output),
          "--jobs", "1", "--no-report"])  # fmt: skip
    assert message in " ".join(capsys.readouterr().out.split())
    found = posefuse.read_cameras(output)
    assert any(message in note for note in found.notes)
    if not shift_m:
        assert np.linalg.norm(found.cameras[0].center_m - truth.cameras[0].center_m) < 0.01
