"""Each camera's part in each keypoint: its errors, what was used of it, rejected and missing, and its worst frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.model.options import LayerName
from posefuse.model.reconstruction import Reconstruction
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


def cells_of(parts: Iterable[Reconstruction], layer: LayerName) -> Cells:
    """Gather the numbers from consecutive ranges of frames."""
    gathered = [_part_of(part, layer) for part in parts]
    errors, codes = (np.concatenate(each) for each in zip(*gathered, strict=True))
    used = codes == USED
    used_px = np.where(used, errors, np.nan)
    there = (codes >= 0).sum(axis=(0, 1))
    counts = np.stack([(codes == code).sum(axis=(0, 1)) for code in (MISSING, USED, REJECTED)], axis=-1)
    median, p90 = _percentiles(used_px)
    return Cells(
        error_px=median,
        p90_px=p90,
        shares=np.where(there[..., None] > 0, counts / np.maximum(there, 1)[..., None], np.nan),
        worst={
            "error": _worst(used_px, errors),
            "rejected": _worst(np.where(codes == REJECTED, np.nan_to_num(errors) + 1e-6, np.nan), errors),
            "missing": _worst(np.where(codes == MISSING, 1.0, np.nan), errors),
        },
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


def _worst(score: np.ndarray, errors: np.ndarray) -> Worst:
    """The greatest scores, at most one of a spell.

    Args:
        score: shape (frame, person, keypoint, view), NaN where a frame does not count.
        errors: of the same shape, in px.
    """
    frames, people, keypoints, views = score.shape
    if not people or not frames:
        nothing = np.full((keypoints, views, 0), -1)
        return Worst(nothing, nothing, nothing.astype(float))
    filled = np.where(np.isfinite(score), score, -1.0)
    starts = np.unique(np.linspace(0, frames, min(_SPELLS, frames), endpoint=False).astype(int))
    found = []
    for start, stop in zip(starts, [*starts[1:], frames], strict=True):
        spell = filled[start:stop].reshape(-1, keypoints, views)
        best = spell.argmax(axis=0)
        found.append((np.take_along_axis(spell, best[None], axis=0)[0], start + best // people, best % people))
    value, place, person = (np.stack(each, axis=-1) for each in zip(*found, strict=True))
    order = np.argsort(-value, axis=-1, kind="stable")[..., :WORST]
    value, place, person = (np.take_along_axis(each, order, axis=-1) for each in (value, place, person))
    k, v = np.indices((keypoints, views))
    error_px = errors[place, person, k[..., None], v[..., None]]
    there = value >= 0
    return Worst(np.where(there, place, -1), np.where(there, person, -1), np.where(there, error_px, np.nan))


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
