"""``posefuse overlay`` and ``posefuse view`` as they are typed."""

import pytest

import posefuse
from posefuse.io.keypoints import native
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


def test_view_saves_a_scene(run, stored, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="rerun-sdk, of the extra view, is not installed")
    scene = tmp_path / "scene.rrd"
    code, output, _ = run("view", stored, "--recording", stored / "keypoints.nc", "--video", stored / "videos",
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
