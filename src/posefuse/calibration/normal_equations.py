"""Normal equations of a bundle adjustment, with the points eliminated (Schur complement)."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from posefuse.calibration.parameters import LENS, N_PARAMETERS, POSE, ROTATION, TRANSLATION
from posefuse.calibration.point_observations import PointObservations
from posefuse.kernels.calibration.bundle import DISTORTION, LENS_PARAMETERS, bundle_rows
from posefuse.kernels.cameras import lens
from posefuse.model.cameras import CameraRig

STUDENT_T_DOF = 4.0
"""Degrees of freedom of the Student-t distribution of errors; detectors have heavy tails."""

_UNSEEN = 1e8
_TINY = 1e-12
_MIN_SHARE = 0.05


class Observations(Protocol):
    """What the equations need to know of observations; those of one point, and of one view of it, are consecutive."""

    @property
    def view(self) -> np.ndarray:
        """Shape (observation,), int64."""
        ...

    @property
    def point(self) -> np.ndarray:
        """Shape (observation,), int64, ascending: index of the point, or of the pose of a board."""
        ...

    @property
    def n_points(self) -> int:
        """Number of points or poses."""
        ...


@dataclass(frozen=True, eq=False)
class Prior:
    """Hold a prior of the cameras at their current parameters.

    Attributes:
        gradient: shape (view, P): of the cost.
        matrices: shape (view, P, P): precision.
        cost: negative logarithm.
    """

    gradient: np.ndarray
    matrices: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class ResidualRows:
    """Hold residuals in units of the noise, and their derivatives.

    Attributes:
        residual: shape (observation, 2).
        by_camera: shape (observation, 2, P), of P parameters of a camera.
        by_point: shape (observation, 2, D): by the point in world coordinates, or by the pose of its board.
        squared: shape (observation,): squared residual; a large value where the camera cannot see the point.
        prior: prior of the cameras, or None.
        n_shared: number of parameters that all views share; they are the last ones of each camera.
    """

    residual: np.ndarray
    by_camera: np.ndarray
    by_point: np.ndarray
    squared: np.ndarray
    prior: Prior | None = None
    n_shared: int = 0

    @property
    def cost(self) -> float:
        """Return the negative log-likelihood, up to a constant."""
        cost = float(0.5 * (STUDENT_T_DOF + 2.0) * np.log1p(self.squared / STUDENT_T_DOF).sum())
        return cost if self.prior is None else cost + self.prior.cost

    def remaining_shares(self, observations: Observations) -> np.ndarray:
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


@dataclass(frozen=True, eq=False)
class RowParts:
    """Hold residuals in units of the noise and their derivatives, before they are arranged by parameters.

    Attributes:
        residual: shape (observation, 2).
        by_pose: shape (observation, 2, 6): by rotation and center of the camera.
        by_lens: shape (observation, 2, LENS_PARAMETERS).
        by_point: shape (observation, 2, 3): by the point in world coordinates.
        squared: shape (observation,): squared residual; a large value where the camera cannot see the point.
    """

    residual: np.ndarray
    by_pose: np.ndarray
    by_lens: np.ndarray
    by_point: np.ndarray
    squared: np.ndarray


def residual_rows(
    rig: CameraRig, view: np.ndarray, pixels: np.ndarray, points: np.ndarray, weight: np.ndarray
) -> RowParts:
    """Compute residuals and derivatives.

    Args:
        rig: the cameras.
        view: shape (observation,), int64.
        pixels: shape (observation, 2).
        points: shape (observation, 3): the observed points in the world.
        weight: shape (observation,): inverse standard deviation of each observation.
    """
    n = len(view)
    residual, by_point = np.empty((n, 2)), np.empty((n, 2, 3))
    by_lens, status = np.empty((n, 2, LENS_PARAMETERS)), np.empty(n, dtype=np.int64)
    bundle_rows(rig.packed, np.ascontiguousarray(view), points, pixels, residual, by_point, by_lens, status)
    unseen = status != lens.OK
    for array in (residual, by_point, by_lens):
        array[unseen] = 0.0
        array *= weight.reshape(-1, *(1,) * (array.ndim - 1))
    rotations = np.array([camera.rotation for camera in rig.cameras])[view]
    centers = np.array([camera.center_m for camera in rig.cameras])[view]
    camera_points = (rotations @ (points - centers)[:, :, None])[:, :, 0]
    in_world = by_point @ rotations
    by_pose = np.empty((n, 2, 6))
    # d(exp(w) x)/dw = -[x]x, so a row j of the derivative becomes x cross j.
    by_pose[:, :, ROTATION] = np.cross(camera_points[:, None], by_point)
    by_pose[:, :, TRANSLATION] = -in_world
    squared = np.where(unseen, _UNSEEN, np.einsum("ni,ni->n", residual, residual))
    return RowParts(residual, by_pose, by_lens, in_world, squared)


def compute_rows(
    rig: CameraRig, observations: PointObservations, points_m: np.ndarray, scale: np.ndarray
) -> ResidualRows:
    """Compute residuals and derivatives of observed points.

    Args:
        rig: the cameras.
        observations: of the points.
        points_m: shape (point, 3).
        scale: shape (view,): factor of each view's noise.
    """
    weight = 1.0 / (observations.sigma_px * scale[observations.view])
    parts = residual_rows(rig, observations.view, observations.pixels, points_m[observations.point], weight)
    by_camera = np.empty((len(weight), 2, N_PARAMETERS))
    by_camera[:, :, POSE] = parts.by_pose
    by_camera[:, :, LENS] = _focal_and_radial(rig, observations.view, parts.by_lens)
    return ResidualRows(parts.residual, by_camera, parts.by_point, parts.squared)


def _focal_and_radial(rig: CameraRig, view: np.ndarray, by_lens: np.ndarray) -> np.ndarray:
    """Return the derivatives by the logarithm of the focal length, k1 and k2, shape (observation, 2, 3)."""
    matrices = np.array([camera.matrix for camera in rig.cameras])[view]
    out = by_lens[:, :, DISTORTION - 1 : DISTORTION + 2].copy()
    out[:, :, 0] = by_lens[:, :, 0] * matrices[:, 0, 0, None] + by_lens[:, :, 1] * matrices[:, 1, 1, None]
    out[:, 0, 0] += matrices[:, 0, 1] * by_lens[:, 1, 1]
    return out


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Hold normal equations in blocks: one per camera, and one per point or pose of a board.

    Attributes:
        view: shape (pair,), int64: camera of each pair of a camera and a point that it observes.
        point: shape (pair,), int64, ascending: the point.
        cameras: shape (view, P, P), of P parameters.
        points: shape (point, D, D), of D coordinates: 3 of a point, 6 of a pose.
        mixed: shape (pair, D, P).
        camera_gradient: shape (pair, P): contribution of each pair.
        point_gradient: shape (point, D).
        prior_gradient: shape (view, P).
    """

    view: np.ndarray
    point: np.ndarray
    cameras: np.ndarray
    points: np.ndarray
    mixed: np.ndarray
    camera_gradient: np.ndarray
    point_gradient: np.ndarray
    prior_gradient: np.ndarray

    @classmethod
    def of(cls, rows: ResidualRows, observations: Observations, n_views: int, weight: np.ndarray) -> "NormalEquations":
        """Return the normal equations of weighted rows; gradients use the rows' own weights.

        Args:
            rows: residuals and derivatives.
            observations: their observations.
            n_views: number of views.
            weight: shape (observation,): weight of the squared derivatives.
        """
        root = np.sqrt(weight)[:, None, None]
        by_camera = root * rows.by_camera
        size = by_camera.shape[2]
        cameras = np.zeros((n_views, size, size))
        for v in range(n_views):
            block = by_camera[observations.view == v].reshape(-1, size)
            cameras[v] = block.T @ block
        by_point = (root * rows.by_point).transpose(0, 2, 1)
        points = _sum_by_point(by_point @ by_point.transpose(0, 2, 1), observations)
        weighted = rows.residual * rows.weight[:, None]
        camera_gradient = (weighted[:, None] @ rows.by_camera)[:, 0]
        point_gradient = _sum_by_point((weighted[:, None] @ rows.by_point)[:, 0], observations)
        starts = _pair_starts(observations)
        mixed = _sum_by_pair(by_point @ by_camera, starts)
        camera_gradient = _sum_by_pair(camera_gradient, starts)
        prior_gradient = np.zeros((n_views, size))
        if rows.prior is not None:
            cameras += rows.prior.matrices
            prior_gradient = rows.prior.gradient
        view, point = observations.view[starts], observations.point[starts]
        return cls(view, point, cameras, points, mixed, camera_gradient, point_gradient, prior_gradient)

    def reduced(self, columns: np.ndarray, damping: float = 0.0) -> "ReducedEquations":
        """Eliminate the points.

        Args:
            columns: indices of the free camera parameters.
            damping: relative increase of the diagonals (Marquardt).
        """
        (n, d), (n_views, p) = self.point_gradient.shape, self.cameras.shape[:2]
        size = n_views * p
        damped = self.points.copy()
        damped[:, np.arange(d), np.arange(d)] *= 1.0 + damping
        root = _inverse_root(damped)
        # Its square is the term that the elimination of the points subtracts.
        eliminated = np.zeros((n, d, n_views, p))
        eliminated[self.point, :, self.view] = root[self.point] @ self.mixed
        flat = eliminated.reshape(d * n, size)
        if len(columns) < size:
            flat = flat[:, columns]
        matrix = np.zeros((n_views, p, n_views, p))
        matrix[np.arange(n_views), :, np.arange(n_views)] = self.cameras
        matrix = matrix.reshape(size, size)[np.ix_(columns, columns)]
        matrix[np.diag_indices_from(matrix)] *= 1.0 + damping
        root_gradient = (root @ self.point_gradient[:, :, None])[:, :, 0]
        gradient = self.prior_gradient.copy()
        np.add.at(gradient, self.view, self.camera_gradient)
        return ReducedEquations(
            matrix - flat.T @ flat, gradient.ravel()[columns] - root_gradient.ravel() @ flat, root, flat, root_gradient
        )

    def scores(self, columns: np.ndarray, reduced: "ReducedEquations") -> np.ndarray:
        """Return each point's contribution to the reduced gradient, shape (point, free parameter)."""
        (n, d), (n_views, p) = self.point_gradient.shape, self.cameras.shape[:2]
        all_scores = np.zeros((n, n_views, p))
        all_scores[self.point, self.view] = self.camera_gradient
        eliminated = reduced.eliminated.reshape(n, d, len(columns))
        return all_scores.reshape(n, -1)[:, columns] - (reduced.point_gradient[:, None] @ eliminated)[:, 0]

    def points_step(self, reduced: "ReducedEquations", change: np.ndarray) -> np.ndarray:
        """Return the step of the points for a step of the cameras (view, P), shape (point, D)."""
        along = (self.mixed @ change[self.view][:, :, None])[:, :, 0]
        starts = np.searchsorted(self.point, np.arange(len(self.points)))
        right = -self.point_gradient - np.add.reduceat(along, starts, axis=0)
        inner = reduced.root @ right[:, :, None]
        return (reduced.root.transpose(0, 2, 1) @ inner)[:, :, 0]


