"""What changes over time: error, views used, bones, and where points are measured, filled or missing."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus
from posefuse.model.tracks import TrackState
from posefuse.report.packing import point_codes
from posefuse.report.scene import measured_in
from posefuse.skeleton.skeletons import Skeleton

COLUMNS = 600
"""A longer recording is shown in about this many stretches of time."""
MOST_BONES = 40
MOST_GAPS = 25

MISSING, MEASURED, FILLED, ABSENT = 0, 1, 2, 3
HOW = ("missing", "measured", "filled", "absent")


@dataclass(frozen=True)
class Gap:
    """A stretch in which a point was not measured, though its person was there.

    Attributes:
        person: place of the person.
        keypoint: place of the keypoint.
        start: place of its first frame.
        stop: place after its last.
        filled: frames of it that have coordinates all the same.
        status: why the first frame of it has none, or how it came to have some.
    """

    person: int
    keypoint: int
    start: int
    stop: int
    filled: int
    status: PointStatus


@dataclass(frozen=True, eq=False)
class Series:
    """Numbers of every frame.

    Attributes:
        error_px: shape (frame, person): mean of the points' reprojection errors, NaN where there is none.
        n_views: shape (frame, person): mean number of views that points rest on, NaN where there is no point.
        bones: pairs of keypoint names.
        bones_m: shape (frame, person, bone), float32, as measured; NaN where an end is missing.
        how: shape (frame, person, keypoint), int8: a place in :data:`HOW`.
        status: shape (frame, person, keypoint), int8.
    """

    error_px: np.ndarray
    n_views: np.ndarray
    bones: tuple[tuple[str, str], ...]
    bones_m: np.ndarray
    how: np.ndarray
    status: np.ndarray

    def starts(self, columns: int = COLUMNS) -> np.ndarray:
        """Places of the first frames of equal stretches of time, at most ``columns``."""
        n_frames = len(self.how)
        return np.arange(0, n_frames, max(1, -(-n_frames // columns)))


def series_of(parts: Iterable[Reconstruction], layer: LayerName, skeleton: Skeleton) -> Series:
    """Gather them from consecutive ranges of frames."""
    bones = shown_bones(skeleton)
    ends = np.array([[skeleton.index(a), skeleton.index(b)] for a, b in bones]).reshape(-1, 2).astype(int)
    gathered = [_part_of(part, layer, ends) for part in parts]
    error, views, lengths, how, status = (np.concatenate(each) for each in zip(*gathered, strict=True))
    return Series(error, views, bones, lengths, how, status)


def shown_bones(skeleton: Skeleton) -> tuple[tuple[str, str], ...]:
    """The edges of the body; those of hands and faces only where there is nothing else."""
    of_parts = {int(k) for part in skeleton.parts for k in part.keypoints}
    body = [
        edge
        for edge, ends in zip(skeleton.edges, skeleton.edge_indices, strict=True)
        if not of_parts & set(ends.tolist())
    ]
    return tuple(body or skeleton.edges)[:MOST_BONES]


def _part_of(part: Reconstruction, layer: LayerName, ends: np.ndarray) -> tuple[np.ndarray, ...]:
    values: Layer = part.layers[layer]
    there = values.has_point
    # A fitted body's bones keep their lengths: those of what was measured tell what is wrong.
    points = np.asarray(part.layers["measured" if "measured" in part.layers else layer].points_m[:])
    how = point_codes(values, measured_in(part, layer))
    if part.tracks is not None:
        how[np.asarray(part.tracks.state[:]) == TrackState.ABSENT] = ABSENT
    bones = np.linalg.norm(points[:, :, ends[:, 0]] - points[:, :, ends[:, 1]], axis=-1).astype(np.float32)
    return (
        _mean(np.asarray(values.reprojection_error_px[:])),
        _mean(np.where(there, values.n_views, np.nan)),
        bones,
        how,
        np.asarray(values.status[:]),
    )


def _mean(values: np.ndarray) -> np.ndarray:
    """Over the last axis, of what is not NaN."""
    known = np.isfinite(values)
    count = known.sum(axis=-1)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=-1) / np.maximum(count, 1), np.nan)


def stretched(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """The mean of each stretch of frames, axis 0, of what is not NaN."""
    known = np.isfinite(values)
    total = np.add.reduceat(np.where(known, values, 0.0), starts, axis=0)
    count = np.add.reduceat(known.astype(np.int64), starts, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def mostly(how: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """What most frames of each stretch are, axis 0; of equals what is worse."""
    order = (MISSING, FILLED, MEASURED, ABSENT)
    counts = np.stack([np.add.reduceat((how == code).astype(np.int32), starts, axis=0) for code in order])
    return np.array(order)[counts.argmax(axis=0)]


def gaps_of(series: Series) -> list[Gap]:
    """The longest stretches without a measurement, the longest first."""
    unmeasured = np.isin(series.how, (MISSING, FILLED))
    closed = np.pad(unmeasured, [(1, 1), (0, 0), (0, 0)])
    steps = np.diff(closed.astype(np.int8), axis=0)
    # By person, keypoint, frame: the n-th beginning and the n-th end are of one gap.
    person, keypoint, start = np.nonzero(np.moveaxis(steps, 0, -1) > 0)
    stop = np.nonzero(np.moveaxis(steps, 0, -1) < 0)[2]
    longest = np.lexsort((keypoint, person, start, start - stop))[:MOST_GAPS]
    return [
        Gap(
            int(person[i]), int(keypoint[i]), int(start[i]), int(stop[i]),
            int((series.how[start[i] : stop[i], person[i], keypoint[i]] == FILLED).sum()),
            PointStatus(int(series.status[start[i], person[i], keypoint[i]])),
        )
        for i in longest
    ]  # fmt: skip


def series_data(result: Reconstruction, series: Series) -> dict[str, Any]:
    """The series as the page carries them, stretch by stretch."""
    starts = series.starts()
    timed = bool(np.isfinite(result.time_s).all())
    when = result.time_s if timed else result.frame_numbers
    scale = 1000.0 if result.unit == "m" else 1.0
    lengths = stretched(scale * series.bones_m.astype(np.float64), starts)
    how = mostly(series.how, starts)
    return {
        "place": starts.tolist(),
        "time": np.asarray(when)[starts].round(3).tolist(),
        "unit": "s" if timed else "frame",
        "error": [_numbers(column, 2) for column in stretched(series.error_px, starts).T],
        "views": [_numbers(column, 2) for column in stretched(series.n_views, starts).T],
        "bones": [f"{a} – {b}" for a, b in series.bones],
        "boneUnit": "mm" if result.unit == "m" else result.unit,
        "lengths": [[_numbers(lengths[:, p, b], 1) for b in range(len(series.bones))] for p in range(lengths.shape[1])],
        "how": [["".join(map(str, how[:, p, k])) for k in range(how.shape[2])] for p in range(how.shape[1])],
    }


def _numbers(values: Sequence[float] | np.ndarray, digits: int) -> list[float | None]:
    return [round(float(value), digits) if np.isfinite(value) else None for value in values]
