"""Scenes for rerun: its own reader finds the cameras, people, pictures and numbers that the result has."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import ResultError
from posefuse.model.status import ViewStatus
from posefuse.visualize.overlay.options import OverlayOptions
from posefuse.visualize.viewer import show
from posefuse.visualize.viewer.scene import ViewerVideo
from posefuse.visualize.viewer.series import speeds_m_s
from posefuse.visualize.viewer.show import open_scene, save_scene
from posefuse.visualize.viewer.videos import load_viewer_videos
from tests.videos import N_FRAMES, RATE_HZ, coded_video, exact_detections, moving_sticks

chunks = pytest.importorskip("rerun.chunk", reason="rerun-sdk, of the extra view, is not installed")


@pytest.fixture(scope="module")
def result():
    return moving_sticks()


def contents(path) -> dict[str, dict[str, list]]:
    """Entity to column to its rows, as rerun's own reader gives them."""
    actual: dict[str, dict[str, list]] = {}
    for chunk in chunks.RrdReader(str(path)).store().stream().to_chunks():
        columns = chunk.to_record_batch().to_pydict()
        actual.setdefault(chunk.entity_path, {}).update(columns)
    return actual


@pytest.fixture(scope="module")
def saved(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    layer = result.layers["measured"]
    points, status = np.asarray(layer.points_m).copy(), np.asarray(layer.view_status).copy()
    points[4, 0, 0] = np.nan
    points[5, 1] = np.nan
    status[:, 0, 2, 1] = ViewStatus.OUTLIER
    holed = replace(result, layers={"measured": replace(layer, points_m=points, view_status=status)})
    paths = {"cam0": coded_video(folder / "cam0.mp4")}
    videos = load_viewer_videos(holed, paths, OverlayOptions(offset_s={"cam0": 2 / RATE_HZ}))
    save_scene(holed, folder / "scene.rrd", exact_detections(result), videos)
    return holed, contents(folder / "scene.rrd"), paths["cam0"]


def test_people_have_the_positions_of_the_result(saved):
    result, scene, _ = saved
    points = np.asarray(result.layers["measured"].points_m)
    rows = scene["/world/people/measured/person_1"]
    assert rows["frame"] == list(range(N_FRAMES))
    assert [row.total_seconds() for row in rows["time"]] == pytest.approx(result.time_s)
    assert np.array(rows["Points3D:positions"][3]) == pytest.approx(points[3, 0], abs=1e-6)
    assert rows["Points3D:keypoint_ids"][4] == [1, 2]
    assert [len(row) for row in scene["/world/people/measured/person_1/bones"]["LineStrips3D:strips"]][3:6] == [2, 1, 2]
    assert scene["/world/people/measured/person_2"]["Points3D:positions"][5] == []


def test_cameras_have_their_poses_and_reprojections(saved):
    result, scene, _ = saved
    camera = result.rig.cameras[1]
    rows = scene["/world/cameras/cam1"]
    assert np.array(rows["Transform3D:translation"][0]).ravel() == pytest.approx(camera.center_m, abs=1e-5)
    assert np.array(rows["Pinhole:resolution"][0]).ravel().tolist() == list(camera.size_px)
    pixels = camera.project(np.asarray(result.layers["measured"].points_m))[0]
    drawn = scene["/world/cameras/cam1/reprojected/measured/person_2"]["Points2D:positions"]
    assert np.array(drawn[7]) == pytest.approx(pixels[7, 1], abs=1e-3)
    field = np.array(scene["/world/fields/cam1"]["LineStrips3D:strips"][0][0])
    observed = camera.project(field)[0]
    to_border = np.abs(np.concatenate([observed, observed - np.array(camera.size_px) + 1], axis=1)).min(axis=1)
    assert len(field) > 60
    assert to_border.max() < 0.1


def test_detections_are_grouped_by_label(saved):
    result, scene, _ = saved
    rejected = scene["/world/cameras/cam1/detected/rejected"]["Points2D:positions"]
    pixels = result.rig.cameras[1].project(np.asarray(result.layers["measured"].points_m))[0]
    assert [len(row) for row in rejected] == [1] * N_FRAMES
    assert np.array(rejected[2]) == pytest.approx(pixels[2, 0, 2:], abs=1e-3)
    assert "/world/cameras/cam0/detected/rejected" not in scene
    assert [len(row) for row in scene["/world/cameras/cam0/detected/used"]["Points2D:positions"]] == [6] * N_FRAMES


def test_video_is_included_and_synchronized(saved):
    _, scene, video = saved
    rows = scene["/world/cameras/cam0/video"]
    assert bytes(rows["AssetVideo:blob"][0][0]) == video.read_bytes()
    shown_s = np.array(rows["VideoFrameReference:timestamp"], dtype=float).ravel() / 1e9
    assert rows["frame"] == list(range(2, N_FRAMES))
    assert shown_s == pytest.approx(np.arange(N_FRAMES - 2) / RATE_HZ, abs=1e-6)


def test_time_series(saved):
    _, scene, _ = saved
    speed = np.array(scene["/series/speed_m_s/person_1"]["Scalars:scalars"], dtype=float).ravel()
    assert np.isnan(speed[0])
    assert speed[1:] == pytest.approx(0.1 * RATE_HZ)
    assert np.array(scene["/series/error_px/person_1"]["Scalars:scalars"]).ravel() == pytest.approx(0.5)
    views = np.array(scene["/series/views/person_2"]["Scalars:scalars"]).ravel()
    assert views == pytest.approx(2.0)


def test_speed_is_continuous_across_ranges(rng):
    points = rng.normal(size=(9, 2, 4, 3))
    points[3, 0, 1] = np.nan
    points[6, 1] = np.nan
    time_s = np.cumsum(rng.uniform(0.1, 0.2, 9))
    whole, _ = speeds_m_s(points, time_s, None)
    first, after = speeds_m_s(points[:4], time_s[:4], None)
    second, _ = speeds_m_s(points[4:], time_s[4:], after)
    assert np.concatenate([first, second]) == pytest.approx(whole, nan_ok=True)
    assert np.isnan(whole[6:8, 1]).all()


def test_missing_display_is_an_error_before_any_work(result, monkeypatch):
    monkeypatch.setattr(show.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ResultError, match=r"no display .* `save='scene.rrd'`"):
        open_scene(result)


def test_single_camera_result_is_an_error(result, tmp_path):
    with pytest.raises(ResultError, match="is in px"):
        save_scene(replace(result, unit="px"), tmp_path / "scene.rrd")


def test_videos_of_another_time_are_not_referenced(result, tmp_path):
    video = coded_video(tmp_path / "cam0.mp4")
    late = ViewerVideo(video.read_bytes(), np.arange(N_FRAMES) / RATE_HZ, offset_s=100.0)
    save_scene(result, tmp_path / "scene.rrd", videos={"cam0": late})
    assert "VideoFrameReference:timestamp" not in contents(tmp_path / "scene.rrd")["/world/cameras/cam0/video"]
