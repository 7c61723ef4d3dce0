"""Assemble the detections of all chunks to those of a recording, in ranges of frames; one view is linked at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.arrays import ranges
from posefuse.checkpoint import Checkpoint
from posefuse.errors import DetectionsError, choices
from posefuse.io.keypoints.tidy_parquet import frames_per_group
from posefuse.io.view_images import ImageSource
from posefuse.model.detections import Detections
from posefuse.pipeline.detection.chunks import Chunk
from posefuse.preprocess.link_detections import link_rows
from posefuse.preprocess.timeline import nominal_rate_hz
from posefuse.skeleton.skeletons import Skeleton

_SAME_RATE = 0.01


@dataclass(frozen=True, eq=False)
class ViewRecord:
    """What is kept in memory of the detections of a view.

    Attributes:
        source: its images.
        chunks: its chunks, in order.
        first_rows: shape (chunk + 1,): number of detections before each chunk.
        numbers: shape (image,), int64: examined images, ascending.
        people: shape (image,), int64: number of detections in each.
        track_ids: shape (row,), int64: identity of each detection in this view, -1 without one.
        n_lost: number of images that could not be decoded.
    """

    source: ImageSource
    chunks: tuple[Chunk, ...]
    first_rows: np.ndarray
    numbers: np.ndarray
    people: np.ndarray
    track_ids: np.ndarray
    n_lost: int

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on images that are missing."""
        name = self.source.name
        lost = f"{self.n_lost} of {len(self.numbers) + self.n_lost} images of view {name!r} cannot be decoded."
        broken = f"View {name!r}: {self.source.note}" if self.source.note else ""
        return tuple(note for note in (broken, lost if self.n_lost else "") if note)


def record_of_view(source: ImageSource, chunks: Sequence[Chunk], stored: Checkpoint, skeleton: Skeleton) -> ViewRecord:
    """Return the record of a view, with its detections linked to tracks.

    Args:
        source: images of the view.
        chunks: chunks of the view, in order.
        stored: detections of the chunks.
        skeleton: skeleton of the keypoints.
    """
    parts = [stored.load(chunk.name) for chunk in chunks]

    def joined(name: str, *shape: int) -> np.ndarray:
        return np.concatenate(
            [np.empty((0, *shape), dtype=np.int64 if not shape else float), *(p[name] for p in parts)]
        )

    numbers, people = joined("numbers"), joined("people")
    counts = [int(part["people"].sum()) for part in parts]
    time_s = source.time_s[numbers]
    ids = np.full(sum(counts), -1, dtype=np.int64)
    if np.isfinite(time_s).all() and len(ids):
        starts = np.concatenate([[0], np.cumsum(people)]).astype(np.int64)
        linked = link_rows(starts, time_s, joined("keypoints_px", len(skeleton), 2), ids, skeleton)
        ids = np.maximum(linked, -1)
    expected = sum(chunk.n_images for chunk in chunks)
    first_rows = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return ViewRecord(source, tuple(chunks), first_rows, numbers, people, ids, expected - len(numbers))


