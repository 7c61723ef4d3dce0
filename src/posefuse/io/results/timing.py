"""Constant frame rate for motion capture formats."""

import numpy as np

from posefuse.errors import ResultError
from posefuse.io.results.format import ResultFacts
from posefuse.model.reconstruction import Reconstruction

_RATE_TOLERANCE = 0.02


def export_rate(result: Reconstruction | ResultFacts, form: str) -> float:
    """Return the frame rate of a result, for formats with a constant rate.

    Raises:
        ResultError: if the rate is unknown, or frames are not evenly spaced.
    """
    if result.rate_hz is not None:
        return result.rate_hz
    times = result.time_s[np.isfinite(result.time_s)]
    if len(times) < 2:
        raise ResultError(f"A {form} file needs a frame rate, and this recording has none. Reconstruct with `rate_hz`.")
    steps = np.diff(times)
    step = float(np.median(steps))
    if np.any(np.abs(steps - step) > _RATE_TOLERANCE * step):
        raise ResultError(
            f"A {form} file needs evenly spaced frames; these are {steps.min():.4f} to {steps.max():.4f} s apart."
        )
    return 1.0 / step


def regular_rows(result: Reconstruction | ResultFacts) -> tuple[np.ndarray, int]:
    """Return the row of each frame in a file without gaps, and the number of rows."""
    row_indices = result.frame_numbers - result.frame_numbers[0]
    return row_indices, int(row_indices[-1]) + 1
