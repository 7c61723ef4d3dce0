"""Whether a result is in another world than its ground truth: a similarity removes nearly all of the errors."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.rotations import similarity_of_points

_LEAST_FACTOR = 10.0
_LEAST_POINTS = 12
_SAME_SCALE = 0.1


@dataclass(frozen=True)
class OtherWorld:
    """The similarity that maps a result to its ground truth.

    Attributes:
        scale: its scale; 1 if a rotation and a shift suffice.
        mean_mm: mean distance after it.
    """

    scale: float
    mean_mm: float


def find_other_world(points_m: np.ndarray, truth_m: np.ndarray) -> OtherWorld | None:
    """Return the similarity that reduces the mean distance to a tenth or less, or None if there is none.

    A rotation and a shift are tried first.

    Args:
        points_m: shape (point, 3), points of the result.
        truth_m: shape (point, 3), the same points of the truth.
    """
    if len(points_m) < _LEAST_POINTS:
        return None
    most_m = float(np.linalg.norm(points_m - truth_m, axis=1).mean()) / _LEAST_FACTOR
    rotation, own_scale = similarity_of_points(points_m, truth_m)
    from_m, to_m = points_m - points_m.mean(axis=0), truth_m - truth_m.mean(axis=0)
    for scale in (1.0, own_scale):
        mean_m = float(np.linalg.norm(scale * from_m @ rotation.T - to_m, axis=1).mean())
        # The least number keeps the rounding of equal points from counting.
        if mean_m <= most_m and most_m > 1e-6:
            return OtherWorld(scale, 1000.0 * mean_m)
    return None


def is_scaled(world: OtherWorld) -> bool:
    """Return whether the worlds have different units of length."""
    return abs(np.log(world.scale)) > _SAME_SCALE
