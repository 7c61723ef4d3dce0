"""The world of points of known position, for cameras that are calibrated already.

Points that two cameras or more show are triangulated; the world follows from the rotation, shift and, if it is not
known, scale that fit them best (Umeyama 1991).
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.scene.first_pose import lie_on_a_line
from posefuse.errors import CalibrationError
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.rotations import similarity_of_points
from posefuse.model.scene_points import ScenePoints
from posefuse.model.view_names import matching_name

_MIN_POINTS, _MIN_VIEWS = 3, 2
_MOST_SHARE = 0.1
_ITERATIONS = 4


@dataclass(frozen=True, eq=False)
class Origin:
    """The world of known points.

    Attributes:
        alignment: this world from that of the calibration.
        n_points: number of points that were used.
        rms_m: root mean square distance between the points and where the cameras see them.
        scale_sd: relative standard deviation of the scale that follows from the points.
        scale: size of the known distances relative to those of the calibration, also if it is not applied.
    """

    alignment: Alignment
    n_points: int
    rms_m: float
    scale_sd: float
    scale: float


def find_origin(rig: CameraRig, scene: ScenePoints, *, scale_known: bool) -> Origin:
    """Return the world of points of known position.

    Args:
        rig: the calibrated cameras.
        scene: the points; cameras of other names are not used.
        scale_known: whether the calibration keeps its scale.

    Raises:
        CalibrationError: if fewer than three points that are not on a line are seen by two cameras, or they contradict
            the calibration.
    """
    seen = _triangulated(rig, scene)
    used = np.isfinite(seen).all(axis=1)
    if used.sum() < _MIN_POINTS or lie_on_a_line(scene.points_m[used]):
        raise CalibrationError(
            f"{int(used.sum())} of the points of known position are in the images of two cameras or more; the world "
            f"needs at least {_MIN_POINTS} that are not on a line. Add their places in more images, under the names of "
            "the cameras."
        )
    found, known = seen[used], scene.points_m[used]
    rotation, fitted = similarity_of_points(found, known)
    scale = 1.0 if scale_known else fitted
    shift = known.mean(axis=0) - scale * rotation @ found.mean(axis=0)
    away = scale * found @ rotation.T + shift - known
    rms_m = float(np.sqrt(np.square(away).sum(axis=1).mean()))
    extent_m = float(np.sqrt(np.square(known - known.mean(axis=0)).sum(axis=1).mean()))
    if rms_m > _MOST_SHARE * extent_m:
        raise CalibrationError(
            f"The points of known position are {rms_m:.2g} m from where the cameras see them. Check the order of the "
            "points, their positions in meters, and that the cameras were not moved in between."
        )
    alignment = Alignment(rotation, shift, scale, up_axis=scene.up_axis)
    return Origin(alignment, int(used.sum()), rms_m, rms_m / (extent_m * np.sqrt(used.sum())), fitted)


def _triangulated(rig: CameraRig, scene: ScenePoints) -> np.ndarray:
    """Return the points closest to the lines of sight of all cameras, shape (point, 3), NaN with fewer than two."""
    n = len(scene.points_m)
    names = {camera.name: matching_name(camera.name, scene.pixels) for camera in rig.cameras}
    cameras = [camera for camera in rig.cameras if names[camera.name] is not None]
    out = np.full((n, 3), np.nan)
    for k in range(n):
        lines = []
        for camera in cameras:
            place = scene.pixels[names[camera.name] or ""][k]
            ray = camera.rays(place[None])[0][0] @ camera.rotation
            if np.isfinite(ray).all():
                lines.append((camera.center_m, ray / np.linalg.norm(ray)))
        if len(lines) >= _MIN_VIEWS:
            out[k] = _closest(lines)
    return out


def _closest(lines: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the point with the smallest sum of squared angles to lines of sight."""
    weight = np.ones(len(lines))
    point = np.zeros(3)
    for _ in range(_ITERATIONS):
        matrix, right = np.zeros((3, 3)), np.zeros(3)
        for (center, ray), w in zip(lines, weight, strict=True):
            across = w * (np.eye(3) - np.outer(ray, ray))
            matrix, right = matrix + across, right + across @ center
        point = np.linalg.lstsq(matrix, right, rcond=None)[0]
        weight = np.array([1.0 / max(float(np.square(point - center).sum()), 1e-12) for center, _ in lines])
    return point
