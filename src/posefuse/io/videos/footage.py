"""Videos as a viewer takes them: whole mp4 files of encodings that it plays."""

import tempfile
from pathlib import Path

from posefuse.errors import FileError
from posefuse.io.videos.reading import VideoFacts, open_video
from posefuse.io.videos.writing import write_video

_PLAYED = ("h264", "hevc", "av1", "vp9", "vp8")


def is_played(facts: VideoFacts) -> bool:
    """Whether the file can be given to a viewer as it is."""
    return "mp4" in facts.container.split(",") and facts.codec in _PLAYED


def as_mp4(path: Path) -> bytes:
    """The pictures of a video of any kind as the content of an mp4 in H.264, at the same times.

    Raises:
        FileError: if no picture can be read.
    """
    reading = open_video(path)
    with tempfile.TemporaryDirectory() as room:
        copy = Path(room) / "copy.mp4"
        with write_video(copy, reading.facts.size_px, reading.facts.rate_hz or 30.0) as writing:
            for image in reading.images():
                writing.add(image.rgb, image.time_s)
        return copy.read_bytes()


def content_of(path: Path) -> bytes:
    """The file's bytes.

    Raises:
        FileError: if it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None
