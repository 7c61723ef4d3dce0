"""Poses of cameras from points of known position.

Each camera's pose minimizes the Student-t cost of its reprojection errors by Levenberg-Marquardt steps. An estimated
lens moves within the covariance of its estimate (maximum a posteriori), so that its uncertainty is part of the pose's.
The noise of the places in the images is estimated from all cameras together.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.boards.parameters import OFFSET
from posefuse.calibration.scene.first_pose import MIN_POINTS, distant_poses, first_poses
from posefuse.calibration.scene.held_out import HeldOutPoints, held_out_points, too_few
from posefuse.calibration.scene.noise import PlaceNoise, place_noise
from posefuse.calibration.scene.view import (
    KnownLens,
    SceneView,
    covariance_of,
    descend,
    errors_px,
    view_of,
)
from posefuse.calibration.stated_covariance import POSE_AND_LENS, largest_sd
from posefuse.errors import CalibrationError
from posefuse.model.camera_covariance import CameraCovariance, parameter_names
from posefuse.model.cameras import CameraRig
from posefuse.model.scene_points import ScenePoints

_SCALE_STEPS = 4
_START_PX = 20.0
_MAX_SHARE = 0.02
"""Errors above this share of the image's width are those of a wrong pose or of wrong points."""


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
        points_m: shape (point, 3): the points.
        places_px: shape (view, point, 2): their places in the images, NaN where not shown.
        held_out: how well the other points of each camera predict each point.
        joint_covariance: shape (view, 18, view, 18): of the rotation about the camera's axes (rad), the center in the
            world (m), fx, fy, cx, cy (px) and eight distortion coefficients; 0 for fixed ones.
        left_out: names of cameras that show too few points, with the reason.
    """

    rig: CameraRig
    cameras: tuple[SceneCameraReport, ...]
    sd_px: float
    error_px: float
    points_m: np.ndarray
    places_px: np.ndarray
    held_out: HeldOutPoints
    joint_covariance: np.ndarray
    left_out: tuple[tuple[str, str], ...] = ()


def calibrate_by_scene(lenses: tuple[KnownLens, ...], scene: ScenePoints) -> SceneCalibration:
    """Estimate the poses of cameras from points of known position.

    Args:
        lenses: the cameras with known lenses; their names are those of the points' images.
        scene: the points.

    Raises:
        CalibrationError: if no camera shows enough points, or a camera's points agree with no pose.
    """
    views: list[SceneView] = []
    used: list[KnownLens] = []
    left_out: list[tuple[str, str]] = []
    for lens in lenses:
        pixels = scene.pixels[lens.camera.name]
        seen = np.isfinite(pixels).all(axis=1)
        reason = too_few(scene.points_m[seen])
        if reason:
            left_out.append((lens.camera.name, reason))
            continue
        views.append(_first(view_of(lens, scene.points_m[seen], pixels[seen])))
        used.append(lens)
    if not views:
        raise CalibrationError(
            f"No camera can be located: {left_out[0][0]!r} {left_out[0][1]}. Measure at least {MIN_POINTS} points in "
            "the image of each camera, spread over the image and not on a line."
        )
    noise = PlaceNoise(_START_PX, _START_PX)
    for _ in range(_SCALE_STEPS):
        views = [descend(view, noise.scale_px) for view in views]
        noise = place_noise(views, noise.scale_px)
    return _summary([descend(view, noise.scale_px) for view in views], used, noise, scene, tuple(left_out))


def _first(view: SceneView) -> SceneView:
    """Return the view at the best initial pose.

    Raises:
        CalibrationError: if no pose agrees with the points.
    """
    most = _MAX_SHARE * max(view.camera.size_px)
    best: tuple[float, SceneView] | None = None
    for starts in (first_poses, lambda camera, points_m, _: distant_poses(camera, points_m)):
        for camera in starts(view.camera, view.points_m, view.pixels):
            candidate = replace(view, camera=camera)
            for scale_px in (10.0 * _START_PX, _START_PX):
                candidate = descend(candidate, scale_px)
            cost = candidate.cost(_START_PX)
            if best is None or cost < best[0]:
                best = cost, candidate
        if best is not None and float(np.median(errors_px(best[1]))) < most:
            return best[1]
    error = float("inf") if best is None else float(np.median(errors_px(best[1])))
    raise CalibrationError(
        f"The scene points in the image of camera {view.camera.name!r} agree with no pose of the camera (median error "
        f"{error:.0f} px). Check the order of the points, their positions in meters, and the camera's lens."
    )


def _summary(
    views: list[SceneView],
    used: list[KnownLens],
    noise: PlaceNoise,
    scene: ScenePoints,
    left_out: tuple[tuple[str, str], ...],
) -> SceneCalibration:
    """Return the calibration with its accuracy."""
    reports, covariances = [], []
    joint = np.zeros((len(views), POSE_AND_LENS, len(views), POSE_AND_LENS))
    for v, (view, lens) in enumerate(zip(views, used, strict=True)):
        covariance = covariance_of(view, noise.sd_px)
        free = np.flatnonzero(view.free[:OFFSET])
        joint[v, free[:, None], v, free] = covariance
        worst = [largest_sd(covariance[k : k + 3, k : k + 3]) for k in (0, 3)]
        errors = errors_px(view)
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
    all_errors = np.concatenate([errors_px(view) for view in views])
    rig = CameraRig(
        tuple(view.camera for view in views),
        scene.up_axis,
        left_out=tuple(name for name, _ in left_out),
        covariances=tuple(covariances),
    )
    return SceneCalibration(
        rig=rig,
        cameras=tuple(reports),
        sd_px=noise.sd_px,
        error_px=float(np.sqrt(np.mean(all_errors**2))),
        points_m=scene.points_m,
        places_px=np.stack([scene.pixels[view.camera.name] for view in views]),
        held_out=held_out_points(views, scene, noise),
        joint_covariance=joint,
        left_out=left_out,
    )


def _stated(view: SceneView, covariance: np.ndarray) -> CameraCovariance:
    """Return the covariance with the shifts of the center along the camera's axes."""
    all_names = parameter_names(view.camera.lens)
    used = np.flatnonzero(view.free[:OFFSET])
    turn = np.eye(len(used))
    turn[3:6, 3:6] = view.camera.rotation
    matrix = turn @ covariance @ turn.T
    parameters = tuple(all_names[i] for i in used)
    return CameraCovariance(view.camera.name, parameters, 0.5 * (matrix + matrix.T), "the scene points")
