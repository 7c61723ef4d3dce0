"""Reading and writing of videos: images, times, and errors of damaged files."""

import struct

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.videos import library
from posefuse.io.videos.frame_index import read_frame_index
from posefuse.io.videos.mp4 import is_playable, transcode_to_mp4
from posefuse.io.videos.reader import open_video
from posefuse.io.videos.writer import write_video
from tests.filmed_blobs import bar_place, film
from tests.videos import coded_video, codes_of, images_of


def test_images_and_times_round_trip(tmp_path):
    path = coded_video(tmp_path / "a.mp4", 9, 30.0, (64, 48))
    reader = open_video(path)
    images = list(reader.images())
    assert codes_of([image.rgb for image in images]) == list(range(9))
    assert [image.time_s for image in images] == pytest.approx(np.arange(9) / 30, abs=1e-4)
    assert read_frame_index(path).time_s == pytest.approx(np.arange(9) / 30, abs=1e-4)
    assert (reader.info.size_px, reader.info.n_frames, reader.error) == ((64, 48), 9, "")
    assert reader.info.rate_hz == pytest.approx(30.0, rel=1e-3)


def test_colors_are_preserved(tmp_path):
    rgb = np.zeros((48, 64, 3), dtype=np.uint8)
    rgb[:, :32], rgb[:, 32:] = (200, 60, 30), (20, 90, 210)
    with write_video(tmp_path / "a.mp4", (64, 48), 25.0) as writer:
        writer.add(rgb, 0.0)
    (back,) = images_of(tmp_path / "a.mp4")
    assert np.abs(back[24, 10].astype(int) - rgb[24, 10]).max() < 8
    assert np.abs(back[24, 50].astype(int) - rgb[24, 50]).max() < 8


def test_brightness_is_that_of_the_color_image(tmp_path):
    rgb = np.zeros((48, 66, 3), dtype=np.uint8)
    rgb[:, :33], rgb[12:, 33:] = 200, 90
    with write_video(tmp_path / "a.mp4", (66, 48), 25.0) as writer:
        writer.add(rgb, 0.0)
    (image,) = open_video(tmp_path / "a.mp4").images(pixel_format="gray")
    (color,) = images_of(tmp_path / "a.mp4")
    assert image.rgb.shape == color.shape[:2]
    # The stored range may be 16 to 235.
    slope, _ = np.polyfit(color[..., 0].ravel().astype(float), image.rgb.ravel().astype(float), 1)
    assert 0.8 < slope < 1.05
    assert np.corrcoef(color[..., 0].ravel(), image.rgb.ravel())[0, 1] > 0.999


def test_uneven_times_are_preserved_and_odd_sizes_padded(tmp_path):
    times_s = [0.0, 0.1, 0.15, 0.4]
    with write_video(tmp_path / "a.mp4", (33, 21), 25.0) as writer:
        for time_s in times_s:
            writer.add(np.full((21, 33, 3), 90, dtype=np.uint8), time_s)
    images = list(open_video(tmp_path / "a.mp4").images())
    assert [image.time_s for image in images] == pytest.approx(times_s, abs=1e-4)
    assert images[0].rgb.shape == (22, 34, 3)


def test_images_have_the_times_of_the_index(tmp_path):
    """H.264 with B-frames in AVI has times in the order of decoding; the images are in the order of display."""
    path = film(tmp_path / "a.avi", 200)
    index = read_frame_index(path)
    reader = open_video(path)
    images = list(reader.images(pixel_format="gray"))
    assert [image.number for image in images] == list(range(200))
    np.testing.assert_allclose([image.time_s for image in images], index.time_s)
    np.testing.assert_allclose(index.time_s, np.arange(200) / 25.0, atol=1e-9)
    assert reader.error == ""
    for image in images:
        left, top = bar_place(image.number)
        assert image.rgb[top + 2, left + 2 : left + 14].min() > 150
        assert image.rgb[top + 2, left - 2] < 100
    late = next(iter(open_video(path).images(6.0)))
    assert (late.number, late.time_s) == (0, 0.0)  # decoding starts at the first image, where no place is reliable


