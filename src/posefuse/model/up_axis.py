"""The up axis of a world: an axis, and a direction that was inferred from people."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import CameraError

UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
UP_AXES: tuple[UpAxis, ...] = get_args(UpAxis)

MAX_AXIS_ANGLE_DEG = 35.0
"""Largest angle between an inferred direction and the axis that stands for it: 10 degrees less than where another axis
is equally close.
"""


def up_vector(axis: UpAxis) -> tuple[float, float, float]:
    """Return the unit vector along an axis, in world coordinates."""
    sign = -1.0 if axis.startswith("-") else 1.0
    return tuple(sign * (axis[-1] == name) for name in "xyz")  # type: ignore[return-value]


@checked
@dataclass(frozen=True)
class InferredUp:
    """An up direction that was inferred from upright people.

    Attributes:
        direction: unit vector in world coordinates.
        sd_deg: standard deviation of its tilt, in degrees.

    Raises:
        CameraError: if the direction is not a unit vector.
    """

    direction: tuple[float, float, float]
    sd_deg: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", tuple(float(each) for each in self.direction))
        length = float(np.linalg.norm(self.direction))
        if len(self.direction) != 3 or not abs(length - 1.0) < 1e-6:
            raise CameraError(f"An inferred up direction must be a unit vector of 3 numbers, got {self.direction}.")

    @property
    def nearest_axis(self) -> UpAxis:
        """The axis with the smallest angle to the direction."""
        return max(UP_AXES, key=lambda axis: float(np.dot(up_vector(axis), self.direction)))

    @property
    def angle_deg(self) -> float:
        """Angle between the direction and the nearest axis, in degrees."""
        cosine = float(np.dot(up_vector(self.nearest_axis), self.direction))
        return float(np.degrees(np.arccos(min(cosine, 1.0))))

    @property
    def level_direction(self) -> tuple[float, float, float]:
        """Up direction of a leveled world: the nearest axis if it is within 1.5 standard deviations.

        Most worlds that are not those of a camera are level, and people lean.
        """
        return up_vector(self.nearest_axis) if self.angle_deg <= 1.5 * self.sd_deg else self.direction

    @property
    def axis(self) -> UpAxis | None:
        """The nearest axis; None if the direction is between axes."""
        return self.nearest_axis if self.angle_deg <= MAX_AXIS_ANGLE_DEG else None