@dataclass(frozen=True, eq=False)
class Assembly:
    """The detections of all views of a recording.

    Attributes:
        records: what is kept in memory of each view.
        stored: detections of the chunks.
        skeleton: skeleton of the keypoints.
        every: interval of the examined images; frame n holds image n * every of each view.
        frame_numbers: shape (frame,), int64: frames that any view has.

    Raises:
        DetectionsError: if no view has an image.
    """

    records: tuple[ViewRecord, ...]
    stored: Checkpoint
    skeleton: Skeleton
    every: int
    frame_numbers: np.ndarray

    @classmethod
    def of(cls, records: Sequence[ViewRecord], stored: Checkpoint, skeleton: Skeleton, every: int) -> "Assembly":
        """Return the assembly of all views.

        Raises:
            DetectionsError: if no view has an image.
        """
        frames = np.unique(np.concatenate([record.numbers // every for record in records]))
        if not len(frames):
            names = choices([record.source.name for record in records])
            raise DetectionsError(
                f"No image of {names} lies in the selected time. Choose another `start_s`, `end_s` or `every`."
            )
        return cls(tuple(records), stored, skeleton, every, frames)

    def parts(self) -> Iterator[Detections]:
        """Yield the recording in ranges of frames, each of the size of a row group."""
        n_rows = sum(len(record.track_ids) for record in self.records)
        size = frames_per_group(len(self.frame_numbers), n_rows, len(self.skeleton))
        rate_hz, notes = self._rate_hz(), tuple(note for record in self.records for note in record.notes)
        views = [_ViewReader(record, self.stored, self.skeleton) for record in self.records]
        for start, stop in ranges(len(self.frame_numbers), size):
            yield self._part(self.frame_numbers[start:stop], views, rate_hz, notes)

    def _part(
        self, frames: np.ndarray, views: "Sequence[_ViewReader]", rate_hz: float | None, notes: tuple[str, ...]
    ) -> Detections:
        shape = len(frames), len(views)
        recorded, times, people = np.zeros(shape, dtype=bool), np.full(shape, np.nan), np.zeros(shape, dtype=np.int64)
        cells, pieces = [], []
        for v, view in enumerate(views):
            record = view.record
            of_view = record.numbers // self.every
            images = slice(int(np.searchsorted(of_view, frames[0])), int(np.searchsorted(of_view, frames[-1], "right")))
            places = np.searchsorted(frames, of_view[images])
            recorded[places, v] = True
            times[places, v] = record.source.time_s[record.numbers[images]]
            people[places, v] = record.people[images]
            cells.append(np.repeat(places * len(views) + v, record.people[images]))
            pieces.append(view.rows(images))
        order = np.argsort(np.concatenate(cells), kind="stable")
        pixels, confidence, ids = (np.concatenate(each)[order] for each in zip(*pieces, strict=True))
        return Detections(
            skeleton=self.skeleton,
            view_names=tuple(view.record.source.name for view in views),
            frame_numbers=frames,
            time_s=times,
            offsets=np.concatenate([[0], np.cumsum(people.ravel())]),
            keypoints_px=pixels,
            confidence=confidence,
            recorded=recorded,
            track_ids=ids,
            rate_hz=rate_hz,
            notes=notes,
        )

    def _rate_hz(self) -> float | None:
        """Return the rate of the frames; None if views have different ones, which their times then state."""
        rates = [
            nominal_rate_hz(record.numbers // self.every, record.source.time_s[record.numbers])
            for record in self.records
        ]
        known = [rate for rate in rates if rate is not None]
        same = bool(known) and max(known) <= min(known) * (1.0 + _SAME_RATE)
        return float(np.median(known)) if same else None


class _ViewReader:
    """Reads the detections of a view in ascending ranges; one chunk is in memory."""

    def __init__(self, record: ViewRecord, stored: Checkpoint, skeleton: Skeleton) -> None:
        self.record, self._stored, self._skeleton = record, stored, skeleton
        self._offsets = np.concatenate([[0], np.cumsum(record.people)])
        self._loaded: tuple[int, dict[str, np.ndarray]] = (-1, {})

    def rows(self, images: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return keypoints, confidence and track IDs of the detections in a range of examined images."""
        start, stop = int(self._offsets[images.start]), int(self._offsets[images.stop])
        n_keypoints = len(self._skeleton)
        pixels, confidence = [np.empty((0, n_keypoints, 2))], [np.empty((0, n_keypoints))]
        firsts = self.record.first_rows
        for c in range(max(int(np.searchsorted(firsts, start, "right")) - 1, 0), len(self.record.chunks)):
            if firsts[c] >= stop:
                break
            part = self._chunk(c)
            rows = slice(max(start - int(firsts[c]), 0), stop - int(firsts[c]))
            pixels.append(part["keypoints_px"][rows])
            confidence.append(part["confidence"][rows])
        return np.concatenate(pixels), np.concatenate(confidence), self.record.track_ids[start:stop]

    def _chunk(self, c: int) -> dict[str, np.ndarray]:
        if self._loaded[0] != c:
            self._loaded = c, self._stored.load(self.record.chunks[c].name)
        return self._loaded[1]
