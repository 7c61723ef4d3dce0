"""Normal equations of a bundle adjustment, with the points eliminated (Schur complement)."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.parameters import LENS, N_PARAMETERS, ROTATION, TRANSLATION
from posefuse.calibration.point_observations import PointObservations
from posefuse.kernels.calibration.bundle import LENS_PARAMETERS, bundle_rows
from posefuse.kernels.cameras import lens
from posefuse.model.cameras import CameraRig

STUDENT_T_DOF = 4.0
"""Degrees of freedom of the Student-t distribution of errors; detectors have heavy tails."""

_UNSEEN = 1e8
_TINY = 1e-12
_MIN_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class ResidualRows:
    """Hold residuals in units of the noise, and their derivatives.

    Attributes:
        residual: shape (observation, 2).
        by_camera: shape (observation, 2, 9).
        by_point: shape (observation, 2, 3): by the point in world coordinates.
        squared: shape (observation,): squared residual; a large value where the camera cannot see the point.
    """

    residual: np.ndarray
    by_camera: np.ndarray
    by_point: np.ndarray
    squared: np.ndarray

    @property
    def cost(self) -> float:
        """Return the negative log-likelihood, up to a constant."""
        return float(0.5 * (STUDENT_T_DOF + 2.0) * np.log1p(self.squared / STUDENT_T_DOF).sum())

    def remaining_shares(self, observations: PointObservations) -> np.ndarray:
        """Return the share of each error that remains in its residual, shape (observation,).

        Fitting the points to the observations absorbs the rest.
        """
        flipped = self.by_point.transpose(0, 2, 1)
        squares = flipped @ (self.by_point * self.weight[:, None, None])
        eliminated = _inverse_root(_sum_by_point(squares, observations))[observations.point] @ flipped
        absorbed = self.weight * (eliminated**2).sum(axis=(1, 2))
        return np.clip(1.0 - 0.5 * absorbed, _MIN_SHARE, 1.0)

    @property
    def weight(self) -> np.ndarray:
        """Return the weight of each observation by its residual, shape (observation,)."""
        return (STUDENT_T_DOF + 2.0) / (STUDENT_T_DOF + self.squared)

    @property
    def curvature(self) -> np.ndarray:
        """Return the mean second derivative of the cost, shape (observation,); it is less than the weight."""
        return (STUDENT_T_DOF + 2.0) * STUDENT_T_DOF / (STUDENT_T_DOF + self.squared) ** 2


def compute_rows(
    rig: CameraRig, observations: PointObservations, points_m: np.ndarray, scale: np.ndarray
) -> ResidualRows:
    """Compute residuals and derivatives.

    Args:
        rig: the cameras.
        observations: of the points.
        points_m: shape (point, 3).
        scale: shape (view,): factor of each view's noise.
    """
    n = len(observations.view)
    residual, by_point = np.empty((n, 2)), np.empty((n, 2, 3))
    by_lens, status = np.empty((n, 2, LENS_PARAMETERS)), np.empty(n, dtype=np.int64)
    points = points_m[observations.point]
    bundle_rows(rig.packed.array, observations.view, points, observations.pixels, residual, by_point, by_lens, status)
    weight = 1.0 / (observations.sigma_px * scale[observations.view])
    unseen = status != lens.OK
    for array in (residual, by_point, by_lens):
        array[unseen] = 0.0
        array *= weight.reshape(-1, *(1,) * (array.ndim - 1))
    rotations = np.array([camera.rotation for camera in rig.cameras])[observations.view]
    centers = np.array([camera.center_m for camera in rig.cameras])[observations.view]
    camera_points = (rotations @ (points - centers)[:, :, None])[:, :, 0]
    in_world = by_point @ rotations
    by_camera = np.empty((n, 2, N_PARAMETERS))
    # d(exp(w) x)/dw = -[x]x, so a row j of the derivative becomes x cross j.
    by_camera[:, :, ROTATION] = np.cross(camera_points[:, None], by_point)
    by_camera[:, :, TRANSLATION] = -in_world
    by_camera[:, :, LENS] = by_lens
    squared = np.where(unseen, _UNSEEN, np.einsum("ni,ni->n", residual, residual))
    return ResidualRows(residual, by_camera, in_world, squared)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Hold normal equations in blocks.

    Attributes:
        observations: their observations.
        cameras: shape (view, 9, 9).
        points: shape (point, 3, 3).
        mixed: shape (observation, 3, 9).
        camera_gradient: shape (observation, 9): contribution of each observation.
        point_gradient: shape (point, 3).
    """

    observations: PointObservations
    cameras: np.ndarray
    points: np.ndarray
    mixed: np.ndarray
    camera_gradient: np.ndarray
    point_gradient: np.ndarray

    @classmethod
    def of(
        cls, rows: ResidualRows, observations: PointObservations, n_views: int, weight: np.ndarray
    ) -> "NormalEquations":
        """Return the normal equations of weighted rows; gradients use the rows' own weights.

        Args:
            rows: residuals and derivatives.
            observations: their observations.
            n_views: number of views.
            weight: shape (observation,): weight of the squared derivatives.
        """
        root = np.sqrt(weight)[:, None, None]
        by_camera = root * rows.by_camera
        cameras = np.zeros((n_views, N_PARAMETERS, N_PARAMETERS))
        for v in range(n_views):
            block = by_camera[observations.view == v].reshape(-1, N_PARAMETERS)
            cameras[v] = block.T @ block
        by_point = (root * rows.by_point).transpose(0, 2, 1)
        points = _sum_by_point(by_point @ by_point.transpose(0, 2, 1), observations)
        weighted = rows.residual * rows.weight[:, None]
        camera_gradient = (weighted[:, None] @ rows.by_camera)[:, 0]
        point_gradient = _sum_by_point((weighted[:, None] @ rows.by_point)[:, 0], observations)
        return cls(observations, cameras, points, by_point @ by_camera, camera_gradient, point_gradient)

    def reduced(self, columns: np.ndarray, damping: float = 0.0) -> "ReducedEquations":
        """Eliminate the points.

        Args:
            columns: indices of the free camera parameters.
            damping: relative increase of the diagonals (Marquardt).
        """
        n, n_views = len(self.points), len(self.cameras)
        size, view, point = n_views * N_PARAMETERS, self.observations.view, self.observations.point
        damped = self.points.copy()
        damped[:, np.arange(3), np.arange(3)] *= 1.0 + damping
        root = _inverse_root(damped)
        # Its square is the term that the elimination of the points subtracts.
        eliminated = np.zeros((n, 3, n_views, N_PARAMETERS))
        eliminated[point, :, view] = root[point] @ self.mixed
        flat = eliminated.reshape(3 * n, size)
        if len(columns) < size:
            flat = flat[:, columns]
        matrix = np.zeros((n_views, N_PARAMETERS, n_views, N_PARAMETERS))
        matrix[np.arange(n_views), :, np.arange(n_views)] = self.cameras
        matrix = matrix.reshape(size, size)[np.ix_(columns, columns)]
        matrix[np.diag_indices_from(matrix)] *= 1.0 + damping
        root_gradient = (root @ self.point_gradient[:, :, None])[:, :, 0]
        gradient = np.zeros((n_views, N_PARAMETERS))
        np.add.at(gradient, view, self.camera_gradient)
        return ReducedEquations(
            matrix - flat.T @ flat, gradient.ravel()[columns] - root_gradient.ravel() @ flat, root, flat, root_gradient
        )

    def scores(self, columns: np.ndarray, reduced: "ReducedEquations") -> np.ndarray:
        """Return each point's contribution to the reduced gradient, shape (point, free parameter)."""
        n, n_views = len(self.points), len(self.cameras)
        all_scores = np.zeros((n, n_views, N_PARAMETERS))
        all_scores[self.observations.point, self.observations.view] = self.camera_gradient
        eliminated = reduced.eliminated.reshape(n, 3, len(columns))
        return all_scores.reshape(n, -1)[:, columns] - (reduced.point_gradient[:, None] @ eliminated)[:, 0]

    def points_step(self, reduced: "ReducedEquations", change: np.ndarray) -> np.ndarray:
        """Return the step of the points for a step of the cameras (view, 9), shape (point, 3)."""
        along = (self.mixed @ change[self.observations.view][:, :, None])[:, :, 0]
        right = -self.point_gradient - _sum_by_point(along, self.observations)
        inner = reduced.root @ right[:, :, None]
        return (reduced.root.transpose(0, 2, 1) @ inner)[:, :, 0]


