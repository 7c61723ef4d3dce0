"""Overlay videos: position and timing of the drawn skeletons, and errors."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import FileError, MatchError, OptionsError, ResultError
from posefuse.model.options.sync import SyncOptions
from posefuse.model.status import ViewStatus
from posefuse.visualize.annotations import Annotator
from posefuse.visualize.colors import PEOPLE, REJECTED
from posefuse.visualize.drawing import DrawingStyle, draw
from posefuse.visualize.overlay.options import OverlayOptions
from posefuse.visualize.overlay.write import write_overlays
from tests.videos import (
    N_FRAMES,
    RATE_HZ,
    SIZE_PX,
    coded_video,
    codes_of,
    exact_detections,
    images_of,
    moving_sticks,
    small_rig,
)


@pytest.fixture(scope="module")
def result():
    return moving_sticks()


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    return coded_video(tmp_path_factory.mktemp("videos") / "cam0.mp4")


def has_color(picture: np.ndarray, pixel: np.ndarray, color: tuple[int, int, int]) -> bool:
    """Return whether a color is at a pixel, with a tolerance for chroma subsampling."""
    x, y = np.round(pixel).astype(int)
    near = picture[y - 1 : y + 2, x - 1 : x + 2].astype(int)
    return bool((np.abs(near - np.array(color)).max(axis=-1) < 70).any())


def test_each_image_shows_the_skeletons_of_its_frame(result, video, tmp_path):
    (written,) = write_overlays(result, {"cam0": video}, tmp_path)
    assert (written.n_images, written.n_drawn, written.notes) == (N_FRAMES, N_FRAMES, ())
    pictures = images_of(tmp_path / "cam0_overlay.mp4")
    assert codes_of(pictures) == list(range(N_FRAMES))
    pixels = result.rig.project(np.asarray(result.layers["measured"].points_m))[:, 0]
    for f, picture in enumerate(pictures):
        assert picture.shape == (SIZE_PX[1], SIZE_PX[0], 3)
        for p in range(2):
            middle = pixels[f, p, 1]
            assert has_color(picture, middle, PEOPLE[p])
            assert not has_color(picture, middle + np.array([0, 25]), PEOPLE[p])


def test_lens_distortion_is_applied(result):
    straight = replace(result.rig.cameras[0], lens="pinhole", distortion=())
    corner = np.array([0.0, 1.2, 2.1])
    bent_px, straight_px = result.rig.cameras[0].project(corner)[0], straight.project(corner)[0]
    assert np.linalg.norm(bent_px - straight_px) > 3
    layer = replace(result.layers["measured"], points_m=np.broadcast_to(corner, (N_FRAMES, 2, 3, 3)).copy())
    annotations = Annotator(replace(result, layers={"measured": layer}), "measured").annotate(0, 0)
    assert annotations.people[0].pixels[0] == pytest.approx(bent_px)


def test_points_behind_the_camera_are_not_drawn(result):
    points = np.asarray(result.layers["measured"].points_m).copy()
    points[:, 0, 2] = [9.0, 0.0, 1.0]  # behind cam0, which stands at x = 4
    points[:, 1] = [9.0, 0.0, 1.0]
    layer = replace(result.layers["measured"], points_m=points)
    annotations = Annotator(replace(result, layers={"measured": layer}), "measured").annotate(0, 0)
    assert [person.name for person in annotations.people] == ["person_1"]
    assert np.isfinite(annotations.people[0].pixels[:, 0]).tolist() == [True, True, False]


@pytest.mark.parametrize(("rate_hz", "n", "frames"), [(50.0, 24, 23), (12.5, 6, 6), (5.0, 3, 3)])
def test_other_rates_are_matched_by_time(result, tmp_path, rate_hz, n, frames):
    video = coded_video(tmp_path / "cam0.mp4", n, rate_hz)
    (written,) = write_overlays(result, {"cam0": video}, tmp_path / "out")
    pictures = images_of(tmp_path / "out" / "cam0_overlay.mp4")
    assert (len(pictures), written.n_drawn) == (frames, frames)
    pixels = result.rig.project(np.asarray(result.layers["measured"].points_m))[:, 0]
    for i in range(0, n, 2):
        f = round(i * RATE_HZ / rate_hz)
        assert has_color(pictures[i], pixels[f, 0, 1], PEOPLE[0])


def test_offset_shifts_the_video(result, video, tmp_path):
    options = OverlayOptions(offset_s={"cam0": 3 / RATE_HZ})
    (written,) = write_overlays(result, {"cam0": video}, tmp_path, options)
    pictures = images_of(written.path)
    assert codes_of(pictures) == list(range(N_FRAMES - 3))
    pixels = result.rig.project(np.asarray(result.layers["measured"].points_m))[:, 0]
    assert has_color(pictures[0], pixels[3, 0, 1], PEOPLE[0])


def test_synchronized_views_are_drawn_synchronized(result, video, tmp_path):
    sync = SyncOptions(("cam0",), (0.0,), (2 / RATE_HZ,), (0.0,))
    synchronized = replace(result, options=replace(result.options, sync=sync))
    for match in ("time", "frame"):
        (written,) = write_overlays(synchronized, {"cam0": video}, tmp_path / match, OverlayOptions(match=match))
        pictures = images_of(written.path)
        assert codes_of(pictures) == list(range(N_FRAMES - 2))
        pixels = result.rig.project(np.asarray(result.layers["measured"].points_m))[:, 0]
        assert has_color(pictures[0], pixels[2, 0, 1], PEOPLE[0])


def test_time_range(result, video, tmp_path):
    options = OverlayOptions(start_s=2 / RATE_HZ, end_s=5 / RATE_HZ)
    (written,) = write_overlays(result, {"cam0": video}, tmp_path, options)
    assert codes_of(images_of(written.path)) == [2, 3, 4]
    with pytest.raises(
        ResultError, match=r"no frames in the selected time range. Its frames are from 0.000 to 0.440 s"
    ):
        write_overlays(result, {"cam0": video}, tmp_path, OverlayOptions(start_s=7.0))


def test_matching_by_frame_number(result, tmp_path):
    video = coded_video(tmp_path / "cam0.mp4", N_FRAMES, 31.0)
    late = replace(result, frame_numbers=result.frame_numbers + 4, time_s=result.time_s + 4 / RATE_HZ)
    (written,) = write_overlays(late, {"cam0": video}, tmp_path / "out", OverlayOptions(match="frame"))
    assert codes_of(images_of(written.path)) == list(range(4, N_FRAMES))


def test_mosaic(result, video, tmp_path):
    options = OverlayOptions(grid=True, blank=True)
    (written,) = write_overlays(result, {"cam0": video}, tmp_path, options)
    pictures = images_of(tmp_path / "overlay.mp4")
    assert written.n_images == len(pictures) == N_FRAMES
    assert pictures[0].shape == (SIZE_PX[1], 2 * SIZE_PX[0], 3)
    assert codes_of([picture[:, : SIZE_PX[0]] for picture in pictures]) == list(range(N_FRAMES))
    pixels = result.rig.project(np.asarray(result.layers["measured"].points_m))
    for view in range(2):
        assert has_color(pictures[6], pixels[6, view, 1, 1] + np.array([view * SIZE_PX[0], 0]), PEOPLE[1])


def test_same_input_gives_the_same_bytes(result, video, tmp_path):
    for folder in ("one", "two"):
        write_overlays(result, {"cam0": video}, tmp_path / folder)
    name = "cam0_overlay.mp4"
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_other_image_size_is_an_error_unless_rescaled(tmp_path):
    result = moving_sticks(small_rig((640, 480)))
    video = coded_video(tmp_path / "small.mp4")
    with pytest.raises(
        ResultError, match=r"small.mp4 is 320 x 240 px, but camera 'cam0' .* 640 x 480 .* `rescale=True`"
    ):
        write_overlays(result, {"cam0": video}, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (written,) = write_overlays(result, {"cam0": video}, tmp_path / "out", OverlayOptions(rescale=True))
    pixels = result.rig.project(np.asarray(result.layers["measured"].points_m))[:, 0]
    assert has_color(images_of(written.path)[4], (pixels[4, 0, 1] + 0.5) / 2 - 0.5, PEOPLE[0])
    tall = coded_video(tmp_path / "tall.mp4", size_px=(480, 640))
    with pytest.raises(ResultError, match="rotated by 90 degrees"):
        write_overlays(result, {"cam0": tall}, tmp_path / "out", OverlayOptions(rescale=True))


def test_unknown_and_missing_camera_names(result, video, tmp_path):
    with pytest.raises(MatchError, match=r"`videos`: there is no camera 'cam7'. The cameras are cam0, cam1"):
        write_overlays(result, {"cam7": video}, tmp_path)
    with pytest.raises(MatchError, match="`offset_s`: there is no camera 'cam9'"):
        write_overlays(result, {"cam0": video}, tmp_path, OverlayOptions(offset_s={"cam9": 1.0}))
    with pytest.raises(MatchError, match="No video to draw on.*`blank=True`"):
        write_overlays(result, {}, tmp_path)
    same = video.rename(video.with_name("cam0_overlay.mp4"))
    with pytest.raises(OptionsError, match="is one of the videos"):
        write_overlays(result, {"cam0": same}, same.parent)
    same.rename(video)


def test_truncated_video_is_drawn_up_to_its_end(result, video, tmp_path):
    cut = tmp_path / "cut.mp4"
    content = video.read_bytes()
    cut.write_bytes(content[: len(content) - 200])
    (written,) = write_overlays(result, {"cam0": cut}, tmp_path)
    assert 0 < written.n_images < N_FRAMES
    assert len(images_of(written.path)) == written.n_images
    assert "cut.mp4 cannot be read beyond" in written.notes[0]


@pytest.mark.parametrize("content", [b"", b"not a video at all" * 50])
def test_invalid_video_is_an_error(result, tmp_path, content):
    path = tmp_path / "cam0.mp4"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"cam0.mp4 cannot be read as a video .*truncated"):
        write_overlays(result, {"cam0": path}, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_video_of_another_time_is_an_error(result, video, tmp_path):
    with pytest.raises(ResultError, match="set `offset_s` of 'cam0'"):
        write_overlays(result, {"cam0": video}, tmp_path, OverlayOptions(offset_s={"cam0": 90.0}))
    assert not list(tmp_path.glob("*.mp4"))


def test_small_rate_difference_gives_a_note(tmp_path):
    result = moving_sticks(n_frames=200)
    video = coded_video(tmp_path / "cam0.mp4", 3, RATE_HZ / 1.004)
    (written,) = write_overlays(result, {"cam0": video}, tmp_path / "out")
    assert any("`match='frame'`" in notes for notes in written.notes)
    assert any("cam0.mp4 ends at" in notes for notes in written.notes)


def test_detections_are_marked_by_label(result):
    layer = result.layers["measured"]
    status = np.asarray(layer.view_status).copy()
    status[:, 0, 1, 0] = ViewStatus.OUTLIER
    judged = replace(result, layers={"measured": replace(layer, view_status=status)})
    annotations = Annotator(judged, "measured", exact_detections(result)).annotate(0, 5)
    image = np.zeros((SIZE_PX[1], SIZE_PX[0], 3), dtype=np.uint8)
    draw(image, replace(annotations, people=()), [], DrawingStyle.of(SIZE_PX, SIZE_PX))
    wrong, right = annotations.people[0].pixels[1], annotations.people[1].pixels[1]
    assert has_color(image, wrong, REJECTED)
    assert not has_color(image, right, REJECTED)
    assert has_color(image, right + np.array([2.7, 0]), PEOPLE[1])
