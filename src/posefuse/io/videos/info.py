"""Metadata of a video."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from posefuse.errors import FileError
from posefuse.io.files import must_exist
from posefuse.io.videos.library import import_pyav

_QUARTER_DEG = 90


@dataclass(frozen=True)
class VideoInfo:
    """Metadata of a video.

    Attributes:
        path: path of the file.
        size_px: width and height for display, after the rotation that the file requests.
        rate_hz: mean frame rate, or None if unknown.
        n_frames: number of frames according to the file, or None if unknown.
        codec: name of the codec.
        container: names of the container format.
        first_s: timestamp of the first image in the file.
    """

    path: Path
    size_px: tuple[int, int]
    rate_hz: float | None
    n_frames: int | None
    codec: str
    container: str
    first_s: float = 0.0


def read_video_info(path: Path) -> VideoInfo:
    """Return the metadata of a video whose first image can be read.

    Raises:
        FileError: if there is no such file, or no image can be read.
    """
    av = import_pyav()
    must_exist(path, "video")
    if path.is_dir():
        raise FileError(f"{path} is a folder. Specify a video file.")
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise FileError(
                    f"{path} has no video stream, only: {', '.join(s.type for s in container.streams) or 'nothing'}."
                )
            stream = container.streams.video[0]
            first = next(container.decode(stream), None)
            if first is None:
                raise FileError(f"{path} is a video without images. Is it truncated?")
            width, height = first.width, first.height
            if quarter_turns(first) % 2:
                width, height = height, width
            rate = stream.average_rate
            return VideoInfo(
                path,
                (width, height),
                float(rate) if rate else None,
                stream.frames or None,
                stream.codec_context.name,
                container.format.name,
                first.time or 0.0,
            )
    except av.error.DecoderNotFoundError:
        raise FileError(
            f"{path} has a codec that PyAV cannot decode. Convert it, for example with ffmpeg -i {path.name} -c:v "
            "libx264 converted.mp4."
        ) from None
    except (av.error.FFmpegError, EOFError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{path} cannot be read as a video ({reason}). Is it truncated or not a video?") from None


def quarter_turns(frame: Any) -> int:
    """Return the number of counterclockwise quarter turns for display."""
    return round((getattr(frame, "rotation", 0) or 0) / _QUARTER_DEG) % 4
