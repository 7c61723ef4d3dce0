"""The normal equations of a bundle adjustment, points eliminated from them (Schur complement)."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.parameters import LENS, N_PARAMETERS, SHIFT, TURN
from posefuse.calibration.sightings import Sightings
from posefuse.kernels.calibration.bundle import LENS_PARAMETERS, bundle_rows
from posefuse.kernels.cameras import lens
from posefuse.model.cameras import CameraRig

NU = 4.0
"""Degrees of freedom of the Student t that errors are taken to follow: detectors' tails are heavy."""

_UNSEEN = 1e8
_TINY = 1e-12
_LEAST_FREEDOM = 0.05


@dataclass(frozen=True, eq=False)
class Rows:
    """Residuals in units of the noise, and their derivatives.

    Attributes:
        residual: shape (observation, 2).
        by_camera: shape (observation, 2, 9).
        by_point: shape (observation, 2, 3): by the point in the world.
        squared: shape (observation,): the squared residual; a great one where the camera cannot see the point.
    """

    residual: np.ndarray
    by_camera: np.ndarray
    by_point: np.ndarray
    squared: np.ndarray

    @property
    def cost(self) -> float:
        """Minus the logarithm of the likelihood, up to a constant."""
        return float(0.5 * (NU + 2.0) * np.log1p(self.squared / NU).sum())

    def freedom(self, sightings: Sightings) -> np.ndarray:
        """Shape (observation,): the share of an error that is left in its residual once points were fitted to it."""
        flipped = self.by_point.transpose(0, 2, 1)
        squares = flipped @ (self.by_point * self.weight[:, None, None])
        taken = _inverse_root(_by_point(squares, sightings))[sightings.point] @ flipped
        lost = self.weight * (taken**2).sum(axis=(1, 2))
        return np.clip(1.0 - 0.5 * lost, _LEAST_FREEDOM, 1.0)

    @property
    def weight(self) -> np.ndarray:
        """Shape (observation,): how much each counts, by its residual."""
        return (NU + 2.0) / (NU + self.squared)

    @property
    def curvature(self) -> np.ndarray:
        """Shape (observation,): the mean second derivative of the cost, which is less than the weight."""
        return (NU + 2.0) * NU / (NU + self.squared) ** 2


