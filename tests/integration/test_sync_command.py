"""`sync` writes a file only if the verdict is that a clock is wrong."""

from pathlib import Path

import pytest
from benchmarks.fault_scenes import Scene, healthy, plant

from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.options import read_sync


@pytest.fixture(scope="module")
def walk() -> Scene:
    return healthy(3, cameras=4, duration_s=12.0, rate_hz=25.0, activities=("walk",))


def written(scene: Scene, folder: Path) -> Path:
    """Return a folder with the recording of a scene."""
    rig, detections = scene.watch()
    anipose.write(rig, folder / "calibration.toml")
    native.write(detections, folder / "keypoints.nc")
    return folder


def test_synchronized_views_give_no_file(run, walk, tmp_path):
    code, output, _ = run("sync", written(walk, tmp_path), "--people", "one", "-o", tmp_path / "sync.toml")
    words = " ".join(output.split())
    assert code == 0
    assert "verdict: the recording shows no wrong camera pose and no wrong clock" in words
    assert "Nothing to correct" in words
    assert "was not written" in words
    assert not (tmp_path / "sync.toml").exists()


def test_late_view_is_written(run, walk, tmp_path):
    late, _ = plant(walk, "late", (2,), 3.0)
    code, output, _ = run("sync", written(late, tmp_path), "--people", "one", "-o", tmp_path / "sync.toml")
    assert code == 0
    assert "verdict: time offset: View 'cam_2'" in " ".join(output.split())
    sync = read_sync(tmp_path / "sync.toml")
    assert (sync.cameras, sync.drift_ppm) == (("cam_2",), (0.0,))
    assert sync.offset_s[0] == pytest.approx(3.0 / 25.0, abs=0.02)
