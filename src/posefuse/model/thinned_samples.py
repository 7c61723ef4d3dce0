"""Per-frame values of recordings of any length, thinned evenly to bounded memory."""

import numpy as np

HELD_BYTES = 64_000_000
"""Default limit of one table; beyond it every other frame is dropped, repeatedly."""


class Thinned:
    """Collect values of consecutive ranges of frames and keep those of every n-th frame.

    The kept frames do not depend on the ranges. Short recordings are kept completely.

    Args:
        held_bytes: limit in bytes.
    """

    def __init__(self, held_bytes: int = HELD_BYTES) -> None:
        self._held_bytes = held_bytes
        self._stride = 1
        self._seen = 0
        self._kept: list[np.ndarray] = []

    def add(self, values: np.ndarray) -> None:
        """Add the values of the next frames, shape (frame, ...)."""
        # A copy: a view would keep the whole array in memory.
        self._kept.append(values[(-self._seen) % self._stride :: self._stride].copy())
        self._seen += len(values)
        while sum(each.nbytes for each in self._kept) > self._held_bytes and self._stride < self._seen:
            self._kept = [np.concatenate(self._kept)[::2].copy()]
            self._stride *= 2

    @property
    def values(self) -> np.ndarray:
        """Kept values, shape (frame, ...).

        Raises:
            ValueError: if nothing was added.
        """
        if len(self._kept) != 1:
            self._kept = [np.concatenate(self._kept)]
        return self._kept[0]
