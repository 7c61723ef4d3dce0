"""Small copies of videos that every browser plays and seeks quickly: H.264 in MP4."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.io.videos.info import VideoInfo, quarter_turns
from posefuse.io.videos.library import import_pyav
from posefuse.io.videos.reader import VideoReader, upright
from posefuse.io.videos.writer import add_h264_stream

LONG_SIDE_PX = 640
RATE_HZ = 30.0
_ENCODER = {"crf": "29", "preset": "veryfast", "threads": "1", "g": "15", "bf": "0"}
"""A key frame every 15 images and no image that depends on later ones: seeking decodes few images."""
_TICKS_HZ = 90_000


@dataclass(frozen=True)
class SmallCopy:
    """A small copy of a video.

    Attributes:
        path: path of the file.
        size_px: width and height of its images.
        n_images: number of images; without any, there is no file.
        first_s: time of the first image on the clock of the caller, which is time 0 of the file.
        last_s: time of the last image on the clock of the caller.
        error: why the video could not be read to its end; empty at its regular end.
    """

    path: Path
    size_px: tuple[int, int]
    n_images: int
    first_s: float
    last_s: float
    error: str = ""


def write_small_copy(
    info: VideoInfo, path: Path, time_of: Callable[[int, float], float], duration_s: float, from_s: float = 0.0
) -> SmallCopy:
    """Write a copy of at most 640 px and 30 images per second, with times on a clock of the caller.

    Args:
        info: the video.
        path: the MP4 file to write.
        time_of: returns the time of an image on the clock of the caller, from its number and its time since the first
            image. Images before 0 and from ``duration_s`` on are left out.
        duration_s: duration of the copy.
        from_s: time in the video from which images are needed.

    Raises:
        FileError: if PyAV or its encoder is missing.
    """
    av = import_pyav()
    size_px = _small(info.size_px)
    n_images, first_s, last_s, error = 0, float("nan"), float("-inf"), ""
    # Half a step of tolerance keeps every image of a video with the highest rate.
    step_s = 0.75 / RATE_HZ
    reader = VideoReader(info)
    with av.open(str(path), "w", format="mp4", options={"fflags": "+bitexact", "movflags": "+faststart"}) as target:
        stream = add_h264_stream(target, size_px, min(info.rate_hz or RATE_HZ, RATE_HZ), _ENCODER)
        try:
            for number, image_s, frame in reader.frames(from_s):
                time_s = time_of(number, image_s)
                if time_s >= duration_s:
                    break
                if time_s < 0.0 or time_s < last_s + step_s:
                    continue
                first_s = time_s if not n_images else first_s
                # The file starts with its first image: players treat a later start differently.
                target.mux(stream.encode(_scaled(frame, size_px, time_s - first_s, av)))
                n_images, last_s = n_images + 1, time_s
            error = reader.error
        except (av.error.FFmpegError, EOFError) as problem:
            error = getattr(problem, "strerror", None) or str(problem)
        if n_images:
            target.mux(stream.encode(None))
    if not n_images:
        path.unlink(missing_ok=True)
    return SmallCopy(path, size_px, n_images, first_s, last_s, error)


def _small(size_px: tuple[int, int]) -> tuple[int, int]:
    """Return an even size with about the same aspect ratio and a long side of at most 640 px."""
    scale = min(1.0, LONG_SIDE_PX / max(size_px))
    width, height = (max(2 * round(side * scale / 2), 2) for side in size_px)
    return width, height


def _scaled(frame: Any, size_px: tuple[int, int], time_s: float, av: Any) -> Any:
    """Return an image of the copy; only videos stored on their side take the way through an array."""
    if quarter_turns(frame):
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(upright(frame)), format="rgb24")
    small = frame.reformat(*size_px, format="yuv420p", interpolation="AREA")
    small.pts, small.time_base = round(time_s * _TICKS_HZ), Fraction(1, _TICKS_HZ)
    # The type of the original image would decide that of the copy.
    small.pict_type = 0
    return small
