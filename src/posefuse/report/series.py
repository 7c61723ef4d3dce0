"""Numbers over time: error, views used, bone lengths, and when points are measured, filled or missing."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus
from posefuse.model.tracks import TrackState
from posefuse.report.packing import encode_point_states
from posefuse.report.scene import measured_mask
from posefuse.skeleton.skeletons import Skeleton

MAX_INTERVALS = 600
"""Longer recordings are summarized in about this many time intervals."""
MAX_BONES = 40
MAX_GAPS = 25
_BLOCK_FRAMES = 4096
"""Approximate number of frames whose intervals are summarized at a time."""

MISSING, MEASURED, FILLED, ABSENT = 0, 1, 2, 3
"""States of a point in a frame."""


@dataclass(frozen=True)
class Gap:
    """An interval in which a keypoint was not measured although the person was present.

    Attributes:
        person: index of the person.
        keypoint: index of the keypoint.
        start: index of the first frame.
        stop: index of the frame after the last one.
        filled: number of frames of the gap that still have coordinates.
        status: point status of the first frame.
    """

    person: int
    keypoint: int
    start: int
    stop: int
    filled: int
    status: PointStatus


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """Numbers of every frame.

    Attributes:
        error_px: shape (frame, person): mean reprojection error of the points, NaN where there is none.
        n_views: shape (frame, person): mean number of views used by the points, NaN where there is no point.
        bones: pairs of keypoint names.
        bones_m: shape (frame, person, bone), float32: measured lengths, NaN where an end is missing.
        point_state: shape (frame, person, keypoint), int8: MISSING, MEASURED, FILLED or ABSENT.
        status: shape (frame, person, keypoint), int8.
    """

    error_px: np.ndarray
    n_views: np.ndarray
    bones: tuple[tuple[str, str], ...]
    bones_m: np.ndarray
    point_state: np.ndarray
    status: np.ndarray

    def interval_starts(self, max_intervals: int = MAX_INTERVALS) -> np.ndarray:
        """Return the first frame indices of at most ``max_intervals`` intervals of equal length."""
        n_frames = len(self.point_state)
        return np.arange(0, n_frames, max(1, -(-n_frames // max_intervals)))


def gather_series(parts: Iterable[Reconstruction], layer: LayerName, skeleton: Skeleton) -> TimeSeries:
    """Gather the numbers from consecutive ranges of frames."""
    bones = displayed_bones(skeleton)
    ends = np.array([[skeleton.index(a), skeleton.index(b)] for a, b in bones]).reshape(-1, 2).astype(int)
    ranges = [_gather_range(part, layer, ends) for part in parts]
    error, views, lengths, point_state, status = (np.concatenate(each) for each in zip(*ranges, strict=True))
    return TimeSeries(error, views, bones, lengths, point_state, status)


def displayed_bones(skeleton: Skeleton) -> tuple[tuple[str, str], ...]:
    """Return the edges of the body; the edges of hands and faces only if there are no others."""
    in_parts = {int(k) for part in skeleton.parts for k in part.keypoints}
    body = [
        edge
        for edge, ends in zip(skeleton.edges, skeleton.edge_indices, strict=True)
        if not in_parts & set(ends.tolist())
    ]
    return tuple(body or skeleton.edges)[:MAX_BONES]


def _gather_range(part: Reconstruction, layer: LayerName, ends: np.ndarray) -> tuple[np.ndarray, ...]:
    values: Layer = part.layers[layer]
    # Bones of a fitted model have constant lengths; only measured lengths reveal errors.
    points = np.asarray(part.layers["measured" if "measured" in part.layers else layer].points_m[:])
    point_state = encode_point_states(values, measured_mask(part, layer))
    if part.tracks is not None:
        point_state[np.asarray(part.tracks.state[:]) == TrackState.ABSENT] = ABSENT
    bones = np.linalg.norm(points[:, :, ends[:, 0]] - points[:, :, ends[:, 1]], axis=-1).astype(np.float32)
    return (
        _finite_mean(np.asarray(values.reprojection_error_px[:])),
        _finite_mean(np.where(values.has_point, values.n_views, np.nan)),
        bones,
        point_state,
        np.asarray(values.status[:]),
    )


def _finite_mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over the last axis without NaN."""
    finite = np.isfinite(values)
    count = finite.sum(axis=-1)
    return np.where(count > 0, np.where(finite, values, 0.0).sum(axis=-1) / np.maximum(count, 1), np.nan)


