"""Two views propose a point, all views vote by a threshold, the proposal with most votes is refined.

Source: Fischler & Bolles 1981; on two rays and with a distance in metres, mc_dev's single-keypoint stage (there 100 mm,
200 draws). All pairs are tried where that is no more work; draws are seeded, in the same order for all points.
"""

import math
from itertools import combinations

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import RansacOptions, TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation import simple
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, mean_over, rows_by_person_frame

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
        options: ``min_views`` must be set; points on which fewer views agree are missing.

    Returns:
        The measured layer.
    """
    assert options.min_views is not None
    flat = FlatLayer.of(simple.solve(rig, detections, tracks, noise, options))
    valid = np.isin(flat.view_status, (ViewStatus.USED, ViewStatus.NOT_USED))
    chosen = np.flatnonzero(valid.sum(axis=-1) >= options.min_views)
    observations = Observations.gather(rig, detections, rows_by_person_frame(tracks, detections), noise, chosen)
    agreeing = vote(observations, valid[chosen], options.ransac)
    enough = agreeing.sum(axis=-1) >= options.min_views
    solved = observations.solve(agreeing)
    good = enough & (solved.status < PointStatus.NOT_SEEN)
    errors = observations.errors_px(solved.points_m)
    flat.replace(chosen[good], solved.points_m[good], solved.covariance_m2[good], agreeing[good], errors[good])
    flat.remove(chosen[~good], PointStatus.OUTLIER)
    return flat.finish()


def vote(observations: Observations, valid: np.ndarray, options: RansacOptions) -> np.ndarray:
    """Shape (point, view), bool: the largest set of views that agree with a proposal, of equal ones the closest."""
    n, n_views = valid.shape
    agreeing = np.zeros((n, n_views), dtype=bool)
    residual = np.full(n, np.inf)
    tried = np.zeros(n)
    pairs = list(combinations(range(n_views), 2))
    draw = len(pairs) > options.max_iterations
    if draw:
        np.random.default_rng(options.seed).shuffle(pairs)
    open_points = np.ones(n, dtype=bool)
    for a, b in pairs:
        tested = np.flatnonzero(open_points & valid[:, a] & valid[:, b])
        if not len(tested):
            continue
        kept = np.zeros((len(tested), n_views), dtype=bool)
        kept[:, [a, b]] = True
        points = observations[tested].solve(kept).points_m
        distance = distances(observations[tested], points, options)
        near = valid[tested] & (distance <= options.threshold)
        mean = mean_over(near, distance)
        more = near.sum(axis=-1) - agreeing[tested].sum(axis=-1)
        better = (more > 0) | ((more == 0) & (mean < residual[tested]))
        agreeing[tested[better]], residual[tested[better]] = near[better], mean[better]
        tried[tested] += 1
        if draw:
            open_points = tried < np.minimum(options.max_iterations, draws_needed(agreeing, valid, options.confidence))
    return agreeing


def draws_needed(agreeing: np.ndarray, valid: np.ndarray, confidence: float) -> np.ndarray:
    """Shape (point,): draws until a pair of agreeing views was among them with this probability."""
    share = agreeing.sum(axis=-1) / np.maximum(valid.sum(axis=-1), 1)
    with np.errstate(divide="ignore"):
        return np.ceil(math.log(1.0 - confidence) / np.log1p(-np.minimum(share**2, 1.0 - 1e-12)))


def distances(observations: Observations, points_m: np.ndarray, options: RansacOptions) -> np.ndarray:
    """Shape (point, view): how far points are from what the views saw, in px or in metres from the ray."""
    if options.threshold_unit == "px":
        return observations.errors_px(points_m)
    out = np.empty(observations.pixels.shape[:2])
    for v, camera in enumerate(observations.rig.cameras):
        rays, _ = camera.rays(observations.pixels[:, v])
        directions = rays @ camera.rotation
        offset = points_m - camera.centre_m
        along = (offset * directions).sum(axis=-1)
        out[:, v] = np.where(along > 0, np.linalg.norm(np.cross(offset, directions), axis=-1), np.inf)
    return out
