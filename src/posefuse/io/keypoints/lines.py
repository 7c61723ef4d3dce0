"""Records of JSON, mostly lines of it, read by ranges of people: what is where is found once, numbers when asked for.

Of a recording of any length some 40 bytes for each view's frame and 8 for each person are in memory, and the numbers
of the range that was asked for last.
"""

from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from posefuse.errors import DetectionsError, FileError
from posefuse.io.files import reading
from posefuse.io.keypoints.columns import line_of_frames, rate_of_frames
from posefuse.io.keypoints.infer_skeleton import guess_skeleton
from posefuse.io.keypoints.lazy_columns import RowsByRange
from posefuse.model.detections import Detections, frame_times
from posefuse.skeleton.skeletons import Skeleton

Decode = Callable[[bytes, Path, str], dict[str, np.ndarray]]
"""Makes of a record, its file, and what to call it in messages each camera's people: (person, keypoint, channel)."""

PIXELS, CONFIDENCE, SIGMA, DEPTH = (0, 1), (2,), (3,), (4,)
"""Channels of people's numbers; the last two only where a format has them."""
_JUDGED = 500


@dataclass(frozen=True)
class Record:
    """Where a record is.

    Attributes:
        file: which of the files.
        start: its first byte.
        size: its bytes.
    """

    file: int
    start: int
    size: int


@dataclass(frozen=True)
class Cells:
    """Who is where, in the order of the files: grown while they are looked through.

    Attributes:
        record: of each cell, a camera in a frame, the numbers of its :class:`Record`.
        frame: its frame's number.
        camera: which of the cameras.
        people: how many are in it.
        time_s: when the camera took it; NaN where nobody knows.
        tracks: of each person.
    """

    record: tuple["array[int]", "array[int]", "array[int]"] = field(
        default_factory=lambda: (array("q"), array("q"), array("q"))
    )
    frame: "array[int]" = field(default_factory=lambda: array("q"))
    camera: "array[int]" = field(default_factory=lambda: array("q"))
    people: "array[int]" = field(default_factory=lambda: array("q"))
    time_s: "array[float]" = field(default_factory=lambda: array("d"))
    tracks: "array[int]" = field(default_factory=lambda: array("q"))

    def add(self, record: Record, frame: int, camera: int, time_s: float, tracks: Sequence[int]) -> None:
        """Add a cell."""
        for column, number in zip(self.record, (record.file, record.start, record.size), strict=True):
            column.append(number)
        self.frame.append(frame)
        self.camera.append(camera)
        self.people.append(len(tracks))
        self.time_s.append(time_s)
        self.tracks.extend(tracks)


@dataclass(frozen=True)
class Index:
    """Cells in the order of :class:`Detections`: by frame, then view.

    Attributes:
        files: that the records are in.
        names: of the cameras.
        record: shape (cell, 3), int64: file, first byte and bytes of each cell's record.
        frame: shape (cell,): number of the frame.
        camera: shape (cell,).
        ends: shape (cell + 1,): people before each cell.
        time_s: shape (cell,).
        tracks: shape (person,).
        n_keypoints: of each person; 0 where there is nobody.
    """

    files: tuple[Path, ...]
    names: tuple[str, ...]
    record: np.ndarray
    frame: np.ndarray
    camera: np.ndarray
    ends: np.ndarray
    time_s: np.ndarray
    tracks: np.ndarray
    n_keypoints: int


