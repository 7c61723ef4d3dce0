"""Left/right swaps of the detector, per limb and view."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from posefuse.arrays import check_shape, same
from posefuse.errors import ResultError


class SwapState(IntEnum):
    """Whether a view swaps the sides of a limb."""

    UNKNOWN = -1
    AS_LABELED = 0
    SWAPPED = 1


@dataclass(frozen=True, eq=False)
class Swaps:
    """Left/right swaps per frame, person, view and limb, as decided by the side assignment.

    Attributes:
        chains: names of the skeleton's chains; a pair outside all chains is a chain of its own.
        state: shape (frame, person, view, chain), int8: :class:`SwapState`.

    Raises:
        ResultError: if the arrays do not match.
    """

    chains: tuple[str, ...]
    state: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "chains", tuple(self.chains))
        check_shape(
            ResultError, "Swaps", "state", self.state, frame=None, person=None, view=None, chain=len(self.chains)
        )

    def frames(self, start: int, stop: int) -> "Swaps":
        """Return the frames ``start`` to ``stop``, in memory."""
        return Swaps(self.chains, np.asarray(self.state[start:stop]))

    @classmethod
    def concatenate(cls, parts: Sequence["Swaps"]) -> "Swaps":
        """Concatenate consecutive ranges of frames."""
        return cls(parts[0].chains, np.concatenate([part.state[:] for part in parts]))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Swaps) and self.chains == other.chains and same(self.state[:], other.state[:])

    __hash__ = None  # type: ignore[assignment]
