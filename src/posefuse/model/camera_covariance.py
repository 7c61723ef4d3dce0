"""Covariance of the parameters of one calibrated camera, and of all cameras together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import PickledByFields, frozen
from posefuse.errors import CameraError, choices, suggestion
from posefuse.model.lenses import N_COEFFICIENTS, LensModel

ROTATION = ("rotation_x_rad", "rotation_y_rad", "rotation_z_rad")
"""Rotations of the camera about its own axes."""

CENTER = ("center_x_m", "center_y_m", "center_z_m")
"""Shifts of the camera's center along its own axes, so that they do not depend on the axes of the world."""

MATRIX = ("fx_px", "fy_px", "cx_px", "cy_px")

_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_FISHEYE_COEFFICIENTS = ("k1", "k2", "k3", "k4")
_SYMMETRY = 1e-6


def parameter_names(lens: LensModel) -> tuple[str, ...]:
    """Return the names of all parameters of a camera in order: rotation, center, fx, fy, cx, cy, and distortion."""
    distortion = _FISHEYE_COEFFICIENTS if lens is LensModel.FISHEYE else _COEFFICIENTS[: N_COEFFICIENTS[lens]]
    return (*ROTATION, *CENTER, *MATRIX, *distortion)


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


@checked
@dataclass(frozen=True, eq=False)
class RigCovariance(PickledByFields):
    """Covariance of the parameters of all cameras of a calibration, whose errors are correlated.

    Attributes:
        parameters: name of the camera and of the parameter of each row, as in :class:`CameraCovariance`.
        matrix: shape (parameter, parameter).
    """

    parameters: tuple[tuple[str, str], ...]
    matrix: np.ndarray

    def block(self, parameters: Sequence[tuple[str, str]]) -> np.ndarray:
        """Return the covariance of some parameters, shape (n, n), 0 for parameters that were not estimated.

        Args:
            parameters: names of the camera and of the parameter.
        """
        out = np.zeros((len(parameters), len(parameters)))
        rows = {each: row for row, each in enumerate(self.parameters)}
        known = [i for i, each in enumerate(parameters) if each in rows]
        at = [rows[parameters[i]] for i in known]
        out[np.ix_(known, known)] = self.matrix[np.ix_(at, at)]
        return out


def joined(covariances: Sequence[CameraCovariance], correlation: np.ndarray) -> RigCovariance:
    """Return the covariance of all cameras from those of each and the correlation of all their parameters.

    Args:
        covariances: of the cameras.
        correlation: shape (parameter, parameter): of all parameters in this order. Its blocks of single cameras are
            not used: their covariances are exact.
    """
    sd = np.concatenate([np.sqrt(np.diag(each.matrix)) for each in covariances])
    matrix = correlation * np.outer(sd, sd)
    start = 0
    for each in covariances:
        stop = start + len(each.parameters)
        matrix[start:stop, start:stop] = each.matrix
        start = stop
    return RigCovariance(tuple((each.camera, name) for each in covariances for name in each.parameters), matrix)


def separated(
    parameters: Sequence[tuple[str, str]], matrix: np.ndarray, reference: str
) -> tuple[tuple[CameraCovariance, ...], np.ndarray]:
    """Return the covariance of each camera, and the correlation of all parameters: the inverse of :func:`joined`.

    Args:
        parameters: name of the camera and of the parameter of each row; those of one camera follow each other.
        matrix: shape (parameter, parameter).
        reference: what the poses are relative to.
    """
    symmetric = 0.5 * (matrix + matrix.T)
    rows: dict[str, list[int]] = {}
    for row, (camera, _) in enumerate(parameters):
        rows.setdefault(camera, []).append(row)
    covariances = tuple(
        CameraCovariance(camera, tuple(parameters[i][1] for i in own), symmetric[np.ix_(own, own)], reference)
        for camera, own in rows.items()
    )
    return covariances, correlation_of(symmetric)


def checked_correlation(covariances: Sequence[CameraCovariance], correlation: np.ndarray) -> np.ndarray:
    """Return the correlation of all parameters of some covariances, read-only.

    Raises:
        CameraError: if it has another size, or contains numbers that are not finite.
    """
    out, n = frozen(correlation), sum(len(each.parameters) for each in covariances)
    if out.shape != (n, n) or not np.isfinite(out).all():
        raise CameraError(
            f"The covariances of the cameras have {n} parameters, so their correlation must be {n} x {n} finite "
            f"numbers; got shape {out.shape}."
        )
    return out


def correlation_of(covariance: np.ndarray) -> np.ndarray:
    """Return the correlations that belong to a covariance, shape (n, n), 0 where a variance is 0."""
    sd = np.sqrt(np.diag(covariance))
    inverse = np.divide(1.0, sd, out=np.zeros_like(sd), where=sd > 0.0)
    return np.clip(covariance * np.outer(inverse, inverse), -1.0, 1.0)
