"""Reading videos picture by picture, each with its own time; never more than one picture in memory."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import must_exist
from posefuse.io.videos.library import pyav

_QUARTER_DEG = 90
_WORTH_SEEKING_S = 5.0


@dataclass(frozen=True, eq=False)
class VideoImage:
    """One picture of a video.

    Attributes:
        number: of the picture in the video, from 0.
        time_s: since the video's first picture, by the video's own time stamps.
        rgb: shape (height, width, 3), uint8, upright; read-only until copied.
    """

    number: int
    time_s: float
    rgb: np.ndarray


@dataclass(frozen=True)
class VideoFacts:
    """What a video says of itself.

    Attributes:
        path: of the file.
        size_px: width and height as shown: a telephone's note to turn the picture is obeyed.
        rate_hz: mean frame rate, or None where it does not say.
        n_frames: as the file claims, or None where it does not say.
        codec: name of its encoding.
        container: names of its file format.
        first_s: time stamp of the first picture in the file.
    """

    path: Path
    size_px: tuple[int, int]
    rate_hz: float | None
    n_frames: int | None
    codec: str
    container: str
    first_s: float = 0.0


@dataclass
class Reading:
    """A video being read; the only thing here that changes.

    Attributes:
        facts: of the video.
        n_read: pictures read so far.
        last_s: time of the last of them.
        broken: why no further picture could be read, empty where the video simply ended.
        ended: whether all has been read that can be.
    """

    facts: VideoFacts
    n_read: int = 0
    last_s: float = float("nan")
    broken: str = ""
    ended: bool = False

    def images(self, from_s: float = 0.0) -> Iterator[VideoImage]:
        """The pictures in order of time, to the end or to where the file breaks off; then ``broken`` says why.

        Args:
            from_s: a time before the first picture that is wanted; some before it may come too. Where it is past the
                beginning, pictures are numbered from the first that comes.
        """
        av = pyav()
        sought = from_s > _WORTH_SEEKING_S
        try:
            with av.open(str(self.facts.path)) as container:
                stream = container.streams.video[0]
                stream.thread_type = "AUTO"
                if sought:
                    container.seek(int((self.facts.first_s + from_s) / stream.time_base), stream=stream)
                for frame in container.decode(stream):
                    yield self._image(frame)
        except (av.error.FFmpegError, EOFError) as error:
            self.broken = getattr(error, "strerror", None) or str(error)
        claimed = self.facts.n_frames
        if not self.broken and not sought and claimed is not None and self.n_read < claimed:
            self.broken = f"it says it has {claimed} pictures"
        self.ended = True

    def _image(self, frame: Any) -> VideoImage:
        rate_hz = self.facts.rate_hz
        time_s = self.n_read / (rate_hz or 1.0) if frame.time is None else frame.time - self.facts.first_s
        image = VideoImage(self.n_read, time_s, upright(frame))
        self.n_read += 1
        self.last_s = image.time_s
        return image


def open_video(path: Path) -> Reading:
    """A video that can be read, its first picture tried.

    Raises:
        FileError: if there is no such file, or it holds no picture that can be read.
    """
    av = pyav()
    must_exist(path, "video")
    if path.is_dir():
        raise FileError(f"{path} is a folder; give a video file.")
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise FileError(
                    f"{path} holds no video, only {', '.join(s.type for s in container.streams) or 'nothing'}."
                )
            stream = container.streams.video[0]
            first = next(container.decode(stream), None)
            if first is None:
                raise FileError(f"{path} is a video without a picture. Was it cut short?")
            width, height = first.width, first.height
            if _quarters(first) % 2:
                width, height = height, width
            rate = stream.average_rate
            facts = VideoFacts(
                path,
                (width, height),
                float(rate) if rate else None,
                stream.frames or None,
                stream.codec_context.name,
                container.format.name,
                first.time or 0.0,
            )
    except (av.error.FFmpegError, EOFError) as error:
        said = getattr(error, "strerror", None) or str(error)
        raise FileError(
            f"{path} cannot be read as a video ({said}). Was it cut short, or is it another file?"
        ) from None
    return Reading(facts)


def upright(frame: Any) -> np.ndarray:
    """The picture of a decoded frame, shape (height, width, 3), uint8, turned as the video asks to be shown."""
    rgb = frame.to_ndarray(format="rgb24")
    quarters = _quarters(frame)
    return rgb if quarters == 0 else np.ascontiguousarray(np.rot90(rgb, quarters))


def _quarters(frame: Any) -> int:
    """How many quarter turns, counter-clockwise, the picture is to be turned for display."""
    return round((getattr(frame, "rotation", 0) or 0) / _QUARTER_DEG) % 4


def picture_times_s(path: Path) -> np.ndarray:
    """Shape (picture,): when each picture is shown, in seconds since the first, ascending; nothing is decoded.

    Raises:
        FileError: if the file cannot be read as a video.
    """
    av = pyav()
    times: list[float] = []
    try:
        with av.open(str(must_exist(path, "video"))) as container:
            stream = container.streams.video[0]
            for packet in container.demux(stream):
                if packet.pts is not None:
                    times.append(float(packet.pts * packet.time_base))
    except av.error.FFmpegError as error:
        if not times:
            raise FileError(f"{path} cannot be read as a video ({error.strerror}). Was it cut short?") from None
    ascending = np.sort(np.array(times))
    return ascending - ascending[0] if len(ascending) else ascending
