"""Rounding of the arrays of ``reconstruction.nc`` to a stated precision, because random last digits do not compress.

Precision follows the uncertainty: a standard deviation along any direction changes by less than 1 %, a coordinate by
less than a hundredth of its smallest standard deviation and less than :data:`MAX_STEP`. Quanta are powers of two.
Coordinates without a standard deviation, such as those of a simulated truth, are not rounded.
A smallest standard deviation below 1/300 of the largest changes by up to 5 %, and one below about 1/1500 is increased,
so that rounded covariances remain positive definite.
"""

from dataclasses import replace

import numpy as np

from posefuse.model.joint_angles import JointAngles
from posefuse.model.reconstruction import Layer, Reconstruction, unpack_covariance
from posefuse.model.track_events import Poses

MAX_STEP = 2.0**-20
"""Largest distance between neighboring coordinates, in the unit of the result (m or px): 0.00095 mm."""

_COVARIANCE_PARTS = 128.0
"""Number of quanta in the smallest variance of a point."""

_POINT_PARTS = 64.0
"""Number of quanta in the smallest standard deviation of a point."""

TURN_STEP = 2.0**-18
"""Quantum of the entries of rotation matrices and of unit vectors."""

ANGLE_STEP_DEG = 2.0**-11
"""Quantum of joint angles in degrees: 0.0005 degrees."""

_MIN_SHARE = 2.0**-23
"""Smallest variance that float32 holds beside the others, as a share of their sum."""

ERROR_BITS, SD_BITS = 7, 10
"""Binary digits after the first one of errors in pixels, within 0.4 %, and of standard deviations, within 0.05 %."""

PRECISION = {
    "position": "rounded to 2^-20 (0.00095 mm) or finer, at most 1/64 of the smallest standard deviation",
    "covariance": "float32, rounded to at most 1/128 of the smallest variance: standard deviations within 1 %",
    "reprojection_error": "float32, rounded to 11 binary digits (within 0.05 %)",
    "view_error": "float32, rounded to 8 binary digits (within 0.4 %)",
}
"""Name of a layer's variable -> its precision, as the file states it."""

_FLOAT32_BITS = 23
_DIAGONAL = [0, 3, 5]
"""Variances among the entries of a covariance."""
_CANCELING_SHARE, _ROUNDING_SHARE = 1e-6, 1e-15
"""Shares of the sum of the variances: below the first, the smallest one is computed exactly, within the second."""


def rounded(result: Reconstruction) -> Reconstruction:
    """Return a result as ``reconstruction.nc`` stores it."""
    return replace(
        result,
        layers={name: rounded_layer(layer) for name, layer in result.layers.items()},
        poses=None if result.poses is None else rounded_poses(result.poses),
        joint_angles=None if result.joint_angles is None else rounded_angles(result.joint_angles),
    )


def rounded_layer(layer: Layer) -> Layer:
    """Return a layer with rounded points, covariances and errors."""
    covariance_m2 = np.asarray(layer.covariance_m2[:], dtype=np.float64)
    smallest_m2 = smallest_variance(covariance_m2)
    return replace(
        layer,
        points_m=_to_multiples(np.asarray(layer.points_m[:]), _point_step(smallest_m2)[..., None]),
        covariance_m2=_rounded_covariance(covariance_m2, smallest_m2),
        reprojection_error_px=to_digits(layer.reprojection_error_px[:], SD_BITS),
        view_error_px=to_digits(layer.view_error_px[:], ERROR_BITS),
    )


def rounded_poses(poses: Poses) -> Poses:
    """Return poses with rounded directions and standard deviations."""
    root = np.asarray(poses.root_turn_rad2[:], dtype=np.float64)
    return replace(
        poses,
        turns=_to_multiples(np.asarray(poses.turns[:]), TURN_STEP),
        directions=_to_multiples(np.asarray(poses.directions[:]), TURN_STEP),
        angle_sd_deg=to_digits(poses.angle_sd_deg[:], SD_BITS),
        root_turn_rad2=_rounded_covariance(root, smallest_variance(root)),
    )


