"""Check whether the observations determine the cameras, and which cameras they do not determine."""

import numpy as np

from posefuse.calibration.point_observations import PointObservations
from posefuse.calibration.stated_covariance import largest_sd
from posefuse.calibration.uncertainty import Uncertainty
from posefuse.errors import CalibrationError, choices
from posefuse.model.cameras import CameraRig

MIN_POINTS = 100
MIN_SHARED_POINTS = 30
_MIN_COVERAGE = 1.0 / 3.0
_MAX_ROTATION_SD_DEG = 2.0
_MAX_SHIFT_SD_SHARE = 0.1
_MAX_FOCAL_SD = 0.02
_USELESS_RATIO = 2.0
_MISFIT_RATIO = 5.0
_MISFIT_SHARE = 0.02
_MIN_CAMERAS_TO_IDENTIFY = 4
_SAME_POSITION_SHARE = 1e-3
_SAME_ROTATION_RAD = 1e-3


def find_disconnected(observations: PointObservations, n_views: int) -> dict[int, int]:
    """Return views without enough shared points with the largest connected group, with the number of shared points."""
    seen = np.zeros((observations.n_points, n_views))
    seen[observations.point, observations.view] = 1.0
    shared = seen.T @ seen
    connected = shared >= MIN_SHARED_POINTS
    np.fill_diagonal(connected, True)
    for _ in range(n_views):
        connected = (connected.astype(int) @ connected.astype(int)) > 0
    sizes = connected @ np.diag(shared)
    largest_group = connected[int(np.argmax(sizes * (connected.sum(axis=1) > 1)))]
    return {v: int(shared[v, largest_group].max()) for v in range(n_views) if not largest_group[v]}


def find_copy(rig: CameraRig, used: np.ndarray) -> tuple[int, int] | None:
    """Return two cameras with the same pose, the one that agrees less with the others first, or None.

    Args:
        rig: the cameras.
        used: shape (view,): share of each view's detections that agree with other views.
    """
    centers = np.array([camera.center_m for camera in rig.cameras])
    distances = np.linalg.norm(centers[:, None] - centers[None], axis=-1)
    close = _SAME_POSITION_SHARE * float(distances.max())
    for a in range(len(rig)):
        for b in range(a):
            rotation = np.abs(rig.cameras[a].rotation - rig.cameras[b].rotation).max()
            if distances[a, b] <= close and rotation < _SAME_ROTATION_RAD:
                return (a, b) if used[a] < used[b] else (b, a)
    return None


def find_useless_poses(before: CameraRig, observations: PointObservations, points_m: np.ndarray) -> dict[int, float]:
    """Return cameras whose given pose predicts their observations worse than no pose, with their error in px.

    Their reprojection error is more than twice the distance of the observations from their median.

    Args:
        before: original cameras.
        observations: of the points.
        points_m: shape (point, 3), in the world of ``before``.
    """
    useless = {}
    for v, camera in enumerate(before.cameras):
        of_view = observations.view == v
        if not of_view.any():
            continue
        pixels = observations.pixels[of_view]
        projected, codes = camera.project(points_m[observations.point[of_view]])
        diagonal_px = float(np.hypot(*camera.size_px))
        error = float(np.median(np.where(codes == 0, np.linalg.norm(projected - pixels, axis=1), diagonal_px)))
        if error > _USELESS_RATIO * float(np.median(np.linalg.norm(pixels - np.median(pixels, axis=0), axis=1))):
            useless[v] = min(error, diagonal_px)
    return useless


def find_misfits(rig: CameraRig, error_px: np.ndarray) -> dict[int, float]:
    """Return views that fit far worse than the others after the adjustment, with their error in px.

    At least four cameras are needed to identify them.
    """
    if len(rig) < _MIN_CAMERAS_TO_IDENTIFY:
        return {}
    typical = float(np.nanmedian(error_px))
    side = np.array([max(camera.size_px) for camera in rig.cameras])
    bad = (error_px > _MISFIT_RATIO * typical) & (error_px > _MISFIT_SHARE * side)
    return {int(v): float(error_px[v]) for v in np.flatnonzero(bad)}


