"""FreeMoCap's outlier rejection: a weighted mean over the points of subsets of the cameras.

Source: FreeMoCap's documentation, "Reprojection Error Outlier Rejection" (in its program since version 1.8, where it
is a check box). Its words are followed where the program differs; docs/methods.md, "weighted_subsets", says where.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions, WeightedSubsetsOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation import simple
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, mean_over, rows_by_person_frame

DEFAULT_MIN_VIEWS = 3

_SHARPNESS = 5.0


def settle(
    rig: CameraRig, pieces: Iterable[tuple[Detections, Tracks]], noise: NoiseModel, options: TriangulationOptions
) -> tuple[TriangulationOptions, tuple[str, ...]]:
    """Say where the rig leaves no camera to drop; nothing is looked at or changed.

    Returns:
        The options as they are, and what is worth saying.
    """
    assert options.min_views is not None
    if options.min_views < len(rig):
        return options, ()
    return options, (
        f"weighted_subsets drops no camera: min_views is {options.min_views} and the rig has {len(rig)} cameras, so "
        "the result is that of simple.",
    )


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint of every person in a range of frames.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory.
        tracks: whose detection is whose, of the same frames.
        noise: the standard deviation of a detection.
        options: ``min_views`` must be set.

    Returns:
        The measured layer. A view counts as used if more than half of the weight lies on subsets it is in.
    """
    assert options.min_views is not None
    layer = simple.solve(rig, detections, tracks, noise, options)
    chosen = options.weighted_subsets
    flat = FlatLayer.of(layer)
    used = flat.view_status == ViewStatus.USED
    units_px = error_units_px(rig, chosen)
    initial = mean_over(used, flat.view_error_px / units_px)
    with np.errstate(invalid="ignore"):
        off = np.flatnonzero((initial > chosen.target_reprojection_error) & (used.sum(axis=-1) > options.min_views))
    if not len(off):
        return layer
    observations = Observations.gather(rig, detections, rows_by_person_frame(tracks, detections), noise, off)
    points, shares = ensemble(observations, used[off], units_px, options.min_views, chosen)
    errors_px = observations.errors_px(points)
    errors = mean_over(used[off], errors_px / units_px)
    reached = shares.best < chosen.target_reprojection_error
    with np.errstate(invalid="ignore"):
        better = np.isfinite(points).all(axis=-1) & (reached | (errors < initial[off]))
    accepted = shares.kept & used[off]
    solved = observations.solve(accepted)
    flat.replace(off[better], points[better], solved.covariance_m2[better], accepted[better], errors_px[better])
    return flat.finish()


@dataclass(frozen=True)
class Shares:
    """How the weight of an ensemble is spread.

    Attributes:
        best: shape (point,): lowest error of a subset.
        kept: shape (point, view), bool: more than half of the weight lies on subsets with the view.
    """

    best: np.ndarray
    kept: np.ndarray


def ensemble(
    observations: Observations,
    used: np.ndarray,
    units_px: np.ndarray,
    min_views: int,
    options: WeightedSubsetsOptions,
) -> tuple[np.ndarray, Shares]:
    """The weighted mean of the points of every tested subset.

    All subsets with one camera dropped, then with two, ... up to ``max_cameras_to_drop``; points of which a subset
    reached the target take no part in the next level.

    Args:
        observations: of the points.
        used: shape (point, view), bool: valid views.
        units_px: shape (view,): what an error of 1 is in px.
        min_views: no subset has fewer.
        options: target and number of cameras to drop.
    """
    n, n_views = used.shape
    target = options.target_reprojection_error
    # Weights relative to the best subset so far, so that none underflows.
    best = np.full(n, np.inf)
    total = np.zeros(n)
    points = np.zeros((n, 3))
    shares = np.zeros((n, n_views))
    for n_dropped in range(1, options.max_cameras_to_drop + 1):
        level = (best >= target) & (used.sum(axis=-1) - n_dropped >= min_views)
        for dropped in combinations(range(n_views), n_dropped):
            tested = np.flatnonzero(level & used[:, dropped].all(axis=-1))
            if not len(tested):
                continue
            kept = used[tested].copy()
            kept[:, dropped] = False
            solved = observations[tested].solve(kept)
            errors = mean_over(kept, solved.view_error_px / units_px)
            there = np.isfinite(errors)
            tested, errors, kept = tested[there], errors[there], kept[there]
            lower = np.minimum(best[tested], errors)
            fade = np.exp(-_SHARPNESS * (best[tested] - lower) / target)
            weight = np.exp(-_SHARPNESS * (errors - lower) / target)
            best[tested] = lower
            total[tested] = total[tested] * fade + weight
            points[tested] = points[tested] * fade[:, None] + weight[:, None] * solved.points_m[there]
            shares[tested] = shares[tested] * fade[:, None] + weight[:, None] * kept
    with np.errstate(invalid="ignore"):
        return points / total[:, None], Shares(best, shares > 0.5 * total[:, None])


def error_units_px(rig: CameraRig, options: WeightedSubsetsOptions) -> np.ndarray:
    """Shape (view,): what an error of 1 is in px: 1, or the focal length for normalised errors."""
    if options.target_unit == "px":
        return np.ones(len(rig))
    return np.array([0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1]) for camera in rig.cameras])
