"""Videos in and out: pictures, times, and what is said of broken ones."""

import struct

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.videos import library
from posefuse.io.videos.footage import as_mp4, is_played
from posefuse.io.videos.reading import open_video, picture_times_s
from posefuse.io.videos.writing import write_video
from tests.videos import coded_video, codes_of, pictures_of


def test_pictures_and_times_come_back(tmp_path):
    path = coded_video(tmp_path / "a.mp4", 9, 30.0, (64, 48))
    reading = open_video(path)
    images = list(reading.images())
    assert codes_of([image.rgb for image in images]) == list(range(9))
    assert [image.time_s for image in images] == pytest.approx(np.arange(9) / 30, abs=1e-4)
    assert picture_times_s(path) == pytest.approx(np.arange(9) / 30, abs=1e-4)
    assert (reading.facts.size_px, reading.facts.n_frames, reading.broken) == ((64, 48), 9, "")
    assert reading.facts.rate_hz == pytest.approx(30.0, rel=1e-3)


def test_colours_stay(tmp_path):
    rgb = np.zeros((48, 64, 3), dtype=np.uint8)
    rgb[:, :32], rgb[:, 32:] = (200, 60, 30), (20, 90, 210)
    with write_video(tmp_path / "a.mp4", (64, 48), 25.0) as writing:
        writing.add(rgb, 0.0)
    (back,) = pictures_of(tmp_path / "a.mp4")
    assert np.abs(back[24, 10].astype(int) - rgb[24, 10]).max() < 8
    assert np.abs(back[24, 50].astype(int) - rgb[24, 50]).max() < 8


def test_uneven_times_are_kept_and_odd_sizes_padded(tmp_path):
    times_s = [0.0, 0.1, 0.15, 0.4]
    with write_video(tmp_path / "a.mp4", (33, 21), 25.0) as writing:
        for time_s in times_s:
            writing.add(np.full((21, 33, 3), 90, dtype=np.uint8), time_s)
    images = list(open_video(tmp_path / "a.mp4").images())
    assert [image.time_s for image in images] == pytest.approx(times_s, abs=1e-4)
    assert images[0].rgb.shape == (22, 34, 3)


def test_a_late_start_is_sought(tmp_path):
    path = coded_video(tmp_path / "a.mp4", 20, 0.5, (64, 48))
    assert 0.0 <= next(iter(open_video(path).images(30.0))).time_s <= 30.0


def test_a_turned_video_is_upright(tmp_path):
    rgb = np.full((48, 64, 3), 40, dtype=np.uint8)
    rgb[:12, :16] = 230
    path = tmp_path / "a.mp4"
    with write_video(path, (64, 48), 25.0) as writing:
        writing.add(rgb, 0.0)
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 44
    clockwise = (0, 0x10000, 0, -0x10000, 0, 0, 48 << 16, 0, 0x40000000)
    content[at : at + 36] = struct.pack(">9i", *clockwise)
    path.write_bytes(content)
    reading = open_video(path)
    (image,) = reading.images()
    assert reading.facts.size_px == (48, 64)
    assert image.rgb.shape == (64, 48, 3)
    assert image.rgb[4, -4].min() > 200  # what was at the top left is at the top right
    assert image.rgb[4, 4].max() < 80


def test_nothing_half_written_stays(tmp_path):
    with pytest.raises(ZeroDivisionError), write_video(tmp_path / "a.mp4", (64, 48), 25.0) as writing:
        writing.add(np.zeros((48, 64, 3), dtype=np.uint8), 0.0)
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_other_kinds_are_made_mp4(tmp_path):
    av = library.pyav()
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for f in range(5):
            rgb = np.full((48, 64, 3), 20 + 10 * f, dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        container.mux(stream.encode(None))
    assert not is_played(open_video(path).facts)
    (tmp_path / "b.mp4").write_bytes(as_mp4(path))
    assert is_played(open_video(tmp_path / "b.mp4").facts)
    assert codes_of(pictures_of(tmp_path / "b.mp4")) == list(range(5))


def test_what_is_no_video(tmp_path):
    sound = tmp_path / "a.txt"
    sound.write_text("hello")
    with pytest.raises(FileError, match="No video at"):
        open_video(tmp_path / "b.mp4")
    with pytest.raises(FileError, match="cannot be read as a video"):
        open_video(sound)
    with pytest.raises(FileError, match="is a folder"):
        open_video(tmp_path)
    with pytest.raises(FileError, match="cannot be read as a video"):
        picture_times_s(sound)
