"""Options of left/right assignment."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option

SideMethod = Literal["chains", "votes", "plane"]

SIDE_METHODS: dict[SideMethod, str] = {
    "chains": "per limb and over time, from labels, continuity, bone lengths and the symmetry of the body",
    "votes": "per pair and frame, each ray votes for the nearer point (as in mc_dev)",
    "plane": "from a facing direction that is constant over the recording (as in mc_dev, with its x axis corrected)",
}
"""Methods that assign left and right, and their line in ``posefuse methods``."""

_AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class SideOptions:
    """Options of the assignment of left and right to the two points of a pair.

    Attributes:
        facing: Facing direction for the `plane` method: +x, -x, +y, -y, +z, -z or three numbers such as 1,0.5,0. Write
            the flag with an equals sign, as in --side-search.facing=-y.
        swap_share: Expected fraction of time in which a view has left and right swapped, before it is estimated, for
            the method `chains`.
        swap_duration_s: Expected duration of a left/right swap, before it is estimated, for the method `chains`.
        iterations: Number of times the method `chains` repeats the assignment with updated estimates.
    """

    facing: str = "+x"
    swap_share: float = option(0.15, above=0.0, below=0.5)
    swap_duration_s: float = option(0.4, above=0.0)
    iterations: int = option(4, at_least=1, at_most=1000)

    def __post_init__(self) -> None:
        check_fields(self, "side_search")
        facing_vector(self.facing)


def facing_vector(facing: str) -> np.ndarray:
    """Return the unit vector of a direction such as ``+x``, ``y``, ``-z`` or ``1,0.5,0``, shape (3,).

    Raises:
        OptionsError: if the text is not a direction.
    """
    text = facing.strip().lower()
    axis = _AXES.get(text) or _AXES.get(f"+{text}")
    try:
        vector = np.array(axis if axis else [float(part) for part in text.split(",")], dtype=np.float64)
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise OptionsError(
            f"side_search.facing must be +x, -x, +y, -y, +z, -z or three numbers such as 1,0.5,0, got {facing!r}."
        )
    return vector / np.linalg.norm(vector)
