"""Each camera's part in each keypoint: its errors, what was used of it, rejected and missing, and its worst frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.thinned_samples import Thinned
from posefuse.model.tracks import TrackState
from posefuse.report.packing import view_codes

WORST = 3
"""So many frames of a cell are linked."""
_SPELLS = 60
"""They are of different sixtieths of the recording: the same bad moment thrice would say little."""

MISSING, USED, REJECTED = 0, 1, 2
QUANTITIES = ("error", "used", "rejected", "missing")


@dataclass(frozen=True, eq=False)
class Worst:
    """Where a quantity is worst, the worst first; -1 where there are not as many such frames.

    Attributes:
        place: shape (keypoint, view, rank), int64: of the frame.
        person: shape (keypoint, view, rank), int64.
        error_px: shape (keypoint, view, rank), NaN where unknown.
    """

    place: np.ndarray
    person: np.ndarray
    error_px: np.ndarray


@dataclass(frozen=True, eq=False)
class Cells:
    """A number for each keypoint and camera, over all people while they are not absent.

    Attributes:
        error_px: shape (keypoint, view): median reprojection error of what was used, NaN where nothing was.
        p90_px: shape (keypoint, view): nine in ten lie below.
        shares: shape (keypoint, view, 3): missing, used, rejected or not used; NaN where nobody was there.
        worst: quantity to its worst frames; ``used`` has none of its own.
    """

    error_px: np.ndarray
    p90_px: np.ndarray
    shares: np.ndarray
    worst: dict[str, Worst]


def cells_of(parts: Iterable[Reconstruction], layer: LayerName, n_frames: int) -> Cells:
    """Gather the numbers from consecutive ranges of frames, ``n_frames`` in all.

    Everything is counted and looked at; what a long recording's errors are like is told from every n-th frame.
    """
    kept, counts = Thinned(), None
    worst = {name: _Worst(n_frames) for name in ("error", "rejected", "missing")}
    for part in parts:
        errors, codes = _part_of(part, layer)
        used_px = np.where(codes == USED, errors, np.float32(np.nan))
        kept.add(used_px)
        own = np.stack([(codes == code).sum(axis=(0, 1)) for code in (MISSING, USED, REJECTED)], axis=-1)
        counts = own if counts is None else counts + own
        worst["error"].add(used_px, errors)
        worst["rejected"].add(np.where(codes == REJECTED, np.nan_to_num(errors) + 1e-6, np.nan), errors)
        worst["missing"].add(np.where(codes == MISSING, 1.0, np.nan), errors)
    median, p90 = _percentiles(kept.values)
    assert counts is not None
    there = counts.sum(axis=-1, keepdims=True)
    return Cells(
        error_px=median,
        p90_px=p90,
        shares=np.where(there > 0, counts / np.maximum(there, 1), np.nan),
        worst={name: each.found() for name, each in worst.items()},
    )


def _part_of(part: Reconstruction, layer: LayerName) -> tuple[np.ndarray, np.ndarray]:
    """Errors, float32, and codes, int8, shape (frame, person, keypoint, view); -1 where a person is absent."""
    values = part.layers[layer]
    codes = view_codes(np.asarray(values.view_status[:]))
    if part.tracks is not None:
        codes[np.asarray(part.tracks.state[:]) == TrackState.ABSENT] = -1
    return np.asarray(values.view_error_px[:]).astype(np.float32), codes


def _percentiles(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Median and 90 % percentile over frames and people of each keypoint and view."""
    shape = values.shape[2:]
    median, p90 = np.full(shape, np.nan), np.full(shape, np.nan)
    for cell in np.ndindex(shape):
        known = values[:, :, *cell].ravel()
        known = known[np.isfinite(known)]
        if len(known):
            median[cell], p90[cell] = np.percentile(known, (50, 90))
    return median, p90


class _Worst:
    """Gathers the greatest scores of consecutive ranges of frames, at most one of a spell.

    Args:
        n_frames: of all ranges.
    """

    def __init__(self, n_frames: int) -> None:
        starts = np.unique(np.linspace(0, n_frames, min(_SPELLS, n_frames), endpoint=False).astype(int))
        self._spells = list(pairwise([*starts.tolist(), n_frames]))
        self._best: list[np.ndarray] = []
        """Of each spell score, place, person and error, shape (4, keypoint, view)."""
        self._at = 0

    def add(self, score: np.ndarray, errors: np.ndarray) -> None:
        """More frames.

        Args:
            score: shape (frame, person, keypoint, view), NaN where a frame does not count.
            errors: of the same shape, in px.
        """
        frames, people, keypoints, views = score.shape
        if not self._best:
            self._best = [np.full((4, keypoints, views), -1.0) for _ in self._spells]
        filled = np.where(np.isfinite(score), score, -1.0).reshape(-1, keypoints, views)
        for spell, (start, stop) in enumerate(self._spells):
            first, last = max(start - self._at, 0), min(stop - self._at, frames)
            if first >= last or not people:
                continue
            some = filled[first * people : last * people]
            best = some.argmax(axis=0)
            value = np.take_along_axis(some, best[None], axis=0)[0]
            row = first * people + best
            k, v = np.indices((keypoints, views))
            error_px = errors.reshape(-1, keypoints, views)[row, k, v]
            found = np.stack([value, self._at + row // people, row % people, error_px])
            before = self._best[spell]
            self._best[spell] = np.where(value > before[0], found, before)
        self._at += frames

    def found(self) -> Worst:
        """The greatest of all."""
        value, place, person, error_px = np.stack(self._best, axis=-1)
        order = np.argsort(-value, axis=-1, kind="stable")[..., :WORST]
        value, place, person, error_px = (
            np.take_along_axis(each, order, axis=-1) for each in (value, place, person, error_px)
        )
        there = value >= 0
        return Worst(
            np.where(there, place, -1).astype(np.int64),
            np.where(there, person, -1).astype(np.int64),
            np.where(there, error_px, np.nan),
        )


def cell_data(cells: Cells, numbers: np.ndarray) -> dict[str, Any]:
    """The cells as the page carries them.

    Args:
        cells: the numbers.
        numbers: shape (frame,): of the frames.
    """
    return {
        "error": _rows(cells.error_px, 2),
        "used": _rows(cells.shares[..., USED], 4),
        "rejected": _rows(cells.shares[..., REJECTED], 4),
        "missing": _rows(cells.shares[..., MISSING], 4),
        "worst": {name: _links(worst, numbers) for name, worst in cells.worst.items()},
    }


def _links(worst: Worst, numbers: np.ndarray) -> list[list[list[list[Any]]]]:
    """For each keypoint and view: place and number of a frame, place of a person, px."""
    return [
        [
            [
                [int(place), int(numbers[place]), int(who), round(float(px), 1) if np.isfinite(px) else None]
                for place, who, px in zip(*cell, strict=True)
                if place >= 0
            ]
            for cell in zip(*row, strict=True)
        ]
        for row in zip(worst.place, worst.person, worst.error_px, strict=True)
    ]


def _rows(values: np.ndarray, digits: int) -> list[list[float | None]]:
    return [[round(float(value), digits) if np.isfinite(value) else None for value in row] for row in values]