def blocks_of_intervals(starts: np.ndarray, n_frames: int) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield the frames of some intervals at a time, and where the intervals start in them, to limit the memory."""
    first = 0
    while first < len(starts):
        last = max(int(np.searchsorted(starts, starts[first] + _BLOCK_FRAMES)), first + 1)
        stop = int(starts[last]) if last < len(starts) else n_frames
        yield slice(int(starts[first]), stop), starts[first:last] - starts[first]
        first = last


def mean_per_interval(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the mean of each interval of frames, along axis 0, without NaN."""
    means = [np.empty((0, *values.shape[1:]))]
    for frames, begins in blocks_of_intervals(starts, len(values)):
        finite = np.isfinite(values[frames])
        total = np.add.reduceat(np.where(finite, values[frames], 0.0), begins, axis=0)
        count = np.add.reduceat(finite.astype(np.int64), begins, axis=0)
        means.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    return np.concatenate(means)


def majority_per_interval(point_state: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the most frequent state of each interval of frames, along axis 0; the worse one of a tie."""
    order = np.array([MISSING, FILLED, MEASURED, ABSENT])
    found = [np.empty((0, *point_state.shape[1:]), dtype=order.dtype)]
    for frames, begins in blocks_of_intervals(starts, len(point_state)):
        states = point_state[frames]
        counts = np.stack([np.add.reduceat((states == code).astype(np.int32), begins, axis=0) for code in order])
        found.append(order[counts.argmax(axis=0)])
    return np.concatenate(found)


def find_gaps(series: TimeSeries) -> list[Gap]:
    """Return the :data:`MAX_GAPS` longest intervals without a measurement, longest first."""
    found = [np.empty((4, 0), dtype=np.int64)]
    for p in range(series.point_state.shape[1]):
        state = series.point_state[:, p]
        unmeasured = np.pad((state == MISSING) | (state == FILLED), [(1, 1), (0, 0)])
        steps = np.diff(unmeasured.view(np.int8), axis=0).T
        # Sorted by keypoint and frame, the n-th start and the n-th end belong to the same gap.
        keypoint, start = np.nonzero(steps > 0)
        found.append(np.stack([np.full(len(start), p), keypoint, start, np.nonzero(steps < 0)[1]]))
    person, keypoint, start, stop = np.concatenate(found, axis=1)
    longest = np.lexsort((keypoint, person, start, start - stop))[:MAX_GAPS]
    return [
        Gap(
            int(person[i]), int(keypoint[i]), int(start[i]), int(stop[i]),
            int((series.point_state[start[i] : stop[i], person[i], keypoint[i]] == FILLED).sum()),
            PointStatus(int(series.status[start[i], person[i], keypoint[i]])),
        )
        for i in longest
    ]  # fmt: skip


def time_series_data(result: Reconstruction, series: TimeSeries) -> dict[str, Any]:
    """Return the series, averaged over time intervals, as JSON data of the report page."""
    starts = series.interval_starts()
    timed = bool(np.isfinite(result.time_s).all())
    times = result.time_s if timed else result.frame_numbers
    scale = 1000.0 if result.unit == "m" else 1.0
    lengths = mean_per_interval(scale * series.bones_m.astype(np.float64), starts)
    states = majority_per_interval(series.point_state, starts)
    return {
        "frameIndex": starts.tolist(),
        "time": np.asarray(times)[starts].round(3).tolist(),
        "unit": "s" if timed else "frame",
        "error": [_numbers(column, 2) for column in mean_per_interval(series.error_px, starts).T],
        "highestError": round(float(np.nanmax(series.error_px)), 1) if np.isfinite(series.error_px).any() else None,
        "views": [_numbers(column, 2) for column in mean_per_interval(series.n_views, starts).T],
        "bones": [f"{a} – {b}" for a, b in series.bones],
        "boneUnit": "mm" if result.unit == "m" else result.unit,
        "lengths": [[_numbers(lengths[:, p, b], 1) for b in range(len(series.bones))] for p in range(lengths.shape[1])],
        "states": [
            ["".join(map(str, states[:, p, k])) for k in range(states.shape[2])] for p in range(states.shape[1])
        ],
    }


def _numbers(values: Sequence[float] | np.ndarray, digits: int) -> list[float | None]:
    return [round(float(value), digits) if np.isfinite(value) else None for value in values]
