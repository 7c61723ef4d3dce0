"""Exact percentile of numbers that do not fit in memory, by counting their bit patterns in two passes.

The bit patterns of nonnegative floats of single precision have the order of the floats. The first pass counts their
upper halves, which tells in which bins the sought order statistics lie; the second counts the lower halves in these
bins. This is a radix selection: the result is exact, and does not depend on how the numbers are divided into parts.
"""

from collections.abc import Callable, Iterable

import numpy as np

_LOW_BITS = 16
_N_BINS = 1 << _LOW_BITS

Parts = Callable[[], Iterable[np.ndarray]]
"""Returns the numbers in parts, the same ones at each call: arrays of nonnegative floats of single precision."""


def exact_percentile(parts: Parts, percent: float, *, weibull: bool = False) -> float | None:
    """Return a percentile of numbers, interpolated linearly between the two closest ranks, as NumPy does.

    Args:
        parts: called twice if there are numbers; numbers that are not finite do not count.
        percent: from 0 to 100.
        weibull: whether ranks are those of NumPy's method ``weibull``, instead of its default.

    Returns:
        The percentile, or None without numbers.
    """
    upper = np.zeros(_N_BINS, dtype=np.int64)
    for part in parts():
        upper += np.bincount(_bits(part) >> _LOW_BITS, minlength=_N_BINS)
    count = int(upper.sum())
    if not count:
        return None
    rank = 0.01 * percent * (count - 1)
    if weibull:
        rank = min(max(0.01 * percent * (count + 1) - 1.0, 0.0), count - 1.0)
    ranks = [int(rank), min(int(rank) + 1, count - 1)]
    bins = np.searchsorted(np.cumsum(upper), ranks, side="right")
    lower = np.zeros((2, _N_BINS), dtype=np.int64)
    for part in parts():
        bits = _bits(part)
        for counts, chosen in zip(lower, bins, strict=True):
            counts += np.bincount(bits[bits >> _LOW_BITS == chosen] & (_N_BINS - 1), minlength=_N_BINS)
    below = np.cumsum(upper)[bins] - upper[bins]
    last = [
        np.searchsorted(np.cumsum(each), r - n, side="right") for each, r, n in zip(lower, ranks, below, strict=True)
    ]
    first, second = ((bins << _LOW_BITS) + last).astype(np.uint32).view(np.float32).tolist()
    return first + (second - first) * (rank - ranks[0])


def _bits(values: np.ndarray) -> np.ndarray:
    """Return the bit patterns of the finite numbers."""
    chosen = np.asarray(values, dtype=np.float32)
    return np.ascontiguousarray(chosen[np.isfinite(chosen)]).view(np.uint32)
