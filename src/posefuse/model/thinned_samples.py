"""Numbers of every frame, of a recording of any length: a distribution is told as well by every other frame."""

import numpy as np

HELD_BYTES = 64_000_000
"""Of one table; of what is more, every other frame is left out, again and again."""


class Thinned:
    """Takes numbers of consecutive ranges of frames, and keeps those of every n-th frame: of a short recording all.

    What is kept depends on the frames alone, not on the ranges in which they come.

    Args:
        held_bytes: to be kept at most.
    """

    def __init__(self, held_bytes: int = HELD_BYTES) -> None:
        self._held_bytes = held_bytes
        self._stride = 1
        self._seen = 0
        self._kept: list[np.ndarray] = []

    def add(self, values: np.ndarray) -> None:
        """The numbers of more frames, shape (frame, ...)."""
        # A copy: a view would hold all of what it is of.
        self._kept.append(values[(-self._seen) % self._stride :: self._stride].copy())
        self._seen += len(values)
        while sum(each.nbytes for each in self._kept) > self._held_bytes and self._stride < self._seen:
            self._kept = [np.concatenate(self._kept)[::2].copy()]
            self._stride *= 2

    @property
    def values(self) -> np.ndarray:
        """Shape (frame kept, ...).

        Raises:
            ValueError: before anything was added.
        """
        if len(self._kept) != 1:
            self._kept = [np.concatenate(self._kept)]
        return self._kept[0]
