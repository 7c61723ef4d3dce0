"""Points made linear: what any choice of views would say of them, and what each view adds to the others."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.cameras.linearize import linearize
from posefuse.model.cameras import CameraRig
from posefuse.triangulation.observations import Observations


def linear_rows(rig: CameraRig, points_m: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (point, view, 2) in px, projected less observed, and their derivatives (point, view, 2, 3).

    Args:
        rig: the cameras.
        points_m: shape (point, 3).
        pixels: shape (point, view, 2), NaN where a view has no observation; there is no result either.
    """
    residuals, jacobians = np.empty(pixels.shape), np.empty((*pixels.shape, 3))
    linearize(*rig.packed, np.ascontiguousarray(points_m), np.ascontiguousarray(pixels), residuals, jacobians)
    return residuals, jacobians


_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class LinearPoints:
    """Observations, linear about a point each.

    Attributes:
        residuals_px: shape (point, view, 2), NaN where a view has no observation.
        jacobians: shape (point, view, 2, 3), px per unit of the world.
    """

    residuals_px: np.ndarray
    jacobians: np.ndarray

    @classmethod
    def at(cls, observations: Observations, points_m: np.ndarray) -> Self:
        """Linear about given points, shape (point, 3), which should lie near where the views see them."""
        return cls(*linear_rows(observations.rig, points_m, observations.pixels))

    def fit(self, sigma_px: np.ndarray, used: np.ndarray | None = None) -> "LinearFit":
        """The maximum-likelihood point of each row.

        Args:
            sigma_px: shape (point, view): standard deviations of the observations, inf for those that do not count.
            used: shape (point, view), bool: which observations make the points; by default all that count.
        """
        counts = np.isfinite(sigma_px) & np.isfinite(self.residuals_px[..., 0])
        used = counts if used is None else counts & used
        # Points last: sums over views and axes are then sums of long rows.
        weight = np.where(counts, 1.0 / sigma_px, 0.0).T
        residual = np.where(counts.T, self.residuals_px.transpose(2, 1, 0), 0.0) * weight
        jacobian = np.where(counts.T, self.jacobians.transpose(2, 3, 1, 0), 0.0) * weight
        kept = jacobian * used.T
        covariance = _inverse_3x3([(kept[:, i] * jacobian[:, k]).sum(axis=(0, 1)) for i, k in _UPPER])
        gradient = [(kept[:, i] * residual).sum(axis=(0, 1)) for i in range(3)]
        along = np.stack([sum(jacobian[:, i] * covariance[i][k] for i in range(3)) for k in range(3)], axis=1)
        residual = residual - sum(along[:, i] * gradient[i] for i in range(3))
        share = (along[:, None] * jacobian[None]).sum(axis=2)
        return LinearFit(used, residual.transpose(2, 1, 0), share.transpose(3, 2, 0, 1))


def _inverse_3x3(upper: Sequence[np.ndarray]) -> list[list[np.ndarray]]:
    """Rows of the inverses of symmetric matrices, given as six numbers each of shape (point,); large if singular."""
    xx, xy, xz, yy, yz, zz = upper
    # The trace makes a matrix without any views invertible, and is nothing to one that has them.
    least = 1e-12 * (xx + yy + zz) + 1e-300
    w0 = 1.0 / (xx + least)
    l1, l2 = xy * w0, xz * w0
    w1 = 1.0 / np.maximum(yy + least - l1 * xy, least)
    e = yz - l1 * xz
    l3 = e * w1
    w2 = 1.0 / np.maximum(zz + least - l2 * xz - l3 * e, least)
    m = l1 * l3 - l2
    a, b, c = -l1 * w1 - m * l3 * w2, m * w2, -l3 * w2
    return [[w0 + l1**2 * w1 + m**2 * w2, a, b], [a, w1 + l3**2 * w2, c], [b, c, w2]]


@dataclass(frozen=True)
class LinearFit:
    """Residuals at maximum-likelihood points, in units of each observation's standard deviation.

    Attributes:
        used: shape (point, view), bool.
        residuals: shape (point, view, 2), 0 where a view has none that counts.
        shares: shape (point, view, 2, 2): the covariance of where the view sees the point; of a used view, its block
            of the hat matrix, how far the point gives way to it.
    """

    used: np.ndarray
    residuals: np.ndarray
    shares: np.ndarray

    @property
    def squared(self) -> np.ndarray:
        """Shape (point,): sum of the used squared residuals."""
        return (np.square(self.residuals).sum(axis=-1) * self.used).sum(axis=-1)

    @property
    def freedom(self) -> np.ndarray:
        """Shape (point,): of how many degrees of freedom that sum is."""
        return 2.0 * self.used.sum(axis=1) - 3.0

    def left_out(self) -> tuple[np.ndarray, np.ndarray]:
        """What each view says if the others alone make the point.

        Returns:
            Shape (point, view, 2): the residuals the view then has. Shape (point, view, 2, 2): the inverse of their
            covariance. Both without meaning where the others fix no point.
        """
        used = self.used[..., None, None]
        inverse = np.where(used, np.eye(2) - self.shares, inverse_2x2(np.eye(2) + self.shares))
        residuals = times_2(inverse_2x2(inverse), self.residuals)
        return np.where(self.used[..., None], residuals, self.residuals), inverse


def inverse_2x2(symmetric: np.ndarray) -> np.ndarray:
    """Inverses of symmetric 2x2 matrices; large ones of singular ones."""
    determinant = symmetric[..., 0, 0] * symmetric[..., 1, 1] - symmetric[..., 0, 1] ** 2
    adjugate = np.trace(symmetric, axis1=-2, axis2=-1)[..., None, None] * np.eye(2) - symmetric
    return adjugate / np.maximum(determinant, 1e-9)[..., None, None]


def times_2(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products of 2x2 matrices with vectors."""
    return matrices[..., 0] * vectors[..., :1] + matrices[..., 1] * vectors[..., 1:]
