"""Checks of the columns of tables."""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError

_MAX_EXACT = 2.0**53


def whole(values: np.ndarray, path: Path, what: str) -> np.ndarray:
    """Convert numbers to int64.

    Raises:
        FileError: if some are missing or not integers.
    """
    fits = np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < _MAX_EXACT)
    if not fits.all():
        raise FileError(f"{path}: {what} must be whole numbers, got {values[~fits][0]:g}.")
    return values.astype(np.int64)


def counts(values: np.ndarray, path: Path) -> np.ndarray:
    """Return numbers of views, int64; 0 for missing ones.

    Raises:
        FileError: if some are not integers.
    """
    return whole(np.nan_to_num(values, nan=0.0), path, "numbers of views")


def increasing(frame_numbers: np.ndarray, path: Path) -> np.ndarray:
    """Return the frame numbers after checking that they increase.

    Raises:
        FileError: if they do not increase.
    """
    steps = np.diff(frame_numbers)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0))
        raise FileError(
            f"{path}: frame {frame_numbers[at]} comes before {frame_numbers[at + 1]}; frames must increase."
        )
    return frame_numbers


def in_order(names: np.ndarray) -> tuple[str, ...]:
    """Return the distinct names in order of first occurrence."""
    return tuple(dict.fromkeys(names.tolist()))
