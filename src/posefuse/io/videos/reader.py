"""Read videos image by image, each with its own time; never more than one image in memory."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from posefuse.io.videos.frame_index import read_frame_index
from posefuse.io.videos.info import VideoInfo, quarter_turns, read_video_info
from posefuse.io.videos.library import import_pyav

PixelFormat = Literal["rgb24", "gray"]

VIDEO_ENDINGS = (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm", ".mpg", ".mts")

_MIN_SEEK_S = 5.0
# Pixel formats of 8 bit whose first plane is the brightness.
_BRIGHTNESS_FIRST = {"yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "nv12", "nv21", "gray"}


@dataclass(frozen=True, eq=False)
class VideoImage:
    """One image of a video.

    Attributes:
        number: index of the image in the video, from 0.
        time_s: time since the first image, from the video's timestamps.
        rgb: shape (height, width, 3), uint8, rotated for display; may be read-only. Shape (height, width) if the images
            are read in gray.
    """

    number: int
    time_s: float
    rgb: np.ndarray


@dataclass
class VideoReader:
    """A video being read.

    Attributes:
        info: metadata of the video.
        n_read: number of images read so far.
        last_s: time of the last image read.
        error: why no further image can be read; empty at the regular end of the video.
        ended: whether reading has ended.
    """

    info: VideoInfo
    n_read: int = 0
    last_s: float = float("nan")
    error: str = ""
    ended: bool = False

    def images(
        self,
        from_s: float = 0.0,
        pixel_format: PixelFormat = "rgb24",
        only: Callable[[int], bool] | None = None,
    ) -> Iterator[VideoImage]:
        """Yield the images in order of time, up to the end or the first unreadable one, which sets ``error``.

        Args:
            from_s: start time; earlier images may be yielded, too.
            pixel_format: rgb24 for color, gray for brightness as stored (which may be 16 to 235), which is faster.
            only: whether the image of a number is wanted; others are decoded, but not yielded.
        """
        for number, time_s, frame in self.frames(from_s, only):
            yield VideoImage(number, time_s, upright(frame, pixel_format))

    def frames(
        self, from_s: float = 0.0, only: Callable[[int], bool] | None = None
    ) -> Iterator[tuple[int, float, Any]]:
        """Yield number, time and decoded frame of each image, as :meth:`images` does."""
        av = import_pyav()
        index = read_frame_index(self.info.path)
        seeks = from_s > _MIN_SEEK_S and index.seekable
        last = -1
        try:
            with av.open(str(self.info.path)) as container:
                stream = container.streams.video[0]
                stream.thread_type = "AUTO"
                if seeks:
                    container.seek(int(index.ticks[index.number_at(from_s)]), stream=stream)
                for counted, frame in enumerate(container.decode(stream)):
                    number = index.number_of(frame.pts, counted)
                    if not last < number < index.n_images:
                        continue
                    last = number
                    self.n_read, self.last_s = self.n_read + 1, float(index.time_s[number])
                    if only is None or only(number):
                        yield number, self.last_s, frame
        except (av.error.FFmpegError, EOFError) as error:
            self.error = getattr(error, "strerror", None) or str(error)
        n_frames = self.info.n_frames
        if not self.error and not seeks and n_frames is not None and self.n_read < n_frames - index.n_hidden:
            self.error = f"its header states {n_frames} images"
        self.ended = True


def open_video(path: Path) -> VideoReader:
    """Open a video and check that its first image can be read.

    Raises:
        FileError: if there is no such file, or no image can be read.
    """
    return VideoReader(read_video_info(path))


def upright(frame: Any, pixel_format: PixelFormat = "rgb24") -> np.ndarray:
    """Return the image of a decoded frame, rotated for display, shape (height, width, 3) or (height, width), uint8."""
    rgb = _brightness(frame) if pixel_format == "gray" else frame.to_ndarray(format=pixel_format)
    quarters = quarter_turns(frame)
    return rgb if quarters == 0 else np.ascontiguousarray(np.rot90(rgb, quarters))


def _brightness(frame: Any) -> np.ndarray:
    """Return the brightness, shape (height, width), uint8; that of most videos is stored as a plane and not converted.

    The stored range may be 16 to 235, which is as good for finding edges and takes half the time of decoding.
    """
    if frame.format.name not in _BRIGHTNESS_FIRST:
        return frame.to_ndarray(format="gray")
    plane = frame.planes[0]
    return np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width]
