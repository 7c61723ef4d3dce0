"""One camera and the points of known position in its image: the cost of its pose, and descent to its minimum."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.boards.parameters import LENS, N_PARAMETERS, POSE, changed, lens_values
from posefuse.calibration.normal_equations import residual_rows
from posefuse.model.cameras import Camera, CameraRig

STUDENT_T_DOF = 4.0
_MAX_STEPS = 60


@dataclass(frozen=True, eq=False)
class KnownLens:
    """The lens of a camera.

    Attributes:
        camera: the camera; its pose is ignored.
        covariance: shape (12, 12): of fx, fy, cx, cy and eight distortion coefficients; None if the lens is fixed.
    """

    camera: Camera
    covariance: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SceneView:
    """A camera and the points that it shows, with the precision of its lens around its first value.

    Attributes:
        camera: the camera.
        points_m: shape (point, 3): the points that it shows.
        pixels: shape (point, 2): their places in its image.
        free: shape (19,), bool: parameters that are estimated.
        precision: shape (19, 19): inverse covariance of the lens.
        start: shape (19,): parameters of the lens that the precision belongs to.
    """

    camera: Camera
    points_m: np.ndarray
    pixels: np.ndarray
    free: np.ndarray
    precision: np.ndarray
    start: np.ndarray

    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (point, 2) in px and derivatives (point, 2, 19)."""
        n = len(self.points_m)
        rig = CameraRig((self.camera,))
        parts = residual_rows(rig, np.zeros(n, dtype=np.int64), self.pixels, self.points_m, np.ones(n))
        derivatives = np.zeros((n, 2, N_PARAMETERS))
        derivatives[:, :, POSE], derivatives[:, :, LENS] = parts.by_pose, parts.by_lens
        residual = np.where((parts.squared > 1e7)[:, None], self.camera.size_px[0], parts.residual)
        return residual, derivatives

    def cost(self, scale_px: float) -> float:
        """Return the negative log-posterior, up to a constant."""
        squared = (self.rows()[0] ** 2).sum(axis=1) / scale_px**2
        away = lens_values(self.camera) - self.start
        return float(
            0.5 * (STUDENT_T_DOF + 2.0) * np.log1p(squared / STUDENT_T_DOF).sum() + 0.5 * away @ self.precision @ away
        )


def view_of(lens: KnownLens, points_m: np.ndarray, pixels: np.ndarray) -> SceneView:
    """Return the view of a camera whose pose and estimated lens parameters are free."""
    free = np.zeros(N_PARAMETERS, dtype=bool)
    free[POSE] = True
    precision = np.zeros((N_PARAMETERS, N_PARAMETERS))
    if lens.covariance is not None:
        at = LENS.start + np.flatnonzero(np.diag(lens.covariance) > 0.0)
        free[at] = True
        inside = at - LENS.start
        precision[np.ix_(at, at)] = np.linalg.pinv(lens.covariance[np.ix_(inside, inside)], rcond=1e-14, hermitian=True)
    return SceneView(lens.camera, points_m, pixels, free, precision, lens_values(lens.camera))


def errors_px(view: SceneView) -> np.ndarray:
    """Return the distances between projected and measured points, shape (point,)."""
    return np.linalg.norm(view.rows()[0], axis=1)


def weighted_normal(view: SceneView, scale_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the weighted normal matrix and gradient of the free parameters."""
    residual, derivatives = view.rows()
    weight = (STUDENT_T_DOF + 2.0) / (STUDENT_T_DOF + (residual**2).sum(axis=1) / scale_px**2) / scale_px**2
    free = view.free
    by_free = derivatives[:, :, free]
    matrix = np.einsum("n,nij,nik->jk", weight, by_free, by_free) + view.precision[np.ix_(free, free)]
    away = lens_values(view.camera) - view.start
    return matrix, np.einsum("n,nij,ni->j", weight, by_free, residual) + (view.precision @ away)[free]


def covariance_of(view: SceneView, sd_px: float) -> np.ndarray:
    """Return the covariance of the free parameters for places of a standard deviation, shape (free, free)."""
    by_free = view.rows()[1][:, :, view.free]
    matrix = np.einsum("nij,nik->jk", by_free, by_free) / sd_px**2 + view.precision[np.ix_(view.free, view.free)]
    return np.linalg.pinv(matrix, rcond=1e-14, hermitian=True)


def descend(view: SceneView, scale_px: float) -> SceneView:
    """Run Levenberg-Marquardt at a fixed scale of the errors."""
    damping, cost = 1e-3, view.cost(scale_px)
    for _ in range(_MAX_STEPS):
        matrix, gradient = weighted_normal(view, scale_px)
        damped = matrix + damping * np.diag(np.diag(matrix))
        change = np.zeros(N_PARAMETERS)
        change[view.free] = np.linalg.lstsq(damped, -gradient, rcond=1e-14)[0]
        candidate = replace(view, camera=changed(view.camera, change))
        new_cost = candidate.cost(scale_px)
        if new_cost < cost:
            gain, view, cost, damping = cost - new_cost, candidate, new_cost, max(damping / 5.0, 1e-9)
            if gain < 1e-10 * (1.0 + cost):
                break
        elif damping > 1e8:
            break
        else:
            damping *= 5.0
    return view
