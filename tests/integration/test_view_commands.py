"""``posefuse overlay`` and ``posefuse view`` as they are typed."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.io.keypoints import native
from posefuse.io.open_recording import digest_path
from tests.videos import N_FRAMES, coded_video, exact_detections, images_of, moving_sticks


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("result")
    posefuse.write(moving_sticks(), folder / "reconstruction.nc")
    native.write(exact_detections(moving_sticks()), folder / "keypoints.nc")
    (folder / "videos").mkdir()
    for name in ("cam0", "CAM_1"):
        coded_video(folder / "videos" / f"{name}.mp4")
    return folder


def test_overlay_of_a_folder_of_videos(run, stored, tmp_path):
    out = tmp_path / "out"
    code, output, err = run("overlay", stored, "--video", stored / "videos", "--detections", stored / "keypoints.nc",
                          "-o", out)  # fmt: skip
    assert (code, err) == (0, "")
    assert sorted(entry.name for entry in out.iterdir()) == ["cam0_overlay.mp4", "cam1_overlay.mp4"]
    assert f"{N_FRAMES} images" in output
    assert len(images_of(out / "cam1_overlay.mp4")) == N_FRAMES


def test_overlay_of_one_video_names_the_other_cameras(run, stored, tmp_path):
    video = stored / "videos" / "cam0.mp4"
    code, output, _ = run(
        "overlay", stored, "--video", f"cam0={video}", "--offset-s", "cam0=0.04", "-o", tmp_path / "out"
    )
    assert code == 0
    assert f"{N_FRAMES - 1} images" in output
    assert "no video of cam1; --blank" in output


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--video", "cam0"), "expected CAMERA=FILE"),
        (("--video", "cam5=a.mp4"), "The cameras are cam0, cam1"),
        (("--video", "cam0=a.mp4", "cam0=b.mp4"), "two videos of camera 'cam0'"),
        (("--blank", "--offset-s", "cam0=soon"), "expected CAMERA=SECONDS"),
        (("--blank", "--layer", "model"), "has no layer 'model'; it has measured"),
        ((), "--blank"),
    ],
)
def test_invalid_arguments_have_a_remedy(run, stored, tmp_path, arguments, complaint):
    code, _, err = run("overlay", stored, *arguments, "-o", tmp_path / "out")
    assert code != 0
    assert complaint in err
    assert not (tmp_path / "out").exists()


@pytest.fixture
def two_sets(stored, tmp_path):
    """Return a result that stores what it was computed from, and a recording with other keypoints beside these."""
    result = moving_sticks()
    recording = tmp_path / "recording"
    for name, shift_px in (("a", 40.0), ("b", 0.0)):
        (recording / name).mkdir(parents=True)
        exact = exact_detections(result)
        native.write(replace(exact, keypoints_px=exact.keypoints_px[:] + shift_px), recording / name / "keypoints.nc")
    inputs = {"keypoints.nc": digest_path(recording / "b" / "keypoints.nc")}
    known = replace(result, provenance=replace(result.provenance, inputs=inputs))
    posefuse.write(known, tmp_path / "known" / "reconstruction.nc")
    return tmp_path / "known", recording


def test_keypoints_whose_hash_the_result_stores_are_drawn(run, two_sets, stored, tmp_path):
    known, recording = two_sets
    arguments = ("--video", stored / "videos", "-o")
    code, out, err = run("overlay", known, "--detections", recording, *arguments, tmp_path / "chosen")
    assert (code, err) == (0, "")
    assert f"{recording / 'b' / 'keypoints.nc'} is used" in " ".join(out.split())
    for name in ("a", "b"):
        keypoints = recording / name / "keypoints.nc"
        code, _, err = run("overlay", known, "--keypoints", keypoints, *arguments, tmp_path / name)
        assert code == 0
        assert ("has changed since the result was written" in err) is (name == "a")
        chosen, given = (images_of(tmp_path / each / "cam0_overlay.mp4") for each in ("chosen", name))
        assert np.array_equal(chosen, given) is (name == "b")


def test_unknown_hashes_ask_for_a_choice_that_the_commands_take(run, two_sets, stored, tmp_path):
    _, recording = two_sets
    for command in (("overlay", stored, "--detections"), ("explain", stored, "--frame", "0", "--recording")):
        more = ("-o", tmp_path / "out", "--blank") if command[0] == "overlay" else ()
        code, _, err = run(*command, recording, *more)
        assert code == 1
        assert f"--keypoints {recording / 'a' / 'keypoints.nc'}" in err
        code, _, err = run(*command, recording, *more, "--keypoints", recording / "a" / "keypoints.nc")
        assert (code, err) == (0, "")


def test_view_saves_a_scene(run, stored, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="rerun-sdk, of the extra view, is not installed")
    scene = tmp_path / "scene.rrd"
    code, output, _ = run("view", stored, "--keypoints", stored / "keypoints.nc", "--video", stored / "videos",
                        "--end-s", "0.2", "--save", scene)  # fmt: skip
    assert code == 0
    assert f"rerun {scene}" in output.replace("\n", " ")
    assert scene.read_bytes()[:3] == b"RRF"
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    code, _, err = run("view", stored)
    assert code == 1
    assert "no display" in err
