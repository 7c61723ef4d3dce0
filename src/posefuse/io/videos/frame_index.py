"""The images of a video by number: true times, and where decoding can start, read from its packets."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.videos.info import VideoInfo, read_video_info
from posefuse.io.videos.library import import_pyav

_CHECKED_IMAGES = 12
_WITHOUT_INDEX = ("mpeg",)
"""Containers in which times after a seek may differ from those of a whole reading: MPEG program streams."""
_ASSUMED_RATE_HZ = 30.0


@dataclass(frozen=True, eq=False)
class FrameIndex:
    """The images of a video in order of time.

    Attributes:
        info: metadata of the video.
        time_s: shape (image,), ascending: times since the first image that can be decoded, from the presentation times.
        ticks: shape (image,), int64: presentation times in units of the video's time base.
        starts: shape (start,), int64, ascending: images at which decoding can start; the first is 0.
        seekable: whether images have the same times wherever decoding starts. If not, a video is decoded from its
            start, images are counted, and times that are missing or repeated follow from the frame rate.
        n_hidden: number of images that the file holds but does not show, such as those that an edit list cuts off.
        note: a sentence if the file holds fewer images than it states; otherwise empty.
    """

    info: VideoInfo
    time_s: np.ndarray
    ticks: np.ndarray
    starts: np.ndarray
    seekable: bool
    n_hidden: int = 0
    note: str = ""

    @property
    def n_images(self) -> int:
        """Number of images."""
        return len(self.time_s)

    @property
    def rate_hz(self) -> float | None:
        """Frame rate from the median step of the times; None with fewer than two images."""
        steps = np.diff(self.time_s)
        return float(1.0 / np.median(steps)) if len(steps) else None

    def number_at(self, time_s: float) -> int:
        """Return the number of the last image at or before a time, that of the first image if there is none."""
        return max(int(np.searchsorted(self.time_s, time_s, side="right")) - 1, 0)

    def number_of(self, tick: int | None, counted: int) -> int:
        """Return the number of a decoded image, that of the nearest time; -1 before the first image.

        Args:
            tick: its presentation time.
            counted: number of images that were decoded before it, which is its number in a video that is not seekable.
        """
        if not self.seekable:
            return counted
        ticks = self.ticks
        if tick is None or tick < ticks[0]:
            return -1
        above = min(int(np.searchsorted(ticks, tick)), len(ticks) - 1)
        return above if above == 0 or ticks[above] - tick <= tick - ticks[above - 1] else above - 1


def read_frame_index(path: Path) -> FrameIndex:
    """Return the index of a video's images. Only the first images are decoded.

    Raises:
        FileError: if there is no such file, it cannot be read as a video, or contains no image that can be decoded.
    """
    if not path.is_file():
        read_video_info(path)
    stat = path.stat()
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=64)
def _read(path: Path, _changed_ns: int, _size: int) -> FrameIndex:
    """Return the index of a video's images, read once for each content of the file."""
    info = read_video_info(path)
    packets = _packets(path)
    ticks, keys = packets.ticks, packets.keys
    note = ""
    if info.n_frames is not None and info.n_frames > packets.n_packets:
        note = f"{path.name} breaks off: its header states {info.n_frames} images, and it holds {packets.n_packets}."
    decoded = _first_ticks(path)
    order = np.unique(ticks)
    if not packets.stamped or len(order) < len(ticks) or None in decoded:
        rate_hz = info.rate_hz or _ASSUMED_RATE_HZ
        numbers = np.arange(len(ticks))
        hidden = packets.n_packets - len(ticks)
        return FrameIndex(info, numbers / rate_hz, numbers, numbers[:1], seekable=False, n_hidden=hidden, note=note)
    # Images before the first one that can be decoded belong to a group of pictures whose start is cut off.
    order = order[np.searchsorted(order, min(decoded)) :]
    seekable = info.container not in _WITHOUT_INDEX and order[: len(decoded)].tolist() == decoded
    starts = np.searchsorted(order, np.unique(keys[keys >= order[0]])) if seekable else order[:0]
    time_s = (order - order[0]) * packets.time_base_s
    starts = np.union1d(starts, [0]).astype(np.int64)
    hidden = packets.n_packets - len(order)
    return FrameIndex(info, time_s, order, starts, seekable=seekable, n_hidden=hidden, note=note)


@dataclass(frozen=True, eq=False)
class _Packets:
    """The packets of a video.

    Attributes:
        ticks: shape (packet,), int64: presentation times of shown images, in the order of the file.
        keys: shape (keyframe,), int64: those of keyframes.
        stamped: whether all times are known.
        n_packets: number of packets, with those of images that are not shown.
        time_base_s: unit of the times.
    """

    ticks: np.ndarray
    keys: np.ndarray
    stamped: bool
    n_packets: int
    time_base_s: float


def _packets(path: Path) -> _Packets:
    av = import_pyav()
    ticks, keys, stamped, n_packets = [], [], True, 0
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        try:
            for packet in container.demux(stream):
                n_packets += packet.size > 0
                if packet.size and not packet.is_discard:
                    stamped &= packet.pts is not None
                    ticks.append(packet.pts or 0)
                    if packet.is_keyframe:
                        keys.append(packet.pts or 0)
        except (av.error.FFmpegError, EOFError):
            pass  # what is there is used, and the number of images is compared with the header
        seconds = float(stream.time_base)
    return _Packets(np.array(ticks, dtype=np.int64), np.array(keys, dtype=np.int64), stamped, n_packets, seconds)


def _first_ticks(path: Path) -> list[Any]:
    """Return the presentation times of the first decoded images."""
    av = import_pyav()
    ticks: list[Any] = []
    try:
        with av.open(str(path)) as container:
            for frame in islice(container.decode(container.streams.video[0]), _CHECKED_IMAGES):
                ticks.append(frame.pts)
    except (av.error.FFmpegError, EOFError) as error:
        if not ticks:
            raise FileError(f"{path} cannot be read as a video ({error}). Is it truncated?") from None
    return ticks
