"""Conversion of tidy tables, with one row per frame, person and keypoint, to arrays."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.columns import Columns, n_rows, number_column, word_column
from posefuse.io.results import tables
from posefuse.io.results.labels import SOURCES, STATUSES, codes_of
from posefuse.model.stored_points import StoredPoints

WORDS = ("person", "keypoint", "status", "source")
_UNITS = ("m", "px")
_COVARIANCES = ("xx", "xy", "xz", "yy", "yz", "zz")
NUMBERS = (
    *("frame", "time_s", "n_views", "reprojection_error_px"),
    *(f"{prefix}{axis}_{unit}" for unit in _UNITS for prefix in ("", "sd_") for axis in "xyz"),
    *(f"covariance_{entry}_{unit}2" for unit in _UNITS for entry in _COVARIANCES),
)
"""Columns of words and of numbers that are read."""


def unit_of(names: Sequence[str], path: Path) -> str:
    """Return the unit in the column names.

    Raises:
        FileError: if the columns are not those of a tidy table.
    """
    unit = next((unit for unit in _UNITS if f"x_{unit}" in names), "m")
    required = ("frame", "time_s", "person", "keypoint", *(f"{axis}_{unit}" for axis in "xyz"))
    missing = [name for name in required if name not in names]
    if missing:
        raise FileError(
            f"{path} is not a table of points: it lacks the columns {choices(missing)}; it has {choices(names)}."
        )
    return unit


def points_of(
    table: Columns,
    path: Path,
    people: Sequence[str] | None = None,
    keypoints: Sequence[str] | None = None,
    layer: str = "",
    rate_hz: float | None = None,
) -> StoredPoints:
    """Return the points of a tidy table, which must have all people and keypoints in every frame.

    Raises:
        FileError: if rows are missing or in another order.
    """
    unit = unit_of(list(table), path)
    rows, persons, names = n_rows(table), word_column(table, "person"), word_column(table, "keypoint")
    people = tables.in_order(persons) if people is None else tuple(people)
    keypoints = tables.in_order(names) if keypoints is None else tuple(keypoints)
    each = len(people) * len(keypoints)
    frames = rows // each if each else 0
    shape = frames, len(people), len(keypoints)
    numbers = tables.whole(number_column(table, "frame"), path, "frame numbers")
    complete = (
        rows == frames * each
        and np.array_equal(np.tile(np.repeat(np.array(people, dtype=object), len(keypoints)), frames), persons)
        and np.array_equal(np.tile(np.array(keypoints, dtype=object), frames * len(people)), names)
        and np.array_equal(np.repeat(numbers[::each] if each else numbers, each), numbers)
    )
    if not complete:
        raise FileError(
            f"{path}: expected {len(keypoints)} keypoints of each of {len(people)} people in every frame, in the same "
            f"order, but its {rows} rows differ from that. Is it truncated or sorted?"
        )

    def field(*columns: str) -> np.ndarray | None:
        if not set(columns) <= set(table):
            return None
        return np.stack([number_column(table, name) for name in columns], axis=-1).reshape(*shape, len(columns))

    def codes(name: str, labels: np.ndarray) -> np.ndarray | None:
        return codes_of(word_column(table, name), labels, path).reshape(shape) if name in table else None

    errors, used = field("reprojection_error_px"), field("n_views")
    times = number_column(table, "time_s")
    return StoredPoints(
        keypoints=tuple(keypoints),
        person_ids=tuple(people),
        frame_numbers=tables.increasing(numbers[::each] if each else numbers, path),
        time_s=times[::each] if each else times,
        points_m=field(*(f"{axis}_{unit}" for axis in "xyz")),  # type: ignore[arg-type]
        unit=unit,
        layer=layer,
        rate_hz=rate_hz,
        covariance_m2=field(*(f"covariance_{entry}_{unit}2" for entry in _COVARIANCES)),
        sd_m=field(*(f"sd_{axis}_{unit}" for axis in "xyz")),
        status=codes("status", STATUSES),
        source=codes("source", SOURCES),
        n_views=None if used is None else tables.counts(used[..., 0], path),
        reprojection_error_px=None if errors is None else errors[..., 0],
    )
