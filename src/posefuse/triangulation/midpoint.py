"""Triangulate the point closest to all viewing rays, in meters instead of pixels, without outlier rejection.

Source: Slabaugh, Schafer and Livingston 2001, "Optimal Ray Intersection For Computing 3D Points From N-View
Correspondences". Rays are weighted by confidence according to ``confidence_exponent``.
"""

import numpy as np

from posefuse.kernels.cameras import points as kernel_codes
from posefuse.kernels.cameras.rays import intersect_rays
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation import simple
from posefuse.triangulation.method import Method
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, rows_by_person_frame


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    The covariance is that of the maximum-likelihood point, which is slightly smaller.
    """
    layer = simple.solve(rig, detections, tracks, noise, options)
    flat = FlatLayer.of(layer)
    chosen = np.flatnonzero(flat.status < PointStatus.NOT_SEEN)
    used = flat.view_status[chosen] == ViewStatus.USED
    observations = Observations.gather(rig, detections, rows_by_person_frame(tracks, detections), noise, chosen)
    confidence = np.where(np.isfinite(observations.confidence), observations.confidence, 1.0)
    points = intersect(rig, observations.pixels, np.where(used, confidence ** (2.0 * noise.exponent), 0.0))
    finite = np.asarray(np.isfinite(points).all(axis=-1))
    solved = chosen[finite]
    errors = observations[finite].errors_px(points[finite])
    flat.replace(solved, points[finite], flat.covariance_m2[solved], flat.status[solved], used[finite], errors)
    flat.remove(chosen[~finite], PointStatus.DEGENERATE)
    return flat.finish()


def intersect(rig: CameraRig, pixels: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the points closest to the rays of pixels (point, view, 2), shape (point, 3); NaN if undetermined."""
    n, views, _ = pixels.shape
    directions = np.empty((n, views, 3))
    for v, camera in enumerate(rig.cameras):
        rays, _ = camera.rays(pixels[:, v])
        directions[:, v] = rays @ camera.rotation
    origins = np.stack([camera.center_m for camera in rig.cameras])
    points, covariance, status = np.empty((n, 3)), np.empty((n, 6)), np.empty(n, dtype=np.int64)
    intersect_rays(origins, directions, np.ascontiguousarray(weights, dtype=np.float64), points, covariance, status)
    points[status != kernel_codes.OK] = np.nan
    return points


METHOD = Method("midpoint", solve, default_min_views=2)
