"""Run detectors side by side on the chunks of all views; each has a thread, and one more that decodes ahead.

A decoder has one thread, which costs the least CPU time. Decoding releases the interpreter's lock, and most detectors
run in processes of their own, so that all cores are used. Memory is bounded: each detector has a few batches of images
at a time.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from queue import Queue
from threading import Event, Thread
from typing import Any

import numpy as np

from posefuse.detection.detector import Detector, FrameDetections
from posefuse.errors import DetectorError, OptionsError
from posefuse.io.read_ahead import read_ahead
from posefuse.io.view_images import ImageReader, ImageSource
from posefuse.model.options.detection import Rectangle
from posefuse.pipeline.detection.chunks import Chunk, ChunkQueue

_MOST_BATCH_BYTES = 64_000_000
_BATCHES_AHEAD = 2

Batch = tuple[list[int], list[np.ndarray]]


@dataclass(frozen=True, eq=False)
class ChunkDetections:
    """The detections in a chunk.

    Attributes:
        numbers: shape (image,), int64: images that could be read, ascending.
        people: shape (image,), int64: number of detections.
        keypoints_px: shape (row, keypoint, 2): detections in the order of the images.
        confidence: shape (row, keypoint).
    """

    numbers: np.ndarray
    people: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray

    def as_arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name."""
        return dict(vars(self))


@dataclass(frozen=True, eq=False)
class Task:
    """What all workers do.

    Attributes:
        sources: images of the views.
        rectangles: part of the images of a view that is examined, by the view's name.
        max_people: most people of an image, or None.
    """

    sources: Sequence[ImageSource]
    rectangles: Mapping[str, Rectangle]
    max_people: int | None


def detect_chunks(
    task: Task, queue: ChunkQueue, detectors: Sequence[Callable[[], Detector]]
) -> Iterator[int | tuple[Chunk, ChunkDetections]]:
    """Yield finished chunks, and the number of examined images in between.

    Args:
        task: what to do.
        queue: the chunks.
        detectors: returns the detector of each worker, in the worker's thread; the caller closes them.

    Raises:
        PosefuseError: the first error of any worker; the others stop.
    """
    results: Queue[Any] = Queue()
    stop = Event()
    threads = [
        Thread(target=_work, args=(w, task, queue, opened, results, stop), name=f"detector {w}", daemon=True)
        for w, opened in enumerate(detectors)
    ]
    for thread in threads:
        thread.start()
    running = len(threads)
    try:
        while running:
            result = results.get()
            if isinstance(result, BaseException):
                raise result
            if result is None:
                running -= 1
            else:
                yield result
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def _work(
    worker: int, task: Task, queue: ChunkQueue, opened: Callable[[], Detector], results: "Queue[Any]", stop: Event
) -> None:
    """Examine chunks until there are no more; the last result is None, or the error."""
    reader, view = None, -1
    try:
        detector = opened()
        while not stop.is_set() and (chunk := queue.take(worker)) is not None:
            if chunk.view != view and reader is not None:
                reader.close()
            if chunk.view != view or reader is None:
                reader, view = task.sources[chunk.view].open(), chunk.view
            found = _detect_chunk(task, chunk, reader, detector, results, stop)
            if found is not None:
                results.put((chunk, found))
        results.put(None)
    except BaseException as error:
        results.put(error)
    finally:
        if reader is not None:
            reader.close()


def _detect_chunk(
    task: Task, chunk: Chunk, reader: ImageReader, detector: Detector, results: "Queue[Any]", stop: Event
) -> ChunkDetections | None:
    """Return the detections in a chunk, or None if the work stops."""
    source = task.sources[chunk.view]
    rectangle = task.rectangles.get(source.name)
    n_keypoints = len(detector.skeleton)
    numbers: list[int] = []
    found: list[FrameDetections] = []
    detector.reset()
    bytes_each = 3 * source.size_px[0] * source.size_px[1]
    size = max(1, min(detector.batch_size, _MOST_BATCH_BYTES // bytes_each))
    for batch_numbers, images in read_ahead(_batches(chunk, reader, size, rectangle), _BATCHES_AHEAD):
        if stop.is_set():
            return None
        detected = detector.detect(images)
        if len(detected) != len(images):
            raise DetectorError(
                f"The detector {detector.name} returned {len(detected)} results for {len(images)} images."
            )
        numbers += batch_numbers
        found += [strongest(each, task.max_people) for each in detected]
        results.put(len(images))
    shift = np.zeros(2) if rectangle is None else np.array(rectangle[:2], dtype=np.float64)
    return ChunkDetections(
        np.array(numbers, dtype=np.int64),
        np.array([len(each) for each in found], dtype=np.int64),
        np.concatenate([np.empty((0, n_keypoints, 2)), *(each.keypoints_px for each in found)]) + shift,
        np.concatenate([np.empty((0, n_keypoints)), *(each.confidence for each in found)]),
    )


def strongest(detections: FrameDetections, most: int | None) -> FrameDetections:
    """Return the people with the highest mean confidence, in their order; the first ones where it is equal."""
    if most is None or len(detections) <= most:
        return detections
    detected = np.isfinite(detections.keypoints_px[..., 0]) & np.isfinite(detections.confidence)
    mean = np.where(detected, detections.confidence, 0.0).mean(axis=1)
    kept = np.sort(np.argsort(-mean, kind="stable")[:most])
    return FrameDetections(detections.keypoints_px[kept], detections.confidence[kept])


def _batches(chunk: Chunk, reader: ImageReader, size: int, rectangle: Rectangle | None) -> Iterator[Batch]:
    """Yield batches of numbers and images."""
    batch: Batch = [], []
    for number, image in reader.images(chunk.start, chunk.stop, chunk.wanted):
        batch[0].append(number)
        batch[1].append(_cut(image, rectangle))
        if len(batch[0]) == size:
            yield batch
            batch = [], []
    if batch[0]:
        yield batch


def _cut(image: np.ndarray, rectangle: Rectangle | None) -> np.ndarray:
    if rectangle is None:
        return image
    left, top, width, height = rectangle
    return image[top : top + height, left : left + width]


def check_rectangles(sources: Sequence[ImageSource], rectangles: Mapping[str, Rectangle]) -> None:
    """Check that the part that is examined lies in the images.

    Raises:
        OptionsError: if it does not.
    """
    for source in sources:
        if source.name in rectangles:
            left, top, width, height = rectangles[source.name]
            if left + width > source.size_px[0] or top + height > source.size_px[1]:
                raise OptionsError(
                    f"crop of view {source.name!r} reaches to column {left + width} and row {top + height}, but its "
                    f"images have {source.size_px[0]} x {source.size_px[1]} px."
                )