def require_coverage(rig: CameraRig, covered: np.ndarray, views: list[int]) -> None:
    """Reject a lens refinement of cameras whose observations cover only a part of the image.

    Raises:
        CalibrationError: naming the cameras.
    """
    partial = [rig.names[v] for v in views if not covered[v]]
    if partial:
        raise CalibrationError(
            f"These points do not determine focal length and distortion: in the images of {choices(partial)} they "
            "cover less than a third of the width or height, where distance and focal length have the same effect. "
            "Refine the extrinsics only, or move a board through the whole image (`rigid=True`)."
        )


def covers(rig: CameraRig, observations: PointObservations, view: int) -> bool:
    """Return whether a view's observations cover a third of its image's width and height."""
    pixels = observations.pixels[observations.view == view]
    if not len(pixels):
        return False
    low, high = np.percentile(pixels, [2, 98], axis=0)
    return bool(np.all(high - low >= _MIN_COVERAGE * np.array(rig.cameras[view].size_px)))


def require_enough_points(observations: PointObservations) -> None:
    """Reject too few points.

    Raises:
        CalibrationError: stating the number of points.
    """
    if observations.n_points < MIN_POINTS:
        raise CalibrationError(
            f"Only {observations.n_points} points are observed by two roughly agreeing cameras; a refinement needs at "
            f"least {MIN_POINTS}. Use more of the recording, or estimate wrong poses without initial values "
            "(`relocate`)."
        )


def require_determined(uncertainty: Uncertainty, rig: CameraRig, distance_m: float) -> None:
    """Reject a result that the points do not determine.

    Args:
        uncertainty: of the cameras.
        rig: refined cameras.
        distance_m: typical distance of the cameras from the points.

    Raises:
        CalibrationError: naming the cameras and their standard deviations.
    """
    if uncertainty.undetermined is not None:
        strongest = int(np.abs(uncertainty.undetermined.reshape(len(rig), -1)).max(axis=1).argmax())
        raise CalibrationError(
            f"These points do not determine the cameras, {rig.names[strongest]!r} least of all: the Schur complement "
            "is singular. Coplanar or collinear points, or too few views of each point, can cause this. Fix two "
            "unmoved cameras (`fix`), or use more of the recording."
        )
    uncertain = [v for v in range(len(rig)) if not is_determined(uncertainty, v, distance_m)]
    if uncertain:
        descriptions, fewer = [], ""
        for v in uncertain:
            rotation_deg, shift_m, focal = pose_sds(uncertainty.block(v))
            lens = ""
            if focal > 0:
                lens, fewer = f", focal length {100 * focal:.2g} %", "refine fewer parameters (`refine='extrinsics'`), "
            descriptions.append(
                f"{rig.names[v]!r}: rotation {rotation_deg:.2g} degrees, position {100 * shift_m:.2g} cm{lens}"
            )
        raise CalibrationError(
            f"These points do not determine the cameras accurately enough. Standard deviations would be, for "
            f"{'; '.join(descriptions)}. Fix such cameras (`fix`), exclude them (`exclude_camera`), {fewer}"
            "use a board (`rigid=True`), or use more of the recording; a subject that moves through the whole volume "
            "is most informative."
        )


def is_determined(uncertainty: Uncertainty, view: int, distance_m: float) -> bool:
    """Return whether a camera is known to 2 degrees, a tenth of its distance, and 2 % of its focal length."""
    rotation_deg, shift_m, focal = pose_sds(uncertainty.block(view))
    return (
        rotation_deg <= _MAX_ROTATION_SD_DEG and shift_m <= _MAX_SHIFT_SD_SHARE * distance_m and focal <= _MAX_FOCAL_SD
    )


def pose_sds(block: np.ndarray) -> tuple[float, float, float]:
    """Return standard deviations of a camera: rotation (deg), center (m) and relative focal length.

    Rotation and center are given in their least certain direction.
    """
    rotation, shift_m = largest_sd(block[0:3, 0:3]), largest_sd(block[3:6, 3:6])
    return float(np.degrees(rotation)), shift_m, float(np.sqrt(max(block[6, 6], 0.0)))
