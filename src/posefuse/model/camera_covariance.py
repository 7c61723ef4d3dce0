"""Covariance of the parameters of a calibrated camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import PickledByFields, frozen
from posefuse.errors import CameraError, choices, suggestion

ROTATION = ("rotation_x_rad", "rotation_y_rad", "rotation_z_rad")
"""Rotations of the camera about its own axes."""

CENTER = ("center_x_m", "center_y_m", "center_z_m")
"""Shifts of the camera's center along its own axes, so that they do not depend on the axes of the world."""

MATRIX = ("fx_px", "fy_px", "cx_px", "cy_px")

_SYMMETRY = 1e-6


@checked
@dataclass(frozen=True, eq=False)
class CameraCovariance(PickledByFields):
    """Covariance of the parameters of one camera that were estimated.

    Attributes:
        camera: name of the camera.
        parameters: names of the parameters with their units: rotations about the camera's axes, shifts of its center
            along its axes, fx, fy, cx, cy, and distortion coefficients (``k1``, ``p1``, ...).
        matrix: shape (parameter, parameter).
        reference: what the pose is relative to: the name of another camera, or a description of the world's origin.

    Raises:
        CameraError: if the matrix is not a covariance of these parameters.
    """

    camera: str
    parameters: tuple[str, ...]
    matrix: np.ndarray
    reference: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        object.__setattr__(self, "matrix", frozen(self.matrix))
        n = len(self.parameters)
        if self.matrix.shape != (n, n) or not n or len(set(self.parameters)) < n:
            raise CameraError(
                f"Camera {self.camera!r}: the covariance of {n} different parameters must have shape {(n, n)}, got "
                f"{self.matrix.shape} for {choices(self.parameters)}."
            )
        if not np.isfinite(self.matrix).all():
            raise CameraError(f"Camera {self.camera!r}: the covariance contains numbers that are not finite.")
        sd = np.sqrt(np.maximum(np.diag(self.matrix), 0.0))
        # In units of the standard deviations, because parameters have different units.
        unit = np.outer(sd, sd) + np.finfo(float).tiny
        if np.diag(self.matrix).min() < 0.0 or np.any(np.abs(self.matrix - self.matrix.T) > _SYMMETRY * unit):
            raise CameraError(f"Camera {self.camera!r}: the covariance must be symmetric with a positive diagonal.")

    def index(self, parameter: str) -> int:
        """Return the index of a parameter.

        Raises:
            CameraError: if the covariance does not contain it.
        """
        if parameter not in self.parameters:
            raise CameraError(
                f"The covariance of camera {self.camera!r} has no parameter {parameter!r}. "
                f"{suggestion(parameter, self.parameters)}"
            )
        return self.parameters.index(parameter)

    def block(self, parameters: Sequence[str]) -> np.ndarray:
        """Return the covariance of some parameters, shape (n, n), 0 for parameters that were not estimated."""
        out = np.zeros((len(parameters), len(parameters)))
        known = [i for i, name in enumerate(parameters) if name in self.parameters]
        rows = [self.parameters.index(parameters[i]) for i in known]
        out[np.ix_(known, known)] = self.matrix[np.ix_(rows, rows)]
        return out

    def sd(self, parameter: str) -> float:
        """Return the standard deviation of a parameter, in its unit.

        Raises:
            CameraError: if the covariance does not contain it.
        """
        i = self.index(parameter)
        return float(np.sqrt(self.matrix[i, i]))
