"""MP4 files that viewers can play."""

import tempfile
from pathlib import Path

from posefuse.errors import FileError
from posefuse.io.videos.info import VideoInfo
from posefuse.io.videos.reader import open_video
from posefuse.io.videos.writer import write_video

_PLAYABLE_CODECS = ("h264", "hevc", "av1", "vp9", "vp8")


def is_playable(info: VideoInfo) -> bool:
    """Return whether viewers can play the file unchanged."""
    return "mp4" in info.container.split(",") and info.codec in _PLAYABLE_CODECS


def transcode_to_mp4(path: Path) -> bytes:
    """Transcode a video to H.264 in MP4 with the same image times, and return the file's content.

    Raises:
        FileError: if no image can be read.
    """
    reader = open_video(path)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy.mp4"
        with write_video(copy, reader.info.size_px, reader.info.rate_hz or 30.0) as writer:
            for image in reader.images():
                writer.add(image.rgb, image.time_s)
        return copy.read_bytes()


def read_content(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
        FileError: if it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None
