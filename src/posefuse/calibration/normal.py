"""The normal equations of a bundle adjustment, points eliminated from them (Schur complement)."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.parameters import LENS, N_PARAMETERS, SHIFT, TURN
from posefuse.calibration.sightings import Sightings
from posefuse.kernels import lens
from posefuse.kernels.bundle import LENS_PARAMETERS, bundle_rows
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
        weighted = self.by_point * self.weight[:, None, None]
        squares = self.by_point.transpose(0, 2, 1) @ weighted
        first = np.searchsorted(sightings.point, np.arange(sightings.n_points))
        root = _inverse_root(np.add.reduceat(squares, first, axis=0))[sightings.point]
        taken = root @ weighted.transpose(0, 2, 1)
        lost = np.einsum("nij,nij->n", taken, root @ self.by_point.transpose(0, 2, 1))
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
    """Normal equations in blocks.

    Attributes:
        cameras: shape (view, 9, 9).
        points: shape (point, 3, 3).
        mixed: shape (point, view, 9, 3), zero where a view does not see a point.
        camera_gradient: shape (point, view, 9): each point's part of it.
        point_gradient: shape (point, 3).
    """

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
        n, view, point = sightings.n_points, sightings.view, sightings.point
        flipped = rows.by_camera.transpose(0, 2, 1)
        root = np.sqrt(weight)[:, None, None]
        cameras = np.zeros((n_views, N_PARAMETERS, N_PARAMETERS))
        for v in range(n_views):
            block = (root[view == v] * rows.by_camera[view == v]).reshape(-1, N_PARAMETERS)
            cameras[v] = block.T @ block
        weighted = rows.by_point * weight[:, None, None]
        first = np.searchsorted(point, np.arange(n))
        points = np.add.reduceat(weighted.transpose(0, 2, 1) @ rows.by_point, first, axis=0)
        mixed = np.zeros((n, n_views, N_PARAMETERS, 3))
        mixed[point, view] = flipped @ weighted
        pulled = (rows.residual * rows.weight[:, None])[:, :, None]
        camera_gradient = np.zeros((n, n_views, N_PARAMETERS))
        camera_gradient[point, view] = (flipped @ pulled)[:, :, 0]
        point_gradient = np.add.reduceat((rows.by_point.transpose(0, 2, 1) @ pulled)[:, :, 0], first, axis=0)
        return cls(cameras, points, mixed, camera_gradient, point_gradient)

    def reduced(self, columns: np.ndarray, damping: float = 0.0) -> "Reduced":
        """Points eliminated.

        Args:
            columns: the free numbers among the cameras'.
            damping: the share by which the diagonals grow (Marquardt).
        """
        n = len(self.points)
        eye = np.arange(3)
        damped = self.points.copy()
        damped[:, eye, eye] *= 1.0 + damping
        root = _inverse_root(damped)
        mixed = self.mixed.reshape(n, -1, 3)[:, columns]
        # (point, 3, column): its square is what eliminating the point takes away.
        taken = root @ mixed.transpose(0, 2, 1)
        flat = taken.reshape(-1, len(columns))
        matrix = np.zeros((self.cameras.shape[0] * N_PARAMETERS,) * 2)
        for v, block in enumerate(self.cameras):
            at = slice(v * N_PARAMETERS, (v + 1) * N_PARAMETERS)
            matrix[at, at] = block
        matrix = matrix[np.ix_(columns, columns)]
        diagonal = np.arange(len(columns))
        matrix[diagonal, diagonal] *= 1.0 + damping
        moved = root @ self.point_gradient[:, :, None]
        scores = self.camera_gradient.reshape(n, -1)[:, columns] - (taken.transpose(0, 2, 1) @ moved)[:, :, 0]
        return Reduced(matrix - flat.T @ flat, scores, root, mixed)

    def points_step(self, reduced: "Reduced", step: np.ndarray) -> np.ndarray:
        """How the points go along with a step of the cameras' free numbers: shape (point, 3)."""
        right = -self.point_gradient - step @ reduced.mixed
        inner = reduced.root @ right[:, :, None]
        return (reduced.root.transpose(0, 2, 1) @ inner)[:, :, 0]


def _inverse_root(matrices: np.ndarray) -> np.ndarray:
    """Shape (n, 3, 3): R with R'R the inverse; nothing where a matrix says nothing."""
    values, vectors = np.linalg.eigh(matrices)
    sound = values > _TINY * values[:, -1:]
    inverse = np.where(sound, 1.0 / np.sqrt(np.where(sound, values, 1.0)), 0.0)
    return inverse[:, :, None] * vectors.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of the cameras alone.

    Attributes:
        matrix: shape (free, free), the Schur complement.
        scores: shape (point, free): each point's part of the gradient.
        root: shape (point, 3, 3), the inverse root of each point's matrix.
        mixed: shape (point, free, 3).
    """

    matrix: np.ndarray
    scores: np.ndarray
    root: np.ndarray
    mixed: np.ndarray
