"""Points made linear: what any choice of views would say of them, and what each view adds to the others."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.linear import linearise
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
    linearise(*rig.packed, np.ascontiguousarray(points_m), np.ascontiguousarray(pixels), residuals, jacobians)
    return residuals, jacobians


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

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """One after the other."""
        return cls(
            np.concatenate([part.residuals_px for part in parts]), np.concatenate([part.jacobians for part in parts])
        )

    def fit(self, sigma_px: np.ndarray, used: np.ndarray | None = None) -> "LinearFit":
        """The maximum-likelihood point of each row.

        Args:
            sigma_px: shape (point, view): standard deviations of the observations, inf for those that do not count.
            used: shape (point, view), bool: which observations make the points; by default all that count.
        """
        counts = np.isfinite(sigma_px) & np.isfinite(self.residuals_px[..., 0])
        used = counts if used is None else counts & used
        weight = np.where(counts, 1.0 / sigma_px, 0.0)[..., None]
        residual = np.where(counts[..., None], self.residuals_px, 0.0) * weight
        jacobian = np.where(counts[..., None, None], self.jacobians, 0.0) * weight[..., None]
        rows = np.where(used[..., None, None], jacobian, 0.0).reshape(len(jacobian), -1, 3)
        information = rows.transpose(0, 2, 1) @ rows
        # The trace makes a matrix without any views invertible, and is nothing to one that has them.
        trace = np.trace(information, axis1=1, axis2=2)
        covariance = np.linalg.inv(information + (1e-12 * trace + 1e-300)[:, None, None] * np.eye(3))
        shift = covariance @ (rows.transpose(0, 2, 1) @ residual.reshape(len(rows), -1, 1))
        residual = residual - (jacobian @ shift[:, None])[..., 0]
        along = (jacobian.reshape(rows.shape) @ covariance).reshape(jacobian.shape)
        share = (along[..., :, None, :] * jacobian[..., None, :, :]).sum(axis=-1)
        return LinearFit(used, residual, share)


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
        residuals = (inverse_2x2(inverse) @ self.residuals[..., None])[..., 0]
        return np.where(self.used[..., None], residuals, self.residuals), inverse


def inverse_2x2(symmetric: np.ndarray) -> np.ndarray:
    """Inverses of symmetric 2x2 matrices; large ones of singular ones."""
    determinant = symmetric[..., 0, 0] * symmetric[..., 1, 1] - symmetric[..., 0, 1] ** 2
    adjugate = np.trace(symmetric, axis1=-2, axis2=-1)[..., None, None] * np.eye(2) - symmetric
    return adjugate / np.maximum(determinant, 1e-9)[..., None, None]
