"""Chunks of the views' images, the units of work of a detection: a detector starts afresh at each of them.

The chunks follow from the videos and the options alone, so that results depend neither on the number of detectors nor
on interruptions.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from threading import Lock

import numpy as np

from posefuse.io.view_images import ImageSource
from posefuse.model.options.detection import DetectOptions

CHUNK_IMAGES = 300
"""Number of images that are examined in a chunk, unless decoding can start nearby."""
_MOST_INTERVAL = 10
_TIME_SLACK_S = 1e-6


@dataclass(frozen=True, order=True)
class Chunk:
    """A range of the images of a view.

    Attributes:
        view: index of the view.
        start: first image.
        stop: end of the range, exclusive.
        every: interval of the images that are examined; their numbers are multiples of it.
    """

    view: int
    start: int
    stop: int
    every: int = 1

    @property
    def name(self) -> str:
        """Name under which its result is stored."""
        return f"view{self.view}-{self.start}"

    @property
    def n_images(self) -> int:
        """Number of images to examine."""
        return -(-self.stop // self.every) + (-self.start // self.every)

    def wanted(self, number: int) -> bool:
        """Return whether an image is to be examined."""
        return number % self.every == 0


def plan_chunks(sources: Sequence[ImageSource], options: DetectOptions) -> tuple[Chunk, ...]:
    """Return the chunks of all views that contain an image to examine, ordered by view and start."""
    chunks = [chunk for v, source in enumerate(sources) for chunk in _chunks_of(v, source, options)]
    return tuple(chunk for chunk in chunks if chunk.n_images)


def _chunks_of(view: int, source: ImageSource, options: DetectOptions) -> list[Chunk]:
    """Return the chunks of a view: they end where decoding can start, if such an image is near."""
    start, stop = 0, source.n_images
    if source.index is not None:
        end_s = np.inf if options.end_s is None else options.end_s
        start, stop = (int(np.searchsorted(source.time_s, t - _TIME_SLACK_S)) for t in (options.start_s, end_s))
    length = CHUNK_IMAGES * min(options.every, _MOST_INTERVAL)
    chunks = []
    while start < stop:
        near = source.starts[(source.starts >= start + length // 2) & (source.starts <= start + 3 * length // 2)]
        end = start + length if not len(near) else int(near[np.argmin(np.abs(near - start - length))])
        chunks.append(Chunk(view, start, min(end, stop), options.every))
        start = end
    return chunks


class ChunkQueue:
    """Hands out chunks to workers, such that each continues its video as long as possible.

    A worker without a video takes one that no other worker reads, or else the second half of the longest rest of
    another worker's.

    Args:
        chunks: the chunks of all views, ordered.
        done: names of those that need no work.
    """

    def __init__(self, chunks: Sequence[Chunk], done: Collection[str] = ()) -> None:
        self._chunks = list(chunks)
        self._pending = [chunk.name not in done for chunk in chunks]
        self._busy: dict[int, int] = {}
        self._lock = Lock()

    def take(self, worker: int) -> Chunk | None:
        """Return the next chunk of a worker, or None if there are no more."""
        with self._lock:
            at = self._next(self._busy.pop(worker, None))
            if at is None:
                return None
            self._pending[at] = False
            self._busy[worker] = at
            return self._chunks[at]

    def _next(self, last: int | None) -> int | None:
        if last is not None and self._follows(last + 1):
            return last + 1
        runs = self._runs()
        if not runs:
            return None
        busy = set(self._busy.values())
        free = [run for run in runs if run[0] - 1 not in busy or not self._follows(run[0])]
        first, length = max(free or runs, key=lambda run: (run[1], -run[0]))
        return first if free else first + length // 2

    def _follows(self, at: int) -> bool:
        """Return whether a pending chunk continues the one before it."""
        return 0 < at < len(self._chunks) and self._pending[at] and self._chunks[at].view == self._chunks[at - 1].view

    def _runs(self) -> list[tuple[int, int]]:
        """Return first chunk and length of each run of pending chunks of one view."""
        runs: list[tuple[int, int]] = []
        for at, pending in enumerate(self._pending):
            if not pending:
                continue
            if runs and runs[-1][0] + runs[-1][1] == at and self._follows(at):
                runs[-1] = (runs[-1][0], runs[-1][1] + 1)
            else:
                runs.append((at, 1))
        return runs
