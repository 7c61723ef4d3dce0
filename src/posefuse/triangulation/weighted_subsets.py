"""Triangulate by FreeMoCap's outlier rejection: a weighted mean of the points from subsets of the cameras.

Source: FreeMoCap's documentation, "Reprojection Error Outlier Rejection" (in the program since version 1.8, as a check
box). ``freemocap_rules`` chooses between the rules of the documentation and those of the program.
"""

from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions, WeightedSubsetsOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation import simple
from posefuse.triangulation.linear_points import focal_lengths_px
from posefuse.triangulation.method import Method, Pieces
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, mean_over, rows_by_person_frame

_SHARPNESS = 5.0
_MIN_TOTAL = 1e-12


def prepare(
    rig: CameraRig, pieces: Pieces, noise: NoiseModel, options: TriangulationOptions
) -> tuple[TriangulationOptions, tuple[str, ...]]:
    """Add a note if the rig has no camera to drop; nothing else is examined or changed.

    Returns:
        The unchanged options, and notes for the user.
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
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    A view has the status used if subsets with it carry more than half of the weight; at least ``min_views`` views do.
    """
    assert options.min_views is not None
    layer = simple.solve(rig, detections, tracks, noise, options)
    chosen, program = options.weighted_subsets, options.follows_program
    flat = FlatLayer.of(layer)
    # A point that all views together do not determine may be determined by fewer.
    used = flat.valid_views()
    target, units_px = chosen.target_normalized or chosen.target_px, error_units_px(rig, chosen)
    gather = partial(Observations.gather, rig, detections, rows_by_person_frame(tracks, detections), noise)
    tested = np.flatnonzero(used.sum(axis=-1) > options.min_views)
    first_m, all_views_px = flat.points_m[tested], flat.view_error_px[tested]
    if program:
        first_m, all_views_px = gather(tested, linear=True).subset(used[tested])
    initial = mean_over(used[tested], all_views_px / units_px)
    initial = np.where(np.isfinite(initial), initial, np.inf)
    high = initial > target
    exceeding, initial, first_m = tested[high], initial[high], first_m[high]
    if not len(exceeding):
        return layer
    observations = gather(exceeding, linear=program)
    first = (np.nan_to_num(first_m), initial) if program else None
    points, weights = weighted_mean(observations, used[exceeding], units_px, options.min_views, chosen, first)
    errors_px = observations.errors_px(points)
    better = weights.best < (initial if program else target)
    if not program:
        with np.errstate(invalid="ignore"):
            better |= mean_over(used[exceeding], errors_px / units_px) < initial
    solved = observations.solve(weights.retained)
    better &= np.isfinite(points).all(axis=-1) & (solved.status < PointStatus.NOT_SEEN)
    flat.replace(
        exceeding[better], points[better], solved.covariance_m2[better], solved.status[better],
        weights.retained[better], errors_px[better],
    )  # fmt: skip
    return flat.finish()


@dataclass(frozen=True)
class EnsembleWeights:
    """Describe how the weight of an ensemble is distributed.

    Attributes:
        best: shape (point,): lowest error of a subset.
        retained: shape (point, view), bool: subsets with the view carry more than half of the weight, or the view is
            among the ``min_views`` that carry the most.
    """

    best: np.ndarray
    retained: np.ndarray


def weighted_mean(
    observations: Observations,
    used: np.ndarray,
    units_px: np.ndarray,
    min_views: int,
    options: WeightedSubsetsOptions,
    first: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, EnsembleWeights]:
    """Return the weighted mean of the points of every tested subset.

    Subsets with one camera dropped are tested first, then with two, up to ``max_cameras_to_drop``. A point is not
    tested further once a subset reached the target.

    Args:
        observations: of the points.
        used: shape (point, view), bool: valid views.
        units_px: shape (view,): size of an error of 1 in px.
        min_views: minimum number of views of a subset.
        options: target error and number of cameras to drop.
        first: points and errors of all used views, if they count as a subset, as in FreeMoCap's program. The best
            subset then replaces a mean whose weights sum to less than 1e-12.
    """
    n, n_views = used.shape
    target = options.target_normalized or options.target_px
    # Weights are relative to the best subset so far, so that they do not underflow.
    best = np.full(n, np.inf)
    total = np.zeros(n)
    points = np.zeros((n, 3))
    shares = np.zeros((n, n_views))
    if first is not None:
        points, best, total, shares = first[0].copy(), first[1].copy(), np.ones(n), used.astype(float)
    best_points, best_kept = points.copy(), used.copy()
    for n_dropped in range(1, options.max_cameras_to_drop + 1):
        level = (best >= target) & (used.sum(axis=-1) - n_dropped >= min_views)
        for dropped in combinations(range(n_views), n_dropped):
            tested = np.flatnonzero(level & used[:, dropped].all(axis=-1))
            if not len(tested):
                continue
            kept = used[tested].copy()
            kept[:, dropped] = False
            found, errors_px = observations[tested].subset(kept)
            errors = mean_over(kept, errors_px / units_px)
            there = np.isfinite(errors)
            tested, errors, kept, found = tested[there], errors[there], kept[there], found[there]
            improved = errors < best[tested]
            best_points[tested[improved]], best_kept[tested[improved]] = found[improved], kept[improved]
            lower = np.minimum(best[tested], errors)
            fade = np.exp(-_SHARPNESS * (best[tested] - lower) / target)
            weight = np.exp(-_SHARPNESS * (errors - lower) / target)
            best[tested] = lower
            total[tested] = total[tested] * fade + weight
            points[tested] = points[tested] * fade[:, None] + weight[:, None] * found
            shares[tested] = shares[tested] * fade[:, None] + weight[:, None] * kept
    if first is not None:
        vanished = total * np.exp(-_SHARPNESS * best / target) <= _MIN_TOTAL
        points[vanished], total[vanished], shares[vanished] = best_points[vanished], 1.0, best_kept[vanished]
    with np.errstate(invalid="ignore"):
        retained = used & (shares > 0.5 * total[:, None])
    # If three cameras or more are dropped, no view need carry half of the weight.
    order = np.argsort(np.where(used, -shares, np.inf), axis=-1, kind="stable")[:, :min_views]
    np.put_along_axis(retained, order, np.take_along_axis(used, order, axis=-1), axis=-1)
    with np.errstate(invalid="ignore"):
        return points / total[:, None], EnsembleWeights(best, retained)


def error_units_px(rig: CameraRig, options: WeightedSubsetsOptions) -> np.ndarray:
    """Return the size of an error of 1 in px, shape (view,): 1, or the focal length for normalized errors."""
    return np.ones(len(rig)) if options.target_normalized is None else focal_lengths_px(rig)


METHOD = Method("weighted_subsets", solve, default_min_views=3, options=WeightedSubsetsOptions, prepare=prepare)
