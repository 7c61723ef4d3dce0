"""Where the viewing rays come closest to each other, in metres instead of pixels.

Source: Slabaugh, Schafer & Livingston 2001, "Optimal Ray Intersection For Computing 3D Points From N-View
Correspondences". Weighted by confidence where ``confidence_exponent`` says so.
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
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, rows_by_person_frame

DEFAULT_MIN_VIEWS = 2


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint of every person in a range of frames.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory.
        tracks: whose detection is whose, of the same frames.
        noise: the standard deviation of a detection; its exponent weighs the views.
        options: ``min_views`` must be set.

    Returns:
        The measured layer. Its covariance is that of the maximum-likelihood point, which is a little smaller.
    """
    layer = simple.solve(rig, detections, tracks, noise, options)
    flat = FlatLayer.of(layer)
    chosen = np.flatnonzero(flat.status < PointStatus.NOT_SEEN)
    used = flat.view_status[chosen] == ViewStatus.USED
    observations = Observations.gather(rig, detections, rows_by_person_frame(tracks, detections), noise, chosen)
    trust = np.where(np.isfinite(observations.confidence), observations.confidence, 1.0)
    points = closest(rig, observations.pixels, np.where(used, trust ** (2.0 * noise.exponent), 0.0))
    found = np.asarray(np.isfinite(points).all(axis=-1))
    there = chosen[found]
    flat.replace(
        there, points[found], flat.covariance_m2[there], used[found], observations[found].errors_px(points[found])
    )
    flat.remove(chosen[~found], PointStatus.DEGENERATE)
    return flat.finish()


def closest(rig: CameraRig, pixels: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Shape (point, 3): the points nearest to the rays of ``pixels`` (point, view, 2); NaN where rays fix none."""
    n, views, _ = pixels.shape
    directions = np.empty((n, views, 3))
    for v, camera in enumerate(rig.cameras):
        rays, _ = camera.rays(pixels[:, v])
        directions[:, v] = rays @ camera.rotation
    origins = np.stack([camera.centre_m for camera in rig.cameras])
    points, covariance, status = np.empty((n, 3)), np.empty((n, 6)), np.empty(n, dtype=np.int64)
    intersect_rays(origins, directions, np.ascontiguousarray(weights, dtype=np.float64), points, covariance, status)
    points[status != kernel_codes.OK] = np.nan
    return points