def index_of(path: Path, files: Sequence[Path], names: Sequence[str], cells: Cells, n_keypoints: int) -> Index:
    """Put cells in order.

    Args:
        path: for messages.
        files: that the records are in.
        names: of the cameras.
        cells: in any order.
        n_keypoints: of each person.

    Raises:
        FileError: if there are none, or a camera has a frame twice.
    """
    frame, camera, people = (np.array(column, dtype=np.int64) for column in (cells.frame, cells.camera, cells.people))
    if not len(frame):
        raise FileError(f"{path} is an empty recording: it has no frames.")
    order = np.lexsort((camera, frame))
    frame, camera = frame[order], camera[order]
    twice = (np.diff(frame) == 0) & (np.diff(camera) == 0)
    if twice.any():
        at = int(np.argmax(twice))
        raise FileError(f"{path}: camera {names[camera[at]]!r} has two records of frame {frame[at]}.")
    first = (np.cumsum(people) - people)[order]
    people = people[order]
    ends = np.concatenate([[0], np.cumsum(people)])
    rows = np.repeat(first - ends[:-1], people) + np.arange(int(ends[-1]))
    record = np.array([np.array(column, dtype=np.int64)[order] for column in cells.record]).T
    return Index(
        tuple(files), tuple(names), record, frame, camera, ends, np.array(cells.time_s)[order],
        np.array(cells.tracks, dtype=np.int64)[rows], n_keypoints,
    )  # fmt: skip


class Numbers:
    """People's numbers, in their records.

    Those of the range asked for last are kept: of a range of frames, positions are asked for first, then confidences.

    Args:
        index: of the records.
        decode: makes sense of one.
        n_channels: of each keypoint.
    """

    def __init__(self, index: Index, decode: Decode, n_channels: int) -> None:
        self.index, self.n_channels = index, n_channels
        self._decode = decode
        self._last = 0, np.empty((0, index.n_keypoints, n_channels))

    def rows(self, start: int, stop: int) -> np.ndarray:
        """Shape (row, keypoint, channel), of the people from ``start`` to before ``stop``."""
        first, held = self._last
        if not first <= start <= stop <= first + len(held):
            first, held = start, self._read(start, stop)
            self._last = first, held
        return held[start - first : stop - first]

    def _read(self, start: int, stop: int) -> np.ndarray:
        out = np.full((stop - start, self.index.n_keypoints, self.n_channels), np.nan)
        ends = self.index.ends
        cells = range(int(np.searchsorted(ends, start, "right")) - 1, int(np.searchsorted(ends, stop, "left")))
        occupied = (cell for cell in cells if ends[cell + 1] > ends[cell])
        for cell, people in self._people(occupied):
            begin, end = int(ends[cell]), int(ends[cell + 1])
            low, high = max(begin, start), min(end, stop)
            out[low - start : high - start] = people[low - begin : high - begin]
        return out

    def _people(self, cells: Iterator[int]) -> Iterator[tuple[int, np.ndarray]]:
        """The people of cells; of cells that follow each other in one record that is read once."""
        index, last, found = self.index, (-1, -1), dict[str, np.ndarray]()
        with ExitStack() as opened:
            handles: dict[int, BinaryIO] = {}
            for cell in cells:
                file, at, size = index.record[cell].tolist()
                path, name = index.files[file], index.names[index.camera[cell]]
                with reading(path, "file of records"):
                    if file not in handles:
                        handles[file] = opened.enter_context(path.open("rb"))
                    if (file, at) != last:
                        handles[file].seek(at)
                        found = self._decode(handles[file].read(size), path, f"{path}, at byte {at}")
                        last = file, at
                wanted = int(index.ends[cell + 1] - index.ends[cell]), index.n_keypoints, self.n_channels
                if name not in found or found[name].shape != wanted:
                    raise FileError(f"{path} was changed while it was read: other people are at byte {at} now.")
                yield cell, found[name]


class NumberRows(RowsByRange):
    """Some channels of people's numbers."""

    def __init__(self, numbers: Numbers, channels: Sequence[int]) -> None:
        index = numbers.index
        depth = (len(channels),) if len(channels) > 1 else ()
        super().__init__((int(index.ends[-1]), index.n_keypoints, *depth))
        self._numbers, self._channels = numbers, list(channels)

    def rows(self, start: int, stop: int) -> np.ndarray:
        """A copy: what is kept is another's too."""
        values = self._numbers.rows(start, stop)[..., self._channels]
        return values.reshape(stop - start, *self.shape[1:])


