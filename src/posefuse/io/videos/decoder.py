"""Decoding of ranges of a video's images by number, in order, without decoding what comes before more than needed."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.videos.frame_index import FrameIndex
from posefuse.io.videos.library import import_pyav
from posefuse.io.videos.reader import upright

_MAX_DAMAGED = 1000


class VideoDecoder:
    """Decode ranges of images; consecutive ranges continue where the last one ended.

    Args:
        index: the video's images.
        threads: number of threads of the decoder.
    """

    def __init__(self, index: FrameIndex, threads: int = 1) -> None:
        self._index, self._threads = index, threads
        self._container: Any = None
        self._frames: Iterator[tuple[int, Any]] = iter(())
        self._place = 0
        self._waiting: tuple[int, Any] | None = None

    def images(
        self, start: int, stop: int, wanted: Callable[[int], bool] | None = None
    ) -> Iterator[tuple[int, np.ndarray]]:
        """Yield number and image of those images of a range that can be decoded.

        Args:
            start: first image.
            stop: end of the range, exclusive.
            wanted: whether the image of a number is wanted; others are decoded, but not converted.

        Yields:
            The number, and the image for display: shape (height, width, 3), uint8, RGB.

        Raises:
            FileError: if the size of the images changes.
        """
        if self._container is None or not self._continues(start):
            self._seek(start)
        while True:
            item = self._waiting or next(self._frames, None)
            self._waiting = item
            if item is None or item[0] >= stop:
                return
            self._waiting, self._place = None, item[0] + 1
            if item[0] >= start and (wanted is None or wanted(item[0])):
                yield item[0], self._image(*item)

    def close(self) -> None:
        """Close the file."""
        if self._container is not None:
            self._container.close()
        self._container, self._frames, self._waiting = None, iter(()), None

    def _continues(self, start: int) -> bool:
        """Return whether decoding on from the current place is the shortest way to an image."""
        return self._place <= start and self._start_before(start) <= self._place

    def _start_before(self, number: int) -> int:
        """Return the last image at or before another at which decoding can start."""
        starts = self._index.starts
        return int(starts[np.searchsorted(starts, number, side="right") - 1])

    def _seek(self, number: int) -> None:
        """Continue from the last place at or before an image at which decoding can start."""
        first = self._start_before(number)
        while True:
            self._open()
            if first == 0 or not self._index.seekable:
                self._frames, self._place = self._decoded(), 0
                return
            self._container.seek(int(self._index.ticks[first]), stream=self._container.streams.video[0])
            self._frames, self._place = self._decoded(), first
            self._waiting = next(self._frames, None)
            if self._waiting is not None and self._waiting[0] <= first:
                return
            # The container's own index led behind the place: start at the one before.
            first = self._start_before(first - 1)

    def _open(self) -> None:
        av = import_pyav()
        self.close()
        self._container = av.open(str(self._index.info.path))
        stream = self._container.streams.video[0]
        stream.thread_type = "AUTO"
        stream.codec_context.thread_count = self._threads

    def _decoded(self) -> Iterator[tuple[int, Any]]:
        """Yield number and frame, in ascending order; packets that cannot be decoded are left out."""
        last = -1
        for counted, frame in enumerate(self._all_frames()):
            number = self._index.number_of(frame.pts, counted)
            if last < number < self._index.n_images:
                last = number
                yield number, frame

    def _all_frames(self) -> Iterator[Any]:
        av = import_pyav()
        packets = self._container.demux(self._container.streams.video[0])
        for _ in range(_MAX_DAMAGED):
            try:
                for packet in packets:
                    yield from packet.decode()
                return
            except av.error.EOFError:
                return
            except (av.error.FFmpegError, EOFError):
                continue  # the packet is damaged; the next ones may not be

    def _image(self, number: int, frame: Any) -> np.ndarray:
        rgb = upright(frame)
        expected = self._index.info.size_px
        if (rgb.shape[1], rgb.shape[0]) != expected:
            raise FileError(
                f"{self._index.info.path} changes its image size at image {number}, from {expected[0]} x {expected[1]} "
                f"to {rgb.shape[1]} x {rgb.shape[0]} px. Split it there; a camera has one image size."
            )
        return rgb
