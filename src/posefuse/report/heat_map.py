"""Errors and shares of detections by keypoint and camera, with the worst frames of each combination."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.thinned_samples import Thinned
from posefuse.model.tracks import TrackState
from posefuse.report.packing import encode_view_states

N_WORST_FRAMES = 3
"""Number of frames linked from each cell."""
_N_INTERVALS = 60
"""The recording is divided into this many intervals, and each contributes at most one worst frame to a cell.

Otherwise, all links could lead to the same bad moment.
"""

MISSING, USED, REJECTED = 0, 1, 2


@dataclass(frozen=True, eq=False)
class WorstFrames:
    """The frames in which a quantity is worst, worst first; -1 where there are fewer such frames.

    Attributes:
        frame_index: shape (keypoint, view, rank), int64.
        person: shape (keypoint, view, rank), int64: index of the person.
        error_px: shape (keypoint, view, rank): reprojection error, NaN where unknown.
    """

    frame_index: np.ndarray
    person: np.ndarray
    error_px: np.ndarray


@dataclass(frozen=True, eq=False)
class HeatMap:
    """Statistics for each keypoint and camera over all people, without frames in which a person is absent.

    Attributes:
        error_px: shape (keypoint, view): median reprojection error of used detections, NaN where none was used.
        p90_px: shape (keypoint, view): 90th percentile of the same errors.
        shares: shape (keypoint, view, 3): shares of frames with detections that are missing, used, and rejected or not
            used; NaN where no person was present.
        worst: the worst frames by "error", "rejected" and "missing".
    """

    error_px: np.ndarray
    p90_px: np.ndarray
    shares: np.ndarray
    worst: dict[str, WorstFrames]


def gather_heat_map(parts: Iterable[Reconstruction], layer: LayerName, n_frames: int) -> HeatMap:
    """Gather the statistics from consecutive ranges of frames, ``n_frames`` in total.

    Counts and worst frames are exact. In a long recording, error percentiles come from every n-th frame.
    """
    sample, counts = Thinned(), None
    searches = {name: _WorstFrameSearch(n_frames) for name in ("error", "rejected", "missing")}
    for part in parts:
        errors, codes = _errors_and_codes(part, layer)
        used_px = np.where(codes == USED, errors, np.float32(np.nan))
        sample.add(used_px)
        part_counts = np.stack([(codes == code).sum(axis=(0, 1)) for code in (MISSING, USED, REJECTED)], axis=-1)
        counts = part_counts if counts is None else counts + part_counts
        searches["error"].add(used_px, errors)
        searches["rejected"].add(np.where(codes == REJECTED, np.nan_to_num(errors) + 1e-6, np.nan), errors)
        searches["missing"].add(np.where(codes == MISSING, 1.0, np.nan), errors)
    median, p90 = _percentiles(sample.values)
    assert counts is not None
    total = counts.sum(axis=-1, keepdims=True)
    return HeatMap(
        error_px=median,
        p90_px=p90,
        shares=np.where(total > 0, counts / np.maximum(total, 1), np.nan),
        worst={name: search.result() for name, search in searches.items()},
    )


def _errors_and_codes(part: Reconstruction, layer: LayerName) -> tuple[np.ndarray, np.ndarray]:
    """Return errors, float32, and codes, int8, of shape (frame, person, keypoint, view); -1 for absent people."""
    values = part.layers[layer]
    codes = encode_view_states(np.asarray(values.view_status[:]))
    if part.tracks is not None:
        codes[np.asarray(part.tracks.state[:]) == TrackState.ABSENT] = -1
    return np.asarray(values.view_error_px[:]).astype(np.float32), codes


def _percentiles(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the median and 90th percentile over frames and people for each keypoint and view."""
    shape = values.shape[2:]
    median, p90 = np.full(shape, np.nan), np.full(shape, np.nan)
    for cell in np.ndindex(shape):
        finite = values[:, :, *cell].ravel()
        finite = finite[np.isfinite(finite)]
        if len(finite):
            median[cell], p90[cell] = np.percentile(finite, (50, 90))
    return median, p90