def _sum_by_point(values: np.ndarray, observations: PointObservations) -> np.ndarray:
    """Return sums over the observations of each point; every point has consecutive observations."""
    return np.add.reduceat(values, np.searchsorted(observations.point, np.arange(observations.n_points)), axis=0)


def _inverse_root(matrices: np.ndarray) -> np.ndarray:
    """Return R with R'R the inverse of each matrix, by Cholesky decomposition, shape (n, 3, 3).

    Directions that a matrix does not determine are 0.
    """
    lower, out = np.zeros_like(matrices), np.zeros_like(matrices)
    min_pivot = _TINY * np.trace(matrices, axis1=1, axis2=2)
    for j in range(3):
        pivot = matrices[:, j, j] - (lower[:, j, :j] ** 2).sum(axis=1)
        is_determined = pivot > min_pivot
        inverse = np.where(is_determined, 1.0 / np.sqrt(np.where(is_determined, pivot, 1.0)), 0.0)
        for i in range(j + 1, 3):
            lower[:, i, j] = (matrices[:, i, j] - (lower[:, i, :j] * lower[:, j, :j]).sum(axis=1)) * inverse
        # A row of the inverse of the lower triangle, from those above it.
        out[:, j, j] = inverse
        for k in range(j):
            out[:, j, k] = -(lower[:, j, k:j] * out[:, k:j, k]).sum(axis=1) * inverse
    return out


@dataclass(frozen=True, eq=False)
class ReducedEquations:
    """Hold the normal equations of the cameras alone.

    Attributes:
        matrix: shape (free, free): Schur complement.
        gradient: shape (free,).
        root: shape (point, 3, 3): inverse root of each point's matrix.
        eliminated: shape (point * 3, free): its square was subtracted.
        point_gradient: shape (point, 3): roots times the points' gradients.
    """

    matrix: np.ndarray
    gradient: np.ndarray
    root: np.ndarray
    eliminated: np.ndarray
    point_gradient: np.ndarray
