"""Poses of cameras from points of known position.

Each camera's pose minimizes the Student-t cost of its reprojection errors by Levenberg-Marquardt steps. An estimated
lens moves within the covariance of its estimate (maximum a posteriori), so that its uncertainty is part of the pose's.
The noise of the places in the images is estimated from all cameras together.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.boards.parameters import (
    LENS,
    N_PARAMETERS,
    OFFSET,
    POSE,
    changed,
    lens_values,
)
from posefuse.calibration.normal_equations import residual_rows
from posefuse.calibration.scene.first_pose import MIN_POINTS, distant_poses, first_poses, lie_on_a_line
from posefuse.calibration.stated_covariance import largest_sd
from posefuse.errors import CalibrationError
from posefuse.model.camera_covariance import CameraCovariance, parameter_names
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.scene_points import ScenePoints

_DOF = 4.0
_CLICK_PX = 1.0
"""Expected error of a place that was measured in an image; it counts as four observations."""

_MAX_STEPS = 60
_SCALE_STEPS = 4
_START_PX = 20.0
_MAX_SHARE = 0.02
"""Errors above this share of the image's width are those of a wrong pose or of wrong points."""


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
class SceneCameraReport:
    """How well one camera is calibrated.

    Attributes:
        name: name of the camera.
        n_points: number of points that it shows.
        error_px: root mean square distance between projected and measured points.
        rotation_sd_deg: standard deviation of the rotation, in the worst direction.
        center_sd_m: standard deviation of the position, in the worst direction.
        lens_given: whether the lens was given and not estimated.
    """

    name: str
    n_points: int
    error_px: float
    rotation_sd_deg: float
    center_sd_m: float
    lens_given: bool


@dataclass(frozen=True, eq=False)
class SceneCalibration:
    """Result of a calibration by points of known position.

    Attributes:
        rig: the cameras in the world of the points, with their covariance.
        cameras: one report per camera, in the order of the rig.
        sd_px: estimated standard deviation of a measured place, per coordinate.
        error_px: root mean square distance between projected and measured points of all cameras.
        left_out: names of cameras that show too few points, with the reason.
    """

    rig: CameraRig
    cameras: tuple[SceneCameraReport, ...]
    sd_px: float
    error_px: float
    left_out: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class _View:
    """A camera and the points that it shows, with the precision of its lens around its first value."""

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

    def cost(self, sd_px: float) -> float:
        """Return the negative log-posterior, up to a constant."""
        squared = (self.rows()[0] ** 2).sum(axis=1) / sd_px**2
        away = lens_values(self.camera) - self.start
        return float(0.5 * (_DOF + 2.0) * np.log1p(squared / _DOF).sum() + 0.5 * away @ self.precision @ away)


def calibrate_by_scene(lenses: tuple[KnownLens, ...], scene: ScenePoints) -> SceneCalibration:
    """Estimate the poses of cameras from points of known position.

    Args:
        lenses: the cameras with known lenses; their names are those of the points' images.
        scene: the points.

    Raises:
        CalibrationError: if no camera shows enough points, or a camera's points agree with no pose.
    """
    views: list[_View] = []
    used: list[KnownLens] = []
    left_out: list[tuple[str, str]] = []
    for lens in lenses:
        pixels = scene.pixels[lens.camera.name]
        seen = np.isfinite(pixels).all(axis=1)
        reason = _too_few(scene.points_m[seen])
        if reason:
            left_out.append((lens.camera.name, reason))
            continue
        views.append(_first(_view(lens, scene.points_m[seen], pixels[seen])))
        used.append(lens)
    if not views:
        raise CalibrationError(
            f"No camera can be located: {left_out[0][0]!r} {left_out[0][1]}. Measure at least {MIN_POINTS} points in "
            "the image of each camera, spread over the image and not on a line."
        )
    sd_px = _START_PX
    for _ in range(_SCALE_STEPS):
        views = [_descend(view, sd_px) for view in views]
        sd_px = _noise(views, sd_px)
    return _summary([_descend(view, sd_px) for view in views], used, sd_px, scene, tuple(left_out))


def _too_few(points_m: np.ndarray) -> str:
    """Return why points do not determine a pose, or an empty text."""
    if len(points_m) < MIN_POINTS:
        return f"shows {len(points_m)} of the points, at least {MIN_POINTS} are needed"
    return "shows only points on one line" if lie_on_a_line(points_m) else ""


def _view(lens: KnownLens, points_m: np.ndarray, pixels: np.ndarray) -> _View:
    free = np.zeros(N_PARAMETERS, dtype=bool)
    free[POSE] = True
    precision = np.zeros((N_PARAMETERS, N_PARAMETERS))
    if lens.covariance is not None:
        at = LENS.start + np.flatnonzero(np.diag(lens.covariance) > 0.0)
        free[at] = True
        inside = at - LENS.start
        precision[np.ix_(at, at)] = np.linalg.pinv(lens.covariance[np.ix_(inside, inside)], rcond=1e-14, hermitian=True)
    return _View(lens.camera, points_m, pixels, free, precision, lens_values(lens.camera))