def must_be_possible(values: np.ndarray, where: str) -> None:
    """Refuse numbers that no detector can have meant, before anything is made of the recording.

    Args:
        values: shape (person, keypoint, channel).
        where: for messages.

    Raises:
        DetectionsError: on infinities, and on standard deviations that are not positive.
    """
    if np.isinf(values).any():
        raise DetectionsError(f"{where} holds an infinite number. Missing is null: mend the file.")
    if values.shape[-1] > SIGMA[0] and (values[..., SIGMA[0]] <= 0.0).any():
        raise DetectionsError(f"{where}: sigma_px holds a number that is not positive. Unknown is null.")


@dataclass(frozen=True)
class Told:
    """What is known of a recording besides its cells.

    Attributes:
        skeleton: of the keypoints; None where their number tells.
        rate_hz: frames per second, or None.
        notes: what is worth saying.
        channels: which there are: :data:`PIXELS` and :data:`CONFIDENCE`, and maybe :data:`SIGMA`, :data:`DEPTH`.
        own: whether posefuse wrote the files; then frames may lie far apart.
    """

    skeleton: Skeleton | None
    rate_hz: float | None
    notes: tuple[str, ...] = ()
    channels: tuple[tuple[int, ...], ...] = (PIXELS, CONFIDENCE)
    own: bool = False


def detections_of_lines(path: Path, index: Index, decode: Decode, n_channels: int, told: Told) -> Detections:
    """The detections of records, whose numbers stay in their files.

    Args:
        path: for messages.
        index: of the records.
        decode: makes sense of one.
        n_channels: of what it makes.
        told: what else is known.

    Raises:
        FileError: if frame numbers make no recording, or nobody was detected and nothing tells the skeleton.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    numbers = line_of_frames(path, index.frame, own=told.own)
    skeleton, said = _skeleton(path, Numbers(index, decode, n_channels), told)
    if not index.n_keypoints:
        index = replace(index, n_keypoints=len(skeleton))
    shape, cells = (len(numbers), len(index.names)), (np.searchsorted(numbers, index.frame), index.camera)
    recorded, people = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64)
    recorded[cells], people[cells] = True, np.diff(index.ends)
    times = _times(index, numbers, recorded, told.rate_hz)
    held = Numbers(index, decode, n_channels)
    rows = {channel: NumberRows(held, channel) for channel in told.channels}
    return Detections(
        skeleton=skeleton,
        view_names=index.names,
        frame_numbers=numbers,
        time_s=times,
        offsets=np.concatenate([[0], np.cumsum(people)]),
        keypoints_px=rows[PIXELS],
        confidence=rows[CONFIDENCE],
        recorded=recorded,
        track_ids=index.tracks,
        depth=rows.get(DEPTH),
        sigma_px=rows.get(SIGMA),
        rate_hz=told.rate_hz or rate_of_frames(times),
        notes=(*told.notes, *said),
    )


def _times(index: Index, numbers: np.ndarray, recorded: np.ndarray, rate_hz: float | None) -> np.ndarray:
    """Shape (frame, view): the times of views that have some, else those of the rate."""
    times = np.where(recorded, frame_times(numbers, len(index.names), rate_hz), np.nan)
    timed = np.unique(index.camera[np.isfinite(index.time_s)])
    mine = np.isin(index.camera, timed)
    times[np.searchsorted(numbers, index.frame[mine]), index.camera[mine]] = index.time_s[mine]
    return times


def _skeleton(path: Path, numbers: Numbers, told: Told) -> tuple[Skeleton, tuple[str, ...]]:
    count, found, said = numbers.index.n_keypoints, told.skeleton, ()
    if found is None and count:
        some = numbers.rows(0, min(_JUDGED, int(numbers.index.ends[-1])))[..., list(PIXELS)]
        found, said = guess_skeleton(count, some, str(path))
    if found is None:
        raise FileError(f"{path}: nobody was detected in any view, so nothing tells the skeleton. Add --skeleton.")
    if count and count != len(found):
        raise FileError(
            f"{path} has {count} keypoints a person, skeleton {found.name} has {len(found)}. Choose another with "
            "--skeleton, or leave it out to have it told from the files."
        )
    return found, said
