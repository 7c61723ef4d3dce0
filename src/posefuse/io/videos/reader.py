"""VideoReader videos image by image, each with its own time; never more than one image in memory."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import must_exist
from posefuse.io.videos.library import import_pyav

PixelFormat = Literal["rgb24", "gray"]

VIDEO_ENDINGS = (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm", ".mpg", ".mts")

_QUARTER_DEG = 90
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
            from_s: start time; earlier images may be yielded, too. If it is later than a few seconds, images are
                numbered from the first one yielded.
            pixel_format: rgb24 for color, gray for brightness as stored (which may be 16 to 235), which is faster.
            only: whether the image of a number is wanted; others are decoded, but not yielded.
        """
        av = import_pyav()
        seeks = from_s > _MIN_SEEK_S
        try:
            with av.open(str(self.info.path)) as container:
                stream = container.streams.video[0]
                stream.thread_type = "AUTO"
                if seeks:
                    container.seek(int((self.info.first_s + from_s) / stream.time_base), stream=stream)
                for frame in container.decode(stream):
                    if only is None or only(self.n_read):
                        yield self._image(frame, pixel_format)
                    else:
                        self.n_read += 1
        except (av.error.FFmpegError, EOFError) as error:
            self.error = getattr(error, "strerror", None) or str(error)
        n_frames = self.info.n_frames
        if not self.error and not seeks and n_frames is not None and self.n_read < n_frames:
            self.error = f"its header states {n_frames} images"
        self.ended = True

    def _image(self, frame: Any, pixel_format: PixelFormat) -> VideoImage:
        rate_hz = self.info.rate_hz
        time_s = self.n_read / (rate_hz or 1.0) if frame.time is None else frame.time - self.info.first_s
        image = VideoImage(self.n_read, time_s, upright(frame, pixel_format))
        self.n_read += 1
        self.last_s = image.time_s
        return image


def open_video(path: Path) -> VideoReader:
    """Open a video and check that its first image can be read.

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
            info = VideoInfo(
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
    return VideoReader(info)


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


def quarter_turns(frame: Any) -> int:
    """Return the number of counterclockwise quarter turns for display."""
    return round((getattr(frame, "rotation", 0) or 0) / _QUARTER_DEG) % 4


def image_times_s(path: Path) -> np.ndarray:
    """Return the times of all images in s since the first one, shape (image,), ascending, without decoding.

    Raises:
        FileError: if the file cannot be read as a video.
    """
    av = import_pyav()
    times: list[float] = []
    try:
        with av.open(str(must_exist(path, "video"))) as container:
            stream = container.streams.video[0]
            for packet in container.demux(stream):
                if packet.pts is not None:
                    times.append(float(packet.pts * packet.time_base))
    except av.error.FFmpegError as error:
        if not times:
            raise FileError(f"{path} cannot be read as a video ({error.strerror}). Is it truncated?") from None
    ascending = np.sort(np.array(times))
    return ascending - ascending[0] if len(ascending) else ascending
