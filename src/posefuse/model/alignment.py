"""How the world of a result follows from that of its calibration."""

from dataclasses import dataclass, fields

import numpy as np

from posefuse.arrays import Rebuilt, frozen, same
from posefuse.errors import ResultError
from posefuse.model.cameras import UpAxis

_ROTATION_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Alignment(Rebuilt):
    """A similarity: ``p_aligned = scale * rotation @ p_calibration + shift_m``.

    Attributes:
        rotation: shape (3, 3): aligned from calibration.
        shift_m: shape (3,): in metres of the aligned world.
        scale: what the calibration's metres are multiplied by.
        up_axis: of the aligned world, None where nobody knows.
        calibration_up_axis: of the calibration's world, likewise.
        steps: how it was found, in sentences.

    Raises:
        ResultError: if that is no similarity, or one that mirrors.
    """

    rotation: np.ndarray
    shift_m: np.ndarray
    scale: float = 1.0
    up_axis: UpAxis | None = None
    calibration_up_axis: UpAxis | None = None
    steps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation))
        object.__setattr__(self, "shift_m", frozen(self.shift_m))
        object.__setattr__(self, "steps", tuple(self.steps))
        if self.rotation.shape != (3, 3) or self.shift_m.shape != (3,):
            raise ResultError(
                f"An alignment is a 3 x 3 rotation and 3 numbers, got {self.rotation.shape} and {self.shift_m.shape}."
            )
        off = float(np.abs(self.rotation @ self.rotation.T - np.eye(3)).max())
        if not (off < _ROTATION_TOLERANCE and np.linalg.det(self.rotation) > 0):
            raise ResultError(f"An alignment's rotation must be one; R R^T differs from the identity by {off:.2g}.")
        if not 0 < self.scale < np.inf:
            raise ResultError(f"An alignment's scale must be positive, got {self.scale}.")

    def points(self, points_m: np.ndarray) -> np.ndarray:
        """Points, shape (..., 3), of the calibration's world in the aligned one."""
        return self.scale * np.asarray(points_m) @ self.rotation.T + self.shift_m

    @property
    def inverse(self) -> "Alignment":
        """Back to the calibration's world."""
        back = self.rotation.T
        shift_m = -back @ self.shift_m / self.scale
        return Alignment(back, shift_m, 1.0 / self.scale, self.calibration_up_axis, self.up_axis)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Alignment) and all(
            same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]