def shared_columns(free: np.ndarray, n_shared: int) -> np.ndarray:
    """Return the free parameters of all views (rows) as a function of those that differ, shape (free, different).

    Args:
        free: shape (view, P), bool: free parameters; shared ones are free in all views or in none.
        n_shared: number of parameters that all views share; the last ones of P. They are the last columns.
    """
    view, parameter = np.nonzero(free)
    shared = parameter - (free.shape[1] - n_shared)
    own = shared < 0
    n_own = int(own.sum())
    used = np.unique(shared[~own])
    column = np.where(own, np.cumsum(own) - 1, n_own + np.searchsorted(used, shared))
    out = np.zeros((len(view), n_own + len(used)))
    out[np.arange(len(view)), column] = 1.0
    return out


def _sum_by_point(values: np.ndarray, observations: Observations) -> np.ndarray:
    """Return sums over the observations of each point; every point has consecutive observations."""
    return np.add.reduceat(values, np.searchsorted(observations.point, np.arange(observations.n_points)), axis=0)


def _pair_starts(observations: Observations) -> np.ndarray:
    """Return the first observation of each pair of a camera and a point, whose observations are consecutive."""
    is_new = np.ones(len(observations.view), dtype=bool)
    is_new[1:] = (np.diff(observations.point) != 0) | (np.diff(observations.view) != 0)
    return np.flatnonzero(is_new)


def _sum_by_pair(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return sums over the observations of each pair."""
    return values if len(starts) == len(values) else np.add.reduceat(values, starts, axis=0)


def _inverse_root(matrices: np.ndarray) -> np.ndarray:
    """Return R with R'R the inverse of each matrix, by Cholesky decomposition, shape (n, D, D).

    Directions that a matrix does not determine are 0.
    """
    d = matrices.shape[1]
    lower, out = np.zeros_like(matrices), np.zeros_like(matrices)
    min_pivot = _TINY * np.trace(matrices, axis1=1, axis2=2)
    for j in range(d):
        pivot = matrices[:, j, j] - (lower[:, j, :j] ** 2).sum(axis=1)
        is_determined = pivot > min_pivot
        inverse = np.where(is_determined, 1.0 / np.sqrt(np.where(is_determined, pivot, 1.0)), 0.0)
        for i in range(j + 1, d):
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
        root: shape (point, D, D): inverse root of each point's matrix.
        eliminated: shape (point * D, free): its square was subtracted.
        point_gradient: shape (point, D): roots times the points' gradients.
    """

    matrix: np.ndarray
    gradient: np.ndarray
    root: np.ndarray
    eliminated: np.ndarray
    point_gradient: np.ndarray
