"""What a user can choose about left and right; the text of each attribute is the help."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from posefuse.errors import OptionsError

SideMethod = Literal["chains", "votes", "plane"]

SIDE_METHODS: dict[SideMethod, str] = {
    "chains": "limb by limb and over time: labels, continuity, bones and the body's own symmetry together",
    "votes": "each ray votes for the point it is near, every pair and frame by itself (mc_dev's)",
    "plane": "the person faces along a known direction of the scene all the time (mc_dev's, its x axis put right)",
}
"""Ways to tell left from right and their line in ``posefuse methods``; a file each under ``triangulation/sides/``."""

_AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class SideOptions:
    """How the two points of a pair become left and right.

    Attributes:
        facing: With plane, where the person faces, +x, -x, +y, -y, or three numbers such as 1,0.5,0; as a flag with an
            equals sign, --side-search.facing=-y.
        swap_share: With chains, the share of time a view's labels are expected to be swapped before it is known.
        dwell_s: With chains, how long a swap is expected to last before it is known, in seconds.
        rounds: With chains, how often the decision is made again with what was learned from it.
        learn_every: Online, the decision is learned from anew after so many frames.
        memory: Online, so many frames are remembered to learn from.
    """

    facing: str = "+x"
    swap_share: float = 0.15
    dwell_s: float = 0.4
    rounds: int = 4
    learn_every: int = 30
    memory: int = 300

    def __post_init__(self) -> None:
        facing_vector(self.facing)
        if not 0.0 < self.swap_share < 0.5:
            raise OptionsError(f"side_search.swap_share must lie between 0 and 0.5, got {self.swap_share}.")
        if not self.dwell_s > 0.0:
            raise OptionsError(f"side_search.dwell_s must be positive, got {self.dwell_s}.")
        for name in ("rounds", "learn_every"):
            if getattr(self, name) < 1:
                raise OptionsError(f"side_search.{name} must be at least 1, got {getattr(self, name)}.")
        if self.memory < self.learn_every:
            raise OptionsError(
                f"side_search.memory must be at least learn_every ({self.learn_every} frames), got {self.memory}."
            )


def facing_vector(facing: str) -> np.ndarray:
    """Shape (3,): the unit vector that ``+x``, ``y``, ``-z`` or ``1,0.5,0`` stands for.

    Raises:
        OptionsError: if it stands for none.
    """
    text = facing.strip().lower()
    axis = _AXES.get(text) or _AXES.get(f"+{text}")
    try:
        vector = np.array(axis if axis else [float(part) for part in text.split(",")], dtype=np.float64)
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise OptionsError(
            f"side_search.facing: expected +x, -x, +y, -y, +z, -z or three numbers such as 1,0.5,0, got {facing!r}."
        )
    return vector / np.linalg.norm(vector)
