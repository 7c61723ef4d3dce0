"""JSON records, usually lines, read by ranges of people: they are indexed once, and numbers are read on demand.

Memory holds about 40 bytes per frame and view, 8 bytes per person, and the numbers of the last requested range.
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
from posefuse.io.keypoints.columns import common_frames, rate_of_frames
from posefuse.io.keypoints.infer_skeleton import infer_skeleton, no_skeleton, wrong_skeleton
from posefuse.lazy_array import LazyArray, as_array
from posefuse.model.detections import Detections, frame_times
from posefuse.skeleton.skeletons import Skeleton

Decode = Callable[[bytes, Path, str], dict[str, np.ndarray]]
"""Function of a record, its file, and its description for messages that returns the people of each camera.

People have shape (person, keypoint, channel).
"""

PIXELS, CONFIDENCE, SIGMA, DEPTH = (0, 1), (2,), (3,), (4,)
"""Channels of the numbers of a keypoint. Not all formats have the last two."""
_INFERENCE_PEOPLE = 500


@dataclass(frozen=True)
class Record:
    """Position of a record.

    Attributes:
        file: Index of the file.
        start: Offset of its first byte.
        size: Number of bytes.
    """

    file: int
    start: int
    size: int


@dataclass(frozen=True)
class CellColumns:
    """Cells in file order, collected while files are indexed. A cell is a recorded frame of a camera.

    Attributes:
        record: For each cell, file, start and size of its :class:`Record`.
        frame: For each cell, the frame number.
        camera: For each cell, the index of the camera.
        people: For each cell, the number of people.
        time_s: For each cell, the time, NaN if unknown.
        tracks: For each person, the track id.
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
        """Add a cell with one track id per person."""
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
        files: Files with the records.
        names: Names of the cameras.
        record: Shape (cell, 3), int64: file, start and size of each cell's record.
        frame: Shape (cell,): number of the frame.
        camera: Shape (cell,): index of the camera.
        ends: Shape (cell + 1,): number of people before each cell.
        time_s: Shape (cell,): times, NaN if unknown.
        tracks: Shape (person,): track ids.
        n_keypoints: Number of keypoints per person, 0 without people.
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


def index_of(path: Path, files: Sequence[Path], names: Sequence[str], cells: CellColumns, n_keypoints: int) -> Index:
    """Sort cells by frame and camera.

    Args:
        path: The recording, for messages.
        files: Files with the records.
        names: Names of the cameras.
        cells: Cells in any order.
        n_keypoints: Number of keypoints per person.

    Raises:
        FileError: If there are no cells, or a camera has a frame twice.
    """
    frame, camera, people = (np.array(column, dtype=np.int64) for column in (cells.frame, cells.camera, cells.people))
    if not len(frame):
        raise FileError(f"{path} is an empty recording: it has no frames.")
    order = np.lexsort((camera, frame))
    frame, camera = frame[order], camera[order]
    repeated = (np.diff(frame) == 0) & (np.diff(camera) == 0)
    if repeated.any():
        at = int(np.argmax(repeated))
        raise FileError(f"{path}: camera {names[camera[at]]!r} has two records for frame {frame[at]}.")
    first = (np.cumsum(people) - people)[order]
    people = people[order]
    ends = np.concatenate([[0], np.cumsum(people)])
    rows = np.repeat(first - ends[:-1], people) + np.arange(int(ends[-1]))
    record = np.array([np.array(column, dtype=np.int64)[order] for column in cells.record]).T
    return Index(
        tuple(files), tuple(names), record, frame, camera, ends, np.array(cells.time_s)[order],
        np.array(cells.tracks, dtype=np.int64)[rows], n_keypoints,
    )  # fmt: skip


class RecordReader:
    """Reader of the numbers of people from their records.

    The last range is cached, because positions and confidences of a range are requested one after the other.

    Args:
        index: Index of the records.
        decode: Function that decodes a record.
        n_channels: Number of channels per keypoint.
    """

    def __init__(self, index: Index, decode: Decode, n_channels: int) -> None:
        self.index, self.n_channels = index, n_channels
        self._decode = decode
        self._last = 0, np.empty((0, index.n_keypoints, n_channels))

    def rows(self, start: int, stop: int) -> np.ndarray:
        """Return people ``start`` up to but excluding ``stop``, shape (row, keypoint, channel)."""
        first, cached = self._last
        if not first <= start <= stop <= first + len(cached):
            first, cached = start, self._read(start, stop)
            self._last = first, cached
        return cached[start - first : stop - first]

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
        """Yield the people of cells. A record with several consecutive cells is read once."""
        index, last, by_camera = self.index, (-1, -1), dict[str, np.ndarray]()
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
                        by_camera = self._decode(handles[file].read(size), path, f"{path}, at byte {at}")
                        last = file, at
                shape = int(index.ends[cell + 1] - index.ends[cell]), index.n_keypoints, self.n_channels
                if name not in by_camera or by_camera[name].shape != shape:
                    raise FileError(f"{path} changed while it was read: the record at byte {at} is different.")
                yield cell, by_camera[name]


