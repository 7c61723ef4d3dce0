"""The transform from the calibration's world to the world of a result."""

from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np

from posefuse.arguments import Shape, checked
from posefuse.arrays import PickledByFields, frozen, same
from posefuse.errors import ResultError
from posefuse.model.up_axis import InferredUp, UpAxis

_ROTATION_TOLERANCE = 1e-6


@checked
@dataclass(frozen=True, eq=False)
class Alignment(PickledByFields):
    """A similarity transform: ``p_aligned = scale * rotation @ p_calibration + shift_m``.

    Attributes:
        rotation: shape (3, 3), aligned from calibration.
        shift_m: shape (3,), in meters of the aligned world.
        scale: factor from the calibration's meters.
        up_axis: up axis of the aligned world, None if unknown.
        calibration_up_axis: up axis of the calibration's world, None if unknown.
        steps: how it was determined, in sentences.
        inferred_up: up direction of the aligned world, if it was inferred from people, else None.
        calibration_inferred_up: up direction of the calibration's world, if it was inferred from people, else None.

    Raises:
        ResultError: if it is not a similarity transform, or a reflection.
    """

    rotation: np.ndarray
    shift_m: np.ndarray
    scale: float = 1.0
    up_axis: UpAxis | None = None
    calibration_up_axis: UpAxis | None = None
    steps: tuple[str, ...] = ()
    inferred_up: InferredUp | None = None
    calibration_inferred_up: InferredUp | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation))
        object.__setattr__(self, "shift_m", frozen(self.shift_m))
        object.__setattr__(self, "steps", tuple(self.steps))
        if self.rotation.shape != (3, 3) or self.shift_m.shape != (3,):
            raise ResultError(
                f"An alignment needs a 3 x 3 rotation and a shift of 3 numbers, got {self.rotation.shape} and "
                f"{self.shift_m.shape}."
            )
        off = float(np.abs(self.rotation @ self.rotation.T - np.eye(3)).max())
        if not (off < _ROTATION_TOLERANCE and np.linalg.det(self.rotation) > 0):
            raise ResultError(
                f"The rotation of an alignment must be orthonormal and proper; R R^T differs from the identity by "
                f"{off:.2g}."
            )
        if not 0 < self.scale < np.inf:
            raise ResultError(f"The scale of an alignment must be positive, got {self.scale}.")

    def points(self, points_m: Annotated[np.ndarray, Shape(..., 3)]) -> np.ndarray:
        """Transform points, shape (..., 3), from the calibration's world to the aligned one."""
        return self.scale * np.asarray(points_m) @ self.rotation.T + self.shift_m

    @property
    def inverse(self) -> "Alignment":
        """The transform back to the calibration's world."""
        back = self.rotation.T
        shift_m = -back @ self.shift_m / self.scale
        return Alignment(
            back, shift_m, 1.0 / self.scale, self.calibration_up_axis, self.up_axis,
            inferred_up=self.calibration_inferred_up, calibration_inferred_up=self.inferred_up,
        )  # fmt: skip

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Alignment) and all(
            same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]
