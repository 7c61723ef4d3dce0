"""Linearized points: fits from any subset of views, and leave-one-out residuals of each view."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels.cameras.linearize import linearize
from posefuse.model.cameras import CameraRig
from posefuse.triangulation.observations import Observations


def linear_rows(rig: CameraRig, points_m: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals (point, view, 2) in px, projected minus observed, and their derivatives (point, view, 2, 3).

    Args:
        rig: the cameras.
        points_m: shape (point, 3).
        pixels: shape (point, view, 2), NaN where a view has no observation; results are NaN there too.
    """
    residuals, jacobians = linearize(rig.packed, kernel_array(points_m)[None], kernel_array(pixels)[None])
    return residuals[0], jacobians[0]


_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class LinearPoints:
    """Hold observations linearized about one point each.

    Attributes:
        residuals_px: shape (point, view, 2), NaN where a view has no observation.
        jacobians: shape (point, view, 2, 3), px per unit of the world.
    """

    residuals_px: np.ndarray
    jacobians: np.ndarray

    @classmethod
    def at(cls, observations: Observations, points_m: np.ndarray) -> Self:
        """Linearize about given points, shape (point, 3), which should be close to the observations."""
        return cls(*linear_rows(observations.rig, points_m, observations.pixels))

    def fit(self, sigma_px: np.ndarray, used: np.ndarray | None = None) -> "LinearFit":
        """Return the maximum-likelihood point of each row.

        Args:
            sigma_px: shape (point, view): standard deviations of the observations, inf for observations to ignore.
            used: shape (point, view), bool: observations that determine the points; by default all that count.
        """
        there, residuals, jacobians = self._columns
        counts = np.isfinite(sigma_px) & there
        used = counts if used is None else counts & used
        weight = np.where(counts.T, 1.0 / sigma_px.T, 0.0)
        residual, jacobian = residuals * weight, jacobians * weight
        weighted = jacobian * used.T
        covariance = _inverse_3x3([(weighted[:, i] * jacobian[:, k]).sum(axis=(0, 1)) for i, k in _UPPER])
        gradient = [(weighted[:, i] * residual).sum(axis=(0, 1)) for i in range(3)]
        gain = np.stack([sum(jacobian[:, i] * covariance[i][k] for i in range(3)) for k in range(3)], axis=1)
        residual = residual - sum(gain[:, i] * gradient[i] for i in range(3))
        return LinearFit(used, residual.transpose(2, 1, 0), gain, jacobian)

    @cached_property
    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where there are observations (point, view), their residuals (2, view, point) and derivatives; 0 elsewhere.

        Points are in the last axis, so that sums over views and axes run over long contiguous rows.
        """
        there = np.isfinite(self.residuals_px[..., 0])
        residuals = np.where(there.T, self.residuals_px.transpose(2, 1, 0), 0.0)
        return there, residuals, np.where(there.T, self.jacobians.transpose(2, 3, 1, 0), 0.0)


def _inverse_3x3(upper: Sequence[np.ndarray]) -> list[list[np.ndarray]]:
    """Return the rows of the inverses of symmetric matrices, large values if singular.

    Args:
        upper: six arrays of shape (point,), the upper triangle row by row.
    """
    xx, xy, xz, yy, yz, zz = upper
    # A small multiple of the trace makes matrices without views invertible and leaves the others unchanged.
    floor = 1e-12 * (xx + yy + zz) + 1e-300
    w0 = 1.0 / (xx + floor)
    l1, l2 = xy * w0, xz * w0
    w1 = 1.0 / np.maximum(yy + floor - l1 * xy, floor)
    e = yz - l1 * xz
    l3 = e * w1
    w2 = 1.0 / np.maximum(zz + floor - l2 * xz - l3 * e, floor)
    m = l1 * l3 - l2
    a, b, c = -l1 * w1 - m * l3 * w2, m * w2, -l3 * w2
    return [[w0 + l1**2 * w1 + m**2 * w2, a, b], [a, w1 + l3**2 * w2, c], [b, c, w2]]


@dataclass(frozen=True)
class LinearFit:
    """Hold residuals at maximum-likelihood points, in units of each observation's standard deviation.

    Attributes:
        used: shape (point, view), bool.
        residuals: shape (point, view, 2), 0 where a view has no observation that counts.
        gain: shape (2, 3, view, point): derivatives of the observations times the covariance of the point.
        jacobian: the same shape: derivatives of the observations, in units of their standard deviations.
    """

    used: np.ndarray
    residuals: np.ndarray
    gain: np.ndarray
    jacobian: np.ndarray

    @cached_property
    def shares(self) -> np.ndarray:
        """Covariance of the projected point, (point, view, 2, 2); for a used view, its block of the hat matrix."""
        return (self.gain[:, None] * self.jacobian[None]).sum(axis=2).transpose(3, 2, 0, 1)

    @property
    def leverages(self) -> np.ndarray:
        """Traces of the shares, shape (point, view)."""
        return np.einsum("aivp,aivp->vp", self.gain, self.jacobian).T

    @property
    def squares(self) -> np.ndarray:
        """Return the squared residual of each observation, shape (point, view)."""
        return np.square(self.residuals[..., 0]) + np.square(self.residuals[..., 1])

    @property
    def squared(self) -> np.ndarray:
        """Return the sum of the squared residuals of the used views, shape (point,)."""
        return (np.square(self.residuals).sum(axis=-1) * self.used).sum(axis=-1)

    @property
    def degrees_of_freedom(self) -> np.ndarray:
        """Return the degrees of freedom of that sum, shape (point,)."""
        return 2.0 * self.used.sum(axis=1) - 3.0

    def leave_one_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the residuals of each view if only the other views determine the point.

        Returns:
            Shape (point, view, 2): the residuals. Shape (point, view, 2, 2): the inverse of their covariance. Both are
            meaningless where the other views do not determine the point.
        """
        used = self.used[..., None, None]
        inverse = np.where(used, np.eye(2) - self.shares, inverse_2x2(np.eye(2) + self.shares))
        residuals = multiply_2x2(inverse_2x2(inverse), self.residuals)
        return np.where(self.used[..., None], residuals, self.residuals), inverse


def inverse_2x2(symmetric: np.ndarray) -> np.ndarray:
    """Return inverses of symmetric 2x2 matrices; large values if singular."""
    determinant = symmetric[..., 0, 0] * symmetric[..., 1, 1] - symmetric[..., 0, 1] ** 2
    adjugate = np.trace(symmetric, axis1=-2, axis2=-1)[..., None, None] * np.eye(2) - symmetric
    return adjugate / np.maximum(determinant, 1e-9)[..., None, None]


def multiply_2x2(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return products of 2x2 matrices with vectors."""
    return matrices[..., 0] * vectors[..., :1] + matrices[..., 1] * vectors[..., 1:]
