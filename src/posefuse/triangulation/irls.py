"""Triangulate by iteratively reweighted least squares with the Huber loss, starting from the linear solution.

The loss bounds the influence of an outlier, but the start is biased by the outlier. Source: Huber 1981, "Robust
Statistics"; 1.345 standard deviations give 95 % efficiency for one Gaussian component.
"""

from dataclasses import replace

import numpy as np

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

_HUBER_SIGMA = 1.345
_ITERATIONS = 10


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    Residuals are weighted in units of the noise. Every valid view has the status used.
    """
    layer = simple.solve(rig, detections, tracks, noise, options)
    flat = FlatLayer.of(layer)
    chosen = np.flatnonzero(flat.status < PointStatus.NOT_SEEN)
    used = flat.view_status[chosen] == ViewStatus.USED
    observations = Observations.gather(rig, detections, rows_by_person_frame(tracks, detections), noise, chosen)
    confidence = np.where(np.isfinite(observations.confidence), observations.confidence, 1.0)
    sigma = noise.scale_px / confidence**noise.exponent
    points, covariance, errors = flat.points_m[chosen], flat.covariance_m2[chosen], flat.view_error_px[chosen]
    # The solver takes weights as confidences with exponent one half.
    weighted = replace(observations, noise=NoiseModel(noise.scale_px, 0.5))
    for _ in range(_ITERATIONS):
        with np.errstate(divide="ignore", invalid="ignore"):
            huber = np.fmin(1.0, _HUBER_SIGMA * sigma / errors)
        weights = np.where(used, huber * confidence ** (2.0 * noise.exponent), 0.0)
        solved = replace(weighted, confidence=weights).solve(used)
        solved_ok = solved.status < PointStatus.NOT_SEEN
        points[solved_ok], covariance[solved_ok] = solved.points_m[solved_ok], solved.covariance_m2[solved_ok]
        errors = observations.errors_px(points)
    flat.replace(chosen, points, covariance, flat.status[chosen], used, errors)
    return flat.finish()


METHOD = Method("irls", solve, default_min_views=2)
