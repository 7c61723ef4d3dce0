"""Metadata of videos."""

import pytest

from posefuse.errors import FileError
from posefuse.io.videos.info import read_video_info
from tests.videos import coded_video


def test_metadata_are_those_of_the_file(tmp_path):
    info = read_video_info(coded_video(tmp_path / "a.mp4", 9, 30.0, (64, 48)))
    assert (info.size_px, info.n_frames, info.codec, info.first_s) == ((64, 48), 9, "h264", 0.0)
    assert info.rate_hz == pytest.approx(30.0, rel=1e-3)


def test_a_file_that_is_no_video_is_one_sentence(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"no video")
    with pytest.raises(FileError, match="cannot be read as a video"):
        read_video_info(tmp_path / "a.mp4")
    with pytest.raises(FileError, match="No video at"):
        read_video_info(tmp_path / "b.mp4")