def _first(view: _View) -> _View:
    """Return the view at the best initial pose.

    Raises:
        CalibrationError: if no pose agrees with the points.
    """
    most = _MAX_SHARE * max(view.camera.size_px)
    best: tuple[float, _View] | None = None
    for starts in (first_poses, lambda camera, points_m, _: distant_poses(camera, points_m)):
        for camera in starts(view.camera, view.points_m, view.pixels):
            candidate = replace(view, camera=camera)
            for sd_px in (10.0 * _START_PX, _START_PX):
                candidate = _descend(candidate, sd_px)
            cost = candidate.cost(_START_PX)
            if best is None or cost < best[0]:
                best = cost, candidate
        if best is not None and float(np.median(_errors_px(best[1]))) < most:
            return best[1]
    error = float("inf") if best is None else float(np.median(_errors_px(best[1])))
    raise CalibrationError(
        f"The scene points in the image of camera {view.camera.name!r} agree with no pose of the camera (median error "
        f"{error:.0f} px). Check the order of the points, their positions in meters, and the camera's lens."
    )


def _errors_px(view: _View) -> np.ndarray:
    return np.linalg.norm(view.rows()[0], axis=1)


def _normal(view: _View, sd_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the weighted normal matrix and gradient of the free parameters."""
    residual, derivatives = view.rows()
    weight = (_DOF + 2.0) / (_DOF + (residual**2).sum(axis=1) / sd_px**2) / sd_px**2
    free = view.free
    by_free = derivatives[:, :, free]
    matrix = np.einsum("n,nij,nik->jk", weight, by_free, by_free) + view.precision[np.ix_(free, free)]
    away = lens_values(view.camera) - view.start
    return matrix, np.einsum("n,nij,ni->j", weight, by_free, residual) + (view.precision @ away)[free]


def _descend(view: _View, sd_px: float) -> _View:
    """Run Levenberg-Marquardt at a fixed noise."""
    damping, cost = 1e-3, view.cost(sd_px)
    for _ in range(_MAX_STEPS):
        matrix, gradient = _normal(view, sd_px)
        damped = matrix + damping * np.diag(np.diag(matrix))
        change = np.zeros(N_PARAMETERS)
        change[view.free] = np.linalg.lstsq(damped, -gradient, rcond=1e-14)[0]
        candidate = replace(view, camera=changed(view.camera, change))
        new_cost = candidate.cost(sd_px)
        if new_cost < cost:
            gain, view, cost, damping = cost - new_cost, candidate, new_cost, max(damping / 5.0, 1e-9)
            if gain < 1e-10 * (1.0 + cost):
                break
        elif damping > 1e8:
            break
        else:
            damping *= 5.0
    return view


def _noise(views: list[_View], sd_px: float) -> float:
    """Return the standard deviation of a coordinate, from the weighted residuals of all cameras."""
    total, count = 4.0 * _CLICK_PX**2, 4.0
    for view in views:
        squared = (view.rows()[0] ** 2).sum(axis=1)
        weight = (_DOF + 2.0) / (_DOF + squared / sd_px**2)
        total += float((weight * squared).sum())
        count += 2.0 * len(squared) - 6.0
    return float(np.sqrt(total / count))


def _summary(
    views: list[_View],
    used: list[KnownLens],
    sd_px: float,
    scene: ScenePoints,
    left_out: tuple[tuple[str, str], ...],
) -> SceneCalibration:
    """Return the calibration with its accuracy."""
    reports, covariances = [], []
    for view, lens in zip(views, used, strict=True):
        covariance = np.linalg.pinv(_normal(view, sd_px)[0], rcond=1e-14, hermitian=True)
        worst = [largest_sd(covariance[k : k + 3, k : k + 3]) for k in (0, 3)]
        errors = _errors_px(view)
        reports.append(
            SceneCameraReport(
                name=view.camera.name,
                n_points=len(errors),
                error_px=float(np.sqrt(np.mean(errors**2))),
                rotation_sd_deg=float(np.degrees(worst[0])),
                center_sd_m=worst[1],
                lens_given=lens.covariance is None,
            )
        )
        covariances.append(_stated(view, covariance))
    all_errors = np.concatenate([_errors_px(view) for view in views])
    rig = CameraRig(
        tuple(view.camera for view in views),
        scene.up_axis,
        left_out=tuple(name for name, _ in left_out),
        covariances=tuple(covariances),
    )
    return SceneCalibration(rig, tuple(reports), sd_px, float(np.sqrt(np.mean(all_errors**2))), left_out)


def _stated(view: _View, covariance: np.ndarray) -> CameraCovariance:
    """Return the covariance with the shifts of the center along the camera's axes."""
    all_names = parameter_names(view.camera.lens)
    used = np.flatnonzero(view.free[:OFFSET])
    turn = np.eye(len(used))
    turn[3:6, 3:6] = view.camera.rotation
    matrix = turn @ covariance @ turn.T
    parameters = tuple(all_names[i] for i in used)
    return CameraCovariance(view.camera.name, parameters, 0.5 * (matrix + matrix.T), "the scene points")
