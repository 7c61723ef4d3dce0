"""How well the other points of a camera predict the place of each point of known position: it names wrong points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.scene.first_pose import MIN_POINTS, lie_on_a_line
from posefuse.calibration.scene.noise import PlaceNoise
from posefuse.calibration.scene.view import SceneView, covariance_of, descend, errors_px
from posefuse.model.scene_points import ScenePoints


@dataclass(frozen=True, eq=False)
class HeldOutPoints:
    """Places of points that were predicted from the other points of the camera.

    Attributes:
        error_px: shape (view, point): distance of the prediction from the measured place; NaN where the camera does not
            show the point, or the other points do not determine its pose.
        sds: shape (view, point): this distance in its standard deviations (the Mahalanobis distance, two degrees of
            freedom), from the errors of the place and of the prediction.
    """

    error_px: np.ndarray
    sds: np.ndarray


def held_out_points(views: Sequence[SceneView], scene: ScenePoints, noise: PlaceNoise) -> HeldOutPoints:
    """Return the predictions of all points in all cameras.

    Args:
        views: the cameras at their estimated poses, with the points that they show in the order of the scene.
        scene: the points.
        noise: errors of measured places.
    """
    error_px = np.full((len(views), len(scene.points_m)), np.nan)
    sds = error_px.copy()
    for v, view in enumerate(views):
        shown = np.flatnonzero(np.isfinite(scene.pixels[view.camera.name]).all(axis=1))
        for k, point in enumerate(shown):
            others = np.arange(len(shown)) != k
            if too_few(view.points_m[others]):
                continue
            rest = replace(view, points_m=view.points_m[others], pixels=view.pixels[others])
            predicted = replace(
                view, camera=descend(rest, noise.scale_px).camera, points_m=view.points_m[[k]], pixels=view.pixels[[k]]
            )
            error_px[v, point] = errors_px(predicted)[0]
            sds[v, point] = _sds(predicted, rest, noise.sd_px)
    return HeldOutPoints(error_px, sds)


def _sds(predicted: SceneView, rest: SceneView, sd_px: float) -> float:
    """Return the distance of a predicted place from the measured one in its standard deviations."""
    residual, derivatives = predicted.rows()
    by_free = derivatives[0][:, rest.free]
    pose = covariance_of(replace(rest, camera=predicted.camera), sd_px)
    covariance = sd_px**2 * np.eye(2) + by_free @ pose @ by_free.T
    return float(np.sqrt(residual[0] @ np.linalg.solve(covariance, residual[0])))


def too_few(points_m: np.ndarray) -> str:
    """Return why points do not determine a pose, or an empty text."""
    if len(points_m) < MIN_POINTS:
        return f"shows {len(points_m)} of the points, at least {MIN_POINTS} are needed"
    return "shows only points on one line" if lie_on_a_line(points_m) else ""
