"""`sync` writes a file only if the verdict is that a clock is wrong."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.fault_scenes import Scene, healthy, plant

from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.options import read_sync
from tests.sounds import record, room_sound, write_sounding_video


@pytest.fixture(scope="module")
def walk() -> Scene:
    return healthy(3, cameras=4, duration_s=12.0, rate_hz=25.0, activities=("walk",))


def written(scene: Scene, folder: Path) -> Path:
    """Return a folder with the recording of a scene."""
    rig, detections = scene.watch()
    anipose.write(rig, folder / "calibration.toml")
    native.write(detections, folder / "keypoints.nc")
    return folder


def test_synchronized_views_give_a_file_without_offsets(run, walk, tmp_path):
    """A script can pass it to reconstruct, whatever was found."""
    code, output, _ = run("sync", written(walk, tmp_path), "--people", "one", "-o", tmp_path / "sync.toml")
    words = " ".join(output.split())
    assert code == 0
    assert "verdict: the recording shows no wrong camera pose and no wrong clock" in words
    assert "Nothing to correct" in words
    assert read_sync(tmp_path / "sync.toml").does_nothing
    command = ("reconstruct", tmp_path, "--people", "one", "--sync", tmp_path / "sync.toml", "-o", tmp_path / "out")
    assert run(*command)[0] == 0


def test_late_view_is_written(run, walk, tmp_path):
    late, _ = plant(walk, "late", (2,), 3.0)
    code, output, _ = run("sync", written(late, tmp_path), "--people", "one", "-o", tmp_path / "sync.toml")
    assert code == 0
    assert "verdict: time offset: View 'cam_2'" in " ".join(output.split())
    sync = read_sync(tmp_path / "sync.toml")
    assert (sync.cameras, sync.drift_ppm) == (("cam_2",), (0.0,))
    assert sync.offset_s[0] == pytest.approx(3.0 / 25.0, abs=0.02)


def test_videos_alone_are_synchronized_by_their_sound(run, tmp_path):
    rng = np.random.default_rng(5)
    room = room_sound(20.0, rng)
    for name, start_s, rate_hz in (("left", 1.0, 30.0), ("right", 3.5, 25.0)):
        write_sounding_video(tmp_path / f"{name}.mp4", record(room, start_s, 12.0, rng), image_hz=rate_hz)
    write_sounding_video(tmp_path / "mute.mp4", None)
    code, output, _ = run("sync", tmp_path, "-o", tmp_path / "sync.toml")
    words = " ".join(output.split())
    assert code == 0
    assert "right +2.500 +- 0.010 +2.500" in words
    assert "sound: mute has no sound track." in words
    assert "mute no evidence unknown" in words
    sync = read_sync(tmp_path / "sync.toml")
    assert sync.cameras == ("right",)
    assert sync.offset_s[0] == pytest.approx(2.5, abs=0.005)


def test_all_commands_name_offsets_of_free_running_cameras_until_they_are_corrected(run, tmp_path):
    scene = healthy(3, cameras=4, duration_s=8.0, rate_hz=25.0, activities=("walk",))
    for view, frames in enumerate((0.45, -0.4, 0.0, 0.4)):
        scene, _ = plant(scene, "late", (view,), frames)
    (tmp_path / "recording").mkdir()
    folder, file, refined = written(scene, tmp_path / "recording"), tmp_path / "sync.toml", tmp_path / "refined.toml"
    commands = (
        ("inspect", folder, "--deep"),
        ("sync", folder, "-o", file),
        ("refine-calibration", folder, "-o", refined, "--overwrite"),
    )
    found = [verdicts(run(*command, "--people", "one")) for command in commands]
    assert "unsynchronized cameras" in found[0]
    assert found[0] == found[1] == found[2]
    again = {verdicts(run(*command, "--people", "one", "--sync", file)) for command in (commands[0], commands[2])}
    assert again == {"verdict: the recording shows no wrong camera pose and no wrong clock"}


def verdicts(outcome: tuple[int, str, str]) -> str:
    """Return the lines of the verdict."""
    code, output, _ = outcome
    assert code == 0
    return "\n".join(line for line in output.splitlines() if line.startswith("verdict:"))
