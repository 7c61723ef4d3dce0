"""Triangulate by RANSAC.

Two views propose a point, all views vote by a threshold, and the largest set of inliers is refined. Sources: Fischler
and Bolles 1981; with a pair of rays and a threshold in meters, the single-keypoint stage of mc_dev (100 mm, 200 samples
there). All pairs are tested if that is no more work; otherwise pairs are sampled with a seed, in the same order for all
points.
"""

import math
from itertools import combinations

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import RansacOptions, TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation import simple
from posefuse.triangulation.method import Method
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, mean_over, rows_by_person_frame


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    Points with fewer than ``min_views`` inliers are missing. The exponent of the noise weights the views.
    """
    assert options.min_views is not None
    flat = FlatLayer.of(simple.solve(rig, detections, tracks, noise, options))
    valid = flat.valid_views()
    chosen = np.flatnonzero(valid.sum(axis=-1) >= options.min_views)
    observations = Observations.gather(rig, detections, rows_by_person_frame(tracks, detections), noise, chosen)
    inliers = find_inliers(observations, valid[chosen], options.ransac)
    enough = inliers.sum(axis=-1) >= options.min_views
    solved = observations.solve(inliers)
    solved_ok = enough & (solved.status < PointStatus.NOT_SEEN)
    errors = observations.errors_px(solved.points_m)
    flat.replace(
        chosen[solved_ok],
        solved.points_m[solved_ok],
        solved.covariance_m2[solved_ok],
        solved.status[solved_ok],
        inliers[solved_ok],
        errors[solved_ok],
    )
    flat.remove(chosen[~solved_ok], PointStatus.OUTLIER)
    return flat.finish()


def find_inliers(observations: Observations, valid: np.ndarray, options: RansacOptions) -> np.ndarray:
    """Return the largest set of agreeing views, shape (point, view), bool; ties go to the smallest error."""
    n, n_views = valid.shape
    inliers = np.zeros((n, n_views), dtype=bool)
    residual = np.full(n, np.inf)
    n_sampled = np.zeros(n)
    pairs = list(combinations(range(n_views), 2))
    is_sampled = len(pairs) > options.max_iterations
    if is_sampled:
        np.random.default_rng(options.seed).shuffle(pairs)
    unfinished = np.ones(n, dtype=bool)
    threshold = options.threshold_px if options.threshold_m is None else options.threshold_m
    for a, b in pairs:
        tested = np.flatnonzero(unfinished & valid[:, a] & valid[:, b])
        if not len(tested):
            continue
        pair = np.zeros((len(tested), n_views), dtype=bool)
        pair[:, [a, b]] = True
        points = observations[tested].solve(pair).points_m
        distance = distances(observations[tested], points, options)
        is_inlier = valid[tested] & (distance <= threshold)
        mean = mean_over(is_inlier, distance)
        extra = is_inlier.sum(axis=-1) - inliers[tested].sum(axis=-1)
        better = (extra > 0) | ((extra == 0) & (mean < residual[tested]))
        inliers[tested[better]], residual[tested[better]] = is_inlier[better], mean[better]
        n_sampled[tested] += 1
        if is_sampled:
            unfinished = n_sampled < np.minimum(
                options.max_iterations, required_samples(inliers, valid, options.confidence)
            )
    return inliers


def required_samples(inliers: np.ndarray, valid: np.ndarray, confidence: float) -> np.ndarray:
    """Return the number of samples after which a pair of inliers was drawn with this probability, shape (point,)."""
    share = inliers.sum(axis=-1) / np.maximum(valid.sum(axis=-1), 1)
    with np.errstate(divide="ignore"):
        return np.ceil(math.log(1.0 - confidence) / np.log1p(-np.minimum(share**2, 1.0 - 1e-12)))


def distances(observations: Observations, points_m: np.ndarray, options: RansacOptions) -> np.ndarray:
    """Return distances of points from the observations, shape (point, view), in px or, from the ray, in meters."""
    if options.threshold_m is None:
        return observations.errors_px(points_m)
    out = np.empty(observations.pixels.shape[:2])
    for v, camera in enumerate(observations.rig.cameras):
        rays, _ = camera.rays(observations.pixels[:, v])
        directions = rays @ camera.rotation
        offset = points_m - camera.center_m
        along = (offset * directions).sum(axis=-1)
        out[:, v] = np.where(along > 0, np.linalg.norm(np.cross(offset, directions), axis=-1), np.inf)
    return out


METHOD = Method("ransac", solve, default_min_views=2, options=RansacOptions)