def rounded_angles(angles: JointAngles) -> JointAngles:
    """Return rounded joint angles."""
    return replace(
        angles,
        degrees=_to_multiples(np.asarray(angles.degrees[:]), ANGLE_STEP_DEG),
        sd_deg=to_digits(angles.sd_deg[:], SD_BITS),
        pelvis_m=_to_multiples(np.asarray(angles.pelvis_m[:]), MAX_STEP),
    )


def smallest_variance(covariance: np.ndarray) -> np.ndarray:
    """Return a lower bound of the smallest eigenvalue, shape (...); not above 0 or NaN where there is none.

    The bound, the determinant divided by the sum of the principal minors, is at least a third of the eigenvalue. Where
    it is so small that digits cancel, it is the eigenvalue; one of 0 within rounding errors counts as positive.

    Args:
        covariance: shape (..., 6): xx xy xz yy yz zz.
    """
    xx, xy, xz, yy, yz, zz = np.moveaxis(covariance, -1, 0)
    first, second, third = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
    determinant = xx * first - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    trace = xx + yy + zz
    with np.errstate(divide="ignore", invalid="ignore"):
        minors = first + second + third
        bound = determinant / minors
        cancels = (bound < _CANCELING_SHARE * trace) | (minors < _CANCELING_SHARE * trace**2)
    # Points in an image plane have no variance across it.
    spatial = (covariance[..., _DIAGONAL] > 0.0).all(axis=-1)
    cancels = np.asarray(cancels & spatial & np.isfinite(covariance).all(axis=-1))
    if cancels.any():
        scale = trace[cancels]
        shares = np.linalg.eigvalsh(unpack_covariance(covariance[cancels] / scale[:, None]))[:, 0]
        bound = np.array(bound)
        bound[cancels] = scale * np.where(shares > -_ROUNDING_SHARE, np.maximum(shares, _ROUNDING_SHARE), shares)
    return bound


def to_digits(values: np.ndarray, bits: int) -> np.ndarray:
    """Return values as float32 with ``bits`` binary digits after the first one; half is rounded away from zero."""
    numbers = np.ascontiguousarray(values, dtype=np.float32)
    dropped = _FLOAT32_BITS - bits
    nearest = (numbers.view(np.int32) + np.int32(1 << (dropped - 1))) & np.int32(-(1 << dropped))
    return np.where(np.isfinite(numbers), nearest.view(np.float32), numbers)


def _rounded_covariance(covariance: np.ndarray, smallest: np.ndarray) -> np.ndarray:
    """Return covariances as float32, rounded to multiples of a small part of the smallest variance."""
    trace = covariance[..., _DIAGONAL].sum(axis=-1)
    with np.errstate(invalid="ignore"):
        lacking = np.where(smallest > 0.0, np.maximum(_MIN_SHARE * trace - smallest, 0.0), 0.0)
    kept = covariance.copy()
    kept[..., _DIAGONAL] += lacking[..., None]
    return _to_multiples(kept, _power_below(smallest / _COVARIANCE_PARTS)[..., None]).astype(np.float32)


def _point_step(smallest_m2: np.ndarray) -> np.ndarray:
    """Return the quantum of the coordinates of each point, shape (...); 0 where the uncertainty is unknown."""
    with np.errstate(invalid="ignore"):
        step = _power_below(np.sqrt(smallest_m2) / _POINT_PARTS)
    return np.minimum(step, MAX_STEP)


def _power_below(values: np.ndarray) -> np.ndarray:
    """Return the largest power of two that is not above each value; 0 for values that are not positive."""
    positive = np.isfinite(values) & (values > 0.0)
    _, exponent = np.frexp(np.where(positive, values, 1.0))
    return np.where(positive, np.ldexp(1.0, exponent - 1), 0.0)


def _to_multiples(values: np.ndarray, step: np.ndarray | float) -> np.ndarray:
    """Return multiples of a power of two next to the values; values themselves where it is 0."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(step > 0.0, np.round(values / step) * step, values)
