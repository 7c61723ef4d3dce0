"""The index of a video's images: true times, and where decoding can start."""

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.videos.frame_index import read_frame_index
from tests.filmed_blobs import film


def test_times_of_a_variable_rate_are_exact(tmp_path):
    rng = np.random.default_rng(1)
    ticks = np.concatenate([[0], np.cumsum(rng.integers(900, 9000, 49))])
    for ending in ("mp4", "mov"):
        index = read_frame_index(film(tmp_path / f"a.{ending}", ticks / 90_000))
        np.testing.assert_allclose(index.time_s, ticks / 90_000, atol=1e-9)
        assert index.seekable
        assert index.starts.tolist() == [0, 12, 24, 36, 48]


def test_dropped_frames_leave_a_gap(tmp_path):
    times_s = np.delete(np.arange(40) / 25.0, [10, 11, 12])
    index = read_frame_index(film(tmp_path / "a.mp4", times_s))
    np.testing.assert_allclose(index.time_s, times_s, atol=1e-9)
    assert index.rate_hz == pytest.approx(25.0, rel=1e-4)


def test_times_count_from_the_first_image(tmp_path):
    index = read_frame_index(film(tmp_path / "a.mkv", 3.0 + np.arange(20) / 25.0))
    np.testing.assert_allclose(index.time_s, np.arange(20) / 25.0, atol=1.1e-3)  # Matroska stores milliseconds


def test_unreliable_times_are_replaced_by_the_rate(tmp_path):
    """H.264 with B-frames in AVI has times in the order of decoding."""
    index = read_frame_index(film(tmp_path / "a.avi", np.arange(30) / 25.0))
    assert not index.seekable
    assert index.starts.tolist() == [0]
    assert index.n_images == 30
    assert (np.diff(index.time_s) > 0).all()


def test_truncated_video_states_how_much_is_left(tmp_path):
    path = film(tmp_path / "a.avi", 60, codec="mjpeg", pixels="yuvj420p")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    index = read_frame_index(path)
    assert 20 < index.n_images < 40
    assert index.note == f"a.avi breaks off: its header states 60 images, and it holds {index.n_images}."


def test_a_file_without_images_is_one_sentence(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"no video")
    with pytest.raises(FileError, match="cannot be read as a video"):
        read_frame_index(tmp_path / "a.mp4")