def test_images_after_a_late_start_keep_their_numbers(tmp_path):
    path = film(tmp_path / "a.mp4", np.arange(300) / 25.0)
    reader = open_video(path)
    images = list(reader.images(8.0))
    assert 150 < images[0].number <= 200
    assert images[-1].number == 299
    assert [image.time_s for image in images] == pytest.approx([image.number / 25.0 for image in images])
    assert reader.error == ""


def test_late_start_seeks(tmp_path):
    path = coded_video(tmp_path / "a.mp4", 20, 0.5, (64, 48))
    assert 0.0 <= next(iter(open_video(path).images(30.0))).time_s <= 30.0


def test_rotated_video_is_upright(tmp_path):
    rgb = np.full((48, 64, 3), 40, dtype=np.uint8)
    rgb[:12, :16] = 230
    path = tmp_path / "a.mp4"
    with write_video(path, (64, 48), 25.0) as writer:
        writer.add(rgb, 0.0)
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 44
    clockwise = (0, 0x10000, 0, -0x10000, 0, 0, 48 << 16, 0, 0x40000000)
    content[at : at + 36] = struct.pack(">9i", *clockwise)
    path.write_bytes(content)
    reader = open_video(path)
    (image,) = reader.images()
    assert reader.info.size_px == (48, 64)
    assert image.rgb.shape == (64, 48, 3)
    assert image.rgb[4, -4].min() > 200  # the top left corner moves to the top right
    assert image.rgb[4, 4].max() < 80


def test_incomplete_file_is_removed_after_an_error(tmp_path):
    with pytest.raises(ZeroDivisionError), write_video(tmp_path / "a.mp4", (64, 48), 25.0) as writer:
        writer.add(np.zeros((48, 64, 3), dtype=np.uint8), 0.0)
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_other_formats_are_transcoded(tmp_path):
    av = library.import_pyav()
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for f in range(5):
            rgb = np.full((48, 64, 3), 20 + 10 * f, dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        container.mux(stream.encode(None))
    assert not is_playable(open_video(path).info)
    (tmp_path / "b.mp4").write_bytes(transcode_to_mp4(path))
    assert is_playable(open_video(tmp_path / "b.mp4").info)
    assert codes_of(images_of(tmp_path / "b.mp4")) == list(range(5))


def test_invalid_video_is_an_error(tmp_path):
    sound = tmp_path / "a.txt"
    sound.write_text("hello")
    with pytest.raises(FileError, match="No video at"):
        open_video(tmp_path / "b.mp4")
    with pytest.raises(FileError, match="cannot be read as a video"):
        open_video(sound)
    with pytest.raises(FileError, match="is a folder"):
        open_video(tmp_path)
    with pytest.raises(FileError, match="cannot be read as a video"):
        read_frame_index(sound)


def test_an_unknown_codec_is_one_sentence(tmp_path):
    path = coded_video(tmp_path / "a.mp4", 3)
    path.write_bytes(path.read_bytes().replace(b"avc1", b"xyz1"))
    with pytest.raises(FileError, match=r"a\.mp4 has a codec that PyAV cannot decode. Convert it"):
        open_video(path)


def test_images_that_an_edit_list_hides_are_not_missing(tmp_path):
    path = coded_video(tmp_path / "a.mp4", 20, 25.0)
    content = bytearray(path.read_bytes())
    at = content.find(b"elst") + 16
    start, per_frame = struct.unpack(">I", content[at : at + 4])[0], 3600
    content[at : at + 4] = struct.pack(">I", start + 5 * per_frame)
    path.write_bytes(content)
    reader = open_video(path)
    assert codes_of([image.rgb for image in reader.images()]) == list(range(5, 20))
    assert (reader.info.n_frames, reader.error) == (20, "")
    assert read_frame_index(path).n_hidden == 5