def rows_of(rig: CameraRig, sightings: Sightings, points_m: np.ndarray, scale: np.ndarray) -> Rows:
    """Residuals and derivatives.

    Args:
        rig: the cameras.
        sightings: the observations.
        points_m: shape (point, 3).
        scale: shape (view,): factor of each view's noise.
    """
    n = len(sightings.view)
    residual, by_point = np.empty((n, 2)), np.empty((n, 2, 3))
    by_lens, status = np.empty((n, 2, LENS_PARAMETERS)), np.empty(n, dtype=np.int64)
    where = points_m[sightings.point]
    bundle_rows(rig.packed[0], sightings.view, where, sightings.pixels, residual, by_point, by_lens, status)
    weight = 1.0 / (sightings.sigma_px * scale[sightings.view])
    unseen = status != lens.OK
    for array in (residual, by_point, by_lens):
        array[unseen] = 0.0
        array *= weight.reshape(-1, *(1,) * (array.ndim - 1))
    turns = np.array([camera.rotation for camera in rig.cameras])[sightings.view]
    centres = np.array([camera.centre_m for camera in rig.cameras])[sightings.view]
    at = (turns @ (where - centres)[:, :, None])[:, :, 0]
    in_world = by_point @ turns
    by_camera = np.empty((n, 2, N_PARAMETERS))
    # d(exp(w) x)/dw = -[x]x, so that a row j of the derivative becomes x cross j.
    by_camera[:, :, TURN] = np.cross(at[:, None], by_point)
    by_camera[:, :, SHIFT] = -in_world
    by_camera[:, :, LENS] = by_lens
    squared = np.where(unseen, _UNSEEN, np.einsum("ni,ni->n", residual, residual))
    return Rows(residual, by_camera, in_world, squared)


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations in blocks; observations are those of some sightings.

    Attributes:
        sightings: whose they are.
        cameras: shape (view, 9, 9).
        points: shape (point, 3, 3).
        mixed: shape (observation, 3, 9).
        camera_gradient: shape (observation, 9): each observation's part of it.
        point_gradient: shape (point, 3).
    """

    sightings: Sightings
    cameras: np.ndarray
    points: np.ndarray
    mixed: np.ndarray
    camera_gradient: np.ndarray
    point_gradient: np.ndarray

    @classmethod
    def of(cls, rows: Rows, sightings: Sightings, n_views: int, weight: np.ndarray) -> "Normal":
        """The normal equations of weighted rows; gradients have the rows' own weight.

        Args:
            rows: residuals and derivatives.
            sightings: whose they are.
            n_views: how many views there are.
            weight: shape (observation,), of the squares of derivatives.
        """
        root = np.sqrt(weight)[:, None, None]
        by_camera = root * rows.by_camera
        cameras = np.zeros((n_views, N_PARAMETERS, N_PARAMETERS))
        for v in range(n_views):
            block = by_camera[sightings.view == v].reshape(-1, N_PARAMETERS)
            cameras[v] = block.T @ block
        by_point = (root * rows.by_point).transpose(0, 2, 1)
        points = _by_point(by_point @ by_point.transpose(0, 2, 1), sightings)
        pulled = rows.residual * rows.weight[:, None]
        camera_gradient = (pulled[:, None] @ rows.by_camera)[:, 0]
        point_gradient = _by_point((pulled[:, None] @ rows.by_point)[:, 0], sightings)
        return cls(sightings, cameras, points, by_point @ by_camera, camera_gradient, point_gradient)

    def reduced(self, columns: np.ndarray, damping: float = 0.0) -> "Reduced":
        """Points eliminated.

        Args:
            columns: the free numbers among the cameras'.
            damping: the share by which the diagonals grow (Marquardt).
        """
        n, n_views = len(self.points), len(self.cameras)
        size, view, point = n_views * N_PARAMETERS, self.sightings.view, self.sightings.point
        damped = self.points.copy()
        damped[:, np.arange(3), np.arange(3)] *= 1.0 + damping
        root = _inverse_root(damped)
        # Its square is what eliminating the points takes away.
        taken = np.zeros((n, 3, n_views, N_PARAMETERS))
        taken[point, :, view] = root[point] @ self.mixed
        flat = taken.reshape(3 * n, size)
        if len(columns) < size:
            flat = flat[:, columns]
        matrix = np.zeros((n_views, N_PARAMETERS, n_views, N_PARAMETERS))
        matrix[np.arange(n_views), :, np.arange(n_views)] = self.cameras
        matrix = matrix.reshape(size, size)[np.ix_(columns, columns)]
        matrix[np.diag_indices_from(matrix)] *= 1.0 + damping
        moved = (root @ self.point_gradient[:, :, None])[:, :, 0]
        gradient = np.zeros((n_views, N_PARAMETERS))
        np.add.at(gradient, view, self.camera_gradient)
        return Reduced(matrix - flat.T @ flat, gradient.ravel()[columns] - moved.ravel() @ flat, root, flat, moved)

    def scores(self, columns: np.ndarray, reduced: "Reduced") -> np.ndarray:
        """Shape (point, free): each point's part of the reduced gradient."""
        n, n_views = len(self.points), len(self.cameras)
        whole = np.zeros((n, n_views, N_PARAMETERS))
        whole[self.sightings.point, self.sightings.view] = self.camera_gradient
        taken = reduced.taken.reshape(n, 3, len(columns))
        return whole.reshape(n, -1)[:, columns] - (reduced.moved[:, None] @ taken)[:, 0]

    def points_step(self, reduced: "Reduced", change: np.ndarray) -> np.ndarray:
        """How the points go along with a change of the cameras, shape (view, 9): shape (point, 3)."""
        along = (self.mixed @ change[self.sightings.view][:, :, None])[:, :, 0]
        right = -self.point_gradient - _by_point(along, self.sightings)
        inner = reduced.root @ right[:, :, None]
        return (reduced.root.transpose(0, 2, 1) @ inner)[:, :, 0]


def _by_point(values: np.ndarray, sightings: Sightings) -> np.ndarray:
    """Sums over the observations of each point; all points have some, one after the other."""
    return np.add.reduceat(values, np.searchsorted(sightings.point, np.arange(sightings.n_points)), axis=0)


def _inverse_root(matrices: np.ndarray) -> np.ndarray:
    """Shape (n, 3, 3): R with R'R the inverse, by Cholesky; nothing in directions of which a matrix says nothing."""
    lower, out = np.zeros_like(matrices), np.zeros_like(matrices)
    least = _TINY * np.trace(matrices, axis1=1, axis2=2)
    for j in range(3):
        pivot = matrices[:, j, j] - (lower[:, j, :j] ** 2).sum(axis=1)
        sound = pivot > least
        inverse = np.where(sound, 1.0 / np.sqrt(np.where(sound, pivot, 1.0)), 0.0)
        for i in range(j + 1, 3):
            lower[:, i, j] = (matrices[:, i, j] - (lower[:, i, :j] * lower[:, j, :j]).sum(axis=1)) * inverse
        # A row of the inverse of the lower triangle, from those above it.
        out[:, j, j] = inverse
        for k in range(j):
            out[:, j, k] = -(lower[:, j, k:j] * out[:, k:j, k]).sum(axis=1) * inverse
    return out


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of the cameras alone.

    Attributes:
        matrix: shape (free, free), the Schur complement.
        gradient: shape (free,).
        root: shape (point, 3, 3), the inverse root of each point's matrix.
        taken: shape (point * 3, free), whose square was taken away.
        moved: shape (point, 3), the roots times the points' gradients.
    """

    matrix: np.ndarray
    gradient: np.ndarray
    root: np.ndarray
    taken: np.ndarray
    moved: np.ndarray