class _WorstFrameSearch:
    """Find the frames with the highest scores in consecutive ranges of frames, at most one per interval.

    Args:
        n_frames: total number of frames.
    """

    def __init__(self, n_frames: int) -> None:
        starts = np.unique(np.linspace(0, n_frames, min(_N_INTERVALS, n_frames), endpoint=False).astype(int))
        self._intervals = list(pairwise([*starts.tolist(), n_frames]))
        self._best: list[np.ndarray] = []
        """For each interval: score, frame index, person and error, shape (4, keypoint, view)."""
        self._n_frames_added = 0

    def add(self, score: np.ndarray, errors: np.ndarray) -> None:
        """Add the next range of frames.

        Args:
            score: shape (frame, person, keypoint, view), NaN where a frame does not count.
            errors: reprojection errors of the same shape, in px.
        """
        frames, people, keypoints, views = score.shape
        if not self._best:
            self._best = [np.full((4, keypoints, views), -1.0) for _ in self._intervals]
        filled = np.where(np.isfinite(score), score, -1.0).reshape(-1, keypoints, views)
        offset = self._n_frames_added
        for interval, (start, stop) in enumerate(self._intervals):
            first, last = max(start - offset, 0), min(stop - offset, frames)
            if first >= last or not people:
                continue
            scores = filled[first * people : last * people]
            best = scores.argmax(axis=0)
            value = np.take_along_axis(scores, best[None], axis=0)[0]
            row = first * people + best
            k, v = np.indices((keypoints, views))
            error_px = errors.reshape(-1, keypoints, views)[row, k, v]
            candidate = np.stack([value, offset + row // people, row % people, error_px])
            previous = self._best[interval]
            self._best[interval] = np.where(value > previous[0], candidate, previous)
        self._n_frames_added += frames

    def result(self) -> WorstFrames:
        """Return the frames with the highest scores of all intervals."""
        value, frame_index, person, error_px = np.stack(self._best, axis=-1)
        order = np.argsort(-value, axis=-1, kind="stable")[..., :N_WORST_FRAMES]
        value, frame_index, person, error_px = (
            np.take_along_axis(each, order, axis=-1) for each in (value, frame_index, person, error_px)
        )
        exists = value >= 0
        return WorstFrames(
            np.where(exists, frame_index, -1).astype(np.int64),
            np.where(exists, person, -1).astype(np.int64),
            np.where(exists, error_px, np.nan),
        )


def heat_map_data(heat_map: HeatMap, frame_numbers: np.ndarray) -> dict[str, Any]:
    """Return the heat map as JSON data of the report page.

    Args:
        heat_map: the statistics.
        frame_numbers: shape (frame,).
    """
    return {
        "error": _rows(heat_map.error_px, 2),
        "used": _rows(heat_map.shares[..., USED], 4),
        "rejected": _rows(heat_map.shares[..., REJECTED], 4),
        "missing": _rows(heat_map.shares[..., MISSING], 4),
        "worst": {name: _links(worst, frame_numbers) for name, worst in heat_map.worst.items()},
    }


def _links(worst: WorstFrames, frame_numbers: np.ndarray) -> list[list[list[list[Any]]]]:
    """For each keypoint and view, return lists of frame index, frame number, person index and error in px."""
    return [
        [
            [
                [int(index), int(frame_numbers[index]), int(person), round(float(px), 1) if np.isfinite(px) else None]
                for index, person, px in zip(*cell, strict=True)
                if index >= 0
            ]
            for cell in zip(*row, strict=True)
        ]
        for row in zip(worst.frame_index, worst.person, worst.error_px, strict=True)
    ]


def _rows(values: np.ndarray, digits: int) -> list[list[float | None]]:
    return [[round(float(value), digits) if np.isfinite(value) else None for value in row] for row in values]