class NumberRows(LazyArray):
    """Selected channels of the numbers of people."""

    def __init__(self, numbers: RecordReader, channels: Sequence[int]) -> None:
        index = numbers.index
        depth = (len(channels),) if len(channels) > 1 else ()
        super().__init__((int(index.ends[-1]), index.n_keypoints, *depth), np.float64)
        self._numbers, self._channels = numbers, list(channels)

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Return a copy of the rows, because the cache is shared between columns."""
        values = self._numbers.rows(start, stop)[..., self._channels]
        return values.reshape(stop - start, *self.shape[1:])


def check_numbers(values: np.ndarray, where: str) -> None:
    """Refuse impossible numbers while a file is indexed.

    Args:
        values: Shape (person, keypoint, channel).
        where: Description of the record, for messages.

    Raises:
        DetectionsError: On infinite numbers, and on standard deviations that are not positive.
    """
    if np.isinf(values).any():
        raise DetectionsError(f"{where} contains an infinite number. Write missing numbers as null.")
    if values.shape[-1] > SIGMA[0] and (values[..., SIGMA[0]] <= 0.0).any():
        raise DetectionsError(f"{where}: sigma_px must be positive. Write unknown values as null.")


@dataclass(frozen=True)
class RecordingInfo:
    """Properties of a recording besides its cells.

    Attributes:
        skeleton: Skeleton of the keypoints, or None to infer it from their number.
        rate_hz: Frame rate, or None.
        notes: Notes for the user.
        channels: Available channels: :data:`PIXELS`, :data:`CONFIDENCE`, and optionally :data:`SIGMA`, :data:`DEPTH`.
        own: Whether posefuse wrote the files. Then frame numbers may have large gaps.
    """

    skeleton: Skeleton | None
    rate_hz: float | None
    notes: tuple[str, ...] = ()
    channels: tuple[tuple[int, ...], ...] = (PIXELS, CONFIDENCE)
    own: bool = False


def detections_of_records(path: Path, index: Index, decode: Decode, n_channels: int, info: RecordingInfo) -> Detections:
    """Return the detections of indexed records. Their numbers stay in the files and are read on demand.

    Args:
        path: The recording, for messages.
        index: Index of the records.
        decode: Function that decodes a record.
        n_channels: Number of channels that it returns.
        info: Other properties of the recording.

    Raises:
        FileError: If the frame numbers are not plausible, or no person was detected and no skeleton is given.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    numbers = common_frames(path, index.frame, own=info.own)
    skeleton, notes = _skeleton(path, RecordReader(index, decode, n_channels), info)
    if not index.n_keypoints:
        index = replace(index, n_keypoints=len(skeleton))
    shape, cells = (len(numbers), len(index.names)), (np.searchsorted(numbers, index.frame), index.camera)
    recorded, people = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64)
    recorded[cells], people[cells] = True, np.diff(index.ends)
    times = _times(index, numbers, recorded, info.rate_hz)
    reader = RecordReader(index, decode, n_channels)
    rows = {channel: as_array(NumberRows(reader, channel)) for channel in info.channels}
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
        rate_hz=info.rate_hz or rate_of_frames(times),
        notes=(*info.notes, *notes),
    )


def _times(index: Index, numbers: np.ndarray, recorded: np.ndarray, rate_hz: float | None) -> np.ndarray:
    """Return times of shape (frame, view): those of the records for views that have any, otherwise from the rate."""
    times = np.where(recorded, frame_times(numbers, len(index.names), rate_hz), np.nan)
    with_times = np.unique(index.camera[np.isfinite(index.time_s)])
    cells = np.isin(index.camera, with_times)
    times[np.searchsorted(numbers, index.frame[cells]), index.camera[cells]] = index.time_s[cells]
    return times


def _skeleton(path: Path, numbers: RecordReader, info: RecordingInfo) -> tuple[Skeleton, tuple[str, ...]]:
    count, skeleton, notes = numbers.index.n_keypoints, info.skeleton, ()
    if skeleton is None and count:
        sample = numbers.rows(0, min(_INFERENCE_PEOPLE, int(numbers.index.ends[-1])))[..., list(PIXELS)]
        skeleton, notes = infer_skeleton(count, sample, str(path))
    if skeleton is None:
        raise no_skeleton(path)
    if count and count != len(skeleton):
        raise wrong_skeleton(path, count, skeleton)
    return skeleton, notes
