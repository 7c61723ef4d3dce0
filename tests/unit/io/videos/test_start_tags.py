"""Tags of the start of videos."""

import pytest

from posefuse.errors import FileError
from posefuse.io.videos.start_tags import StartTags, read_start_tags
from tests.tagged_videos import tagged_video


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv"])
def test_timecode(tmp_path, ending):
    found = read_start_tags(tagged_video(tmp_path / f"a.{ending}", timecode="10:20:30:05"))
    assert found.timecode_s == pytest.approx(10 * 3600 + 20 * 60 + 30 + 5 / 25)
    assert found.duration_s == pytest.approx(2.0, abs=0.05)


def test_time_of_creation(tmp_path):
    early = read_start_tags(tagged_video(tmp_path / "a.mp4", created="2026-05-01T10:20:30Z"))
    late = read_start_tags(tagged_video(tmp_path / "b.mp4", created="2026-05-01T12:20:33+02:00"))
    assert early.created_s is not None
    assert late.created_s == pytest.approx(early.created_s + 3.0)
    assert early.timecode_s is None


def test_tags_that_are_no_times(tmp_path):
    assert read_start_tags(tagged_video(tmp_path / "a.mp4")) == StartTags(duration_s=2.0)
    # A camera without a clock.
    assert read_start_tags(tagged_video(tmp_path / "b.mp4", created="1970-01-01T00:00:10Z")).created_s is None
    with pytest.raises(FileError, match="No video at"):
        read_start_tags(tmp_path / "c.mp4")
    (tmp_path / "d.mp4").write_bytes(b"no video")
    with pytest.raises(FileError, match="cannot be read as a video"):
        read_start_tags(tmp_path / "d.mp4")
