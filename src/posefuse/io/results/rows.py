"""Rows of files with one row per frame number, without gaps, starting with the first frame."""

from collections.abc import Iterator

import numpy as np

from posefuse.arrays import ArraySource, ranges
from posefuse.errors import ResultError
from posefuse.io.results.format import ResultFacts
from posefuse.io.results.timing import regular_rows
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.reconstruction import Reconstruction

_MAX_EMPTY_ROWS = 1000
_MAX_ROWS_PER_FRAME = 4


def rows_of(result: Reconstruction | ResultFacts, form: str) -> tuple[np.ndarray, int]:
    """Return the row of each frame, and the number of rows.

    Raises:
        ResultError: if there are no frames, or nearly all rows would be empty.
    """
    if not result.n_frames:
        raise ResultError(f"This result has no frames: there is nothing to write as {form}.")
    row_indices, n_rows = regular_rows(result)
    if n_rows > _MAX_ROWS_PER_FRAME * result.n_frames + _MAX_EMPTY_ROWS:
        raise ResultError(
            f"The format {form} has a row for every frame number and would need {n_rows} rows for {result.n_frames} "
            f"frames, numbered {result.frame_numbers[0]} to {result.frame_numbers[-1]}. Write netcdf, csv or parquet "
            "instead."
        )
    return row_indices, n_rows


def blocks(source: ArraySource, row_indices: np.ndarray, missing: float = np.nan) -> Iterator[np.ndarray]:
    """Yield all rows of an array by ranges, shape (row, ...); ``missing`` in rows without a frame.

    Args:
        source: shape (frame, ...); read by ranges of frames.
        row_indices: shape (frame,): the row of each frame, increasing from 0.
        missing: value of rows without a frame.
    """
    done = 0
    for start, stop in ranges(len(row_indices), CHUNK_FRAMES):
        values = np.asarray(source[start:stop])
        block = np.full((int(row_indices[stop - 1]) + 1 - done, *values.shape[1:]), missing, dtype=values.dtype)
        block[row_indices[start:stop] - done] = values
        done = int(row_indices[stop - 1]) + 1
        yield block
