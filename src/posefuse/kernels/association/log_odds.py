"""Log odds that detections of different views show the same person.

The odds compare two hypotheses for the position of a keypoint in an image: a Student t distribution (3 degrees of
freedom) around the position that other views predict, or a uniform distribution over a region ``clutter_px`` wide. See
docs/methods/association.md.
"""

import math
from typing import Any, NamedTuple

from posefuse.kernels.association.group_points import (
    COST,
    INFORMATION,
    POINT,
    VALID,
    GroupMembers,
    keypoint_index,
    triangulate_keypoint,
)
from posefuse.kernels.jit import inline, subroutine, vectorized
from posefuse.kernels.linear_algebra.symmetric_3x3 import invert_symmetric

# Density of the Student t distribution with 3 degrees of freedom at its center, in one dimension.
_T3_PEAK = 0.3675525969478613


_INVERSE_TWO_PI = 0.15915494309189535


_NORMAL_PEAK = 0.3989422804014327


_PAIR_ITERATIONS = 1


_EARLY_COUNT = 5


_EARLY_REJECTION = -1.0


_FACTORS = 16


class CandidateDetections(NamedTuple):
    """Unassigned detections of one frame, as observations of core keypoints.

    Attributes:
        views: shape (detection,), int64, non-decreasing: view of each detection.
        rays: shape (detection, core, 12), from :func:`compute_observations`.
        weights: shape (detection, core), 1/px^2, 0 where there is no observation.
        mirror: shape (core,), int64: the partner of each keypoint on the other side, or the keypoint itself.
        bones: shape (bone, 4): two core keypoints, then the shortest and longest plausible distance in m.
        allowed: shape (detection, detection), bool, symmetric: which detections may belong to the same person.
        clutter_px: shape (view,): width of the region where an unrelated keypoint may lie.
    """

    views: Any
    rays: Any
    weights: Any
    mirror: Any
    bones: Any
    allowed: Any
    clutter_px: Any


class OddsParameters(NamedTuple):
    """Parameters of the log odds; :class:`posefuse.model.options.association.AssociationOptions` documents them.

    Attributes:
        min_common: a pair with fewer common keypoints gets log odds of 0.
        outlier_share: fraction of wrong keypoints in a detection of the right person.
        independent: maximum number of keypoints that count as independent.
        independent_bones: maximum number of bones that count as independent.
        join: minimum log odds for a detection to join a group.
        swap: prior log odds that the left and right labels of a detection are swapped.
        miss: log odds of a view that should show the person and does not.
        prior: prior log odds of a group.
        near: two detections of a view show the same person if they are on average at most this many sigmas apart.
        max_seeds: maximum number of pairs that are grown in one pass.
    """

    min_common: int
    outlier_share: float
    independent: float
    independent_bones: float
    join: float
    swap: float
    miss: float
    prior: float
    near: float
    max_seeds: int


@inline
def _keypoint_log_odds(likelihood_ratio, outlier_share):
    """Return the log odds of one keypoint from its likelihood ratio, allowing for a fraction of outliers."""
    return math.log((1.0 - outlier_share) * likelihood_ratio + outlier_share)


@inline
def _effective_log_odds(total, common, min_common, independent):
    """Scale summed log odds so that at most ``independent`` keypoints count: neighboring keypoints err together."""
    return total / common * min(float(common), independent) if common >= min_common else 0.0


@subroutine
def pair_log_odds(candidates, parameters, members, swapped, points):
    """Return the log odds that two detections show the same person, from the distance between their rays.

    Two rays have one residual more than a point has unknowns, so the cost of a keypoint is a squared t variable with
    one degree of freedom. If the first few keypoints clearly contradict the pair, the remaining ones are skipped.

    Args:
        candidates: detections of the frame.
        parameters: of the log odds.
        members: shape (at least 2,), int64: the two detections.
        swapped: shape (at least 2,), bool.
        points: shape (core, POINT_COLUMNS), written.

    Returns:
        The log odds, or -inf if keypoints were skipped; ``points`` is then incomplete.
    """
    weights = candidates.weights
    group = GroupMembers(candidates.rays, weights, candidates.mirror, members, swapped)
    a = members[0]
    b = members[1]
    clutter = candidates.clutter_px[candidates.views[a]] * candidates.clutter_px[candidates.views[b]]
    total = 0.0
    common = 0
    for k in range(weights.shape[1]):
        points[k, VALID] = 0.0
        both = weights[a, k] * weights[b, k]
        if not both > 0.0:
            continue
        common += 1
        triangulate_keypoint(group, 2, _PAIR_ITERATIONS, k, points)
        likelihood_ratio = 0.0
        if points[k, VALID] > 0.0:
            spread_factor = 1.0 + points[k, COST] * (1.0 / 3.0)
            likelihood_ratio = math.sqrt(0.5 * clutter * math.sqrt(both)) * _T3_PEAK / (spread_factor * spread_factor)
        total += _keypoint_log_odds(likelihood_ratio, parameters.outlier_share)
        if common == _EARLY_COUNT and total < _EARLY_REJECTION * common:
            return -math.inf
    return _effective_log_odds(total, common, parameters.min_common, parameters.independent)


class JoinTerms(NamedTuple):
    """Terms of the odds that detections join a group, with keypoints as the last axis, so that loops vectorize.

    Attributes:
        shown: shape (side, detection, 13, core): rays of detections and their variances, with labels as they are, and
            swapped; the variance is NaN where there is no observation.
        predicted: shape (9, core): points of the group, NaN where missing, and their covariances.
        odds: shape (core,), overwritten: odds of the keypoints of one detection, 1 where missing.
        common: shape (core,), overwritten: 1 where the detection and the group have a keypoint, else 0.
    """

    shown: Any
    predicted: Any
    odds: Any
    common: Any


@subroutine
def arrange_detections(candidates, terms):
    """Write the terms of all detections."""
    rays, weights, mirror = candidates.rays, candidates.weights, candidates.mirror
    for n in range(weights.shape[0]):
        for k in range(weights.shape[1]):
            for side in range(2):
                m = keypoint_index(k, side == 1, mirror)
                for i in range(12):
                    terms.shown[side, n, i, k] = rays[n, m, i]
                terms.shown[side, n, 12, k] = 1.0 / weights[n, m] if weights[n, m] > 0.0 else math.nan


@subroutine
def arrange_points(points, terms):
    """Write the terms of a group's points, from :func:`triangulate_group`."""
    predicted, i = terms.predicted, INFORMATION
    for k in range(points.shape[0]):
        _, xx, xy, xz, yy, yz, zz = invert_symmetric(
            points[k, i], points[k, i + 1], points[k, i + 2], points[k, i + 3], points[k, i + 4], points[k, i + 5]
        )
        predicted[0, k] = points[k, POINT] if points[k, VALID] > 0.0 else math.nan
        predicted[1, k] = points[k, POINT + 1]
        predicted[2, k] = points[k, POINT + 2]
        predicted[3, k] = xx
        predicted[4, k] = xy
        predicted[5, k] = xz
        predicted[6, k] = yy
        predicted[7, k] = yz
        predicted[8, k] = zz


@subroutine
def join_log_odds(candidates, parameters, terms, n, swapped):
    """Return the log odds that a detection shows the person whose points other views determine.

    The predicted position has the projected covariance of the point plus the variance of the detection, so an uncertain
    point contributes little.

    Args:
        candidates: detections of the frame.
        parameters: of the log odds.
        terms: JoinTerms of the detections and of the group.
        n: the detection.
        swapped: whether to take left and right of the detection as swapped.
    """
    clutter = candidates.clutter_px[candidates.views[n]]
    side = 1 if swapped else 0
    _join_odds(terms, side, n, clutter * clutter * _INVERSE_TWO_PI, parameters.outlier_share)
    common = 0.0
    for k in range(terms.common.shape[0]):
        common += terms.common[k]
    return _effective_log_odds(log_of_product(terms.odds), common, parameters.min_common, parameters.independent)


@subroutine
def log_of_product(factors):
    """Return the logarithm of a product, with one logarithm for many factors; longer products could overflow."""
    total = 0.0
    product = 1.0
    for k in range(factors.shape[0]):
        product *= factors[k]
        if k % _FACTORS == _FACTORS - 1:
            total += math.log(product)
            product = 1.0
    return total + math.log(product)


@vectorized
def _join_odds(terms, side, n, area, outlier_share):
    """Write the odds of all keypoints, and which are common.

    Loops that also multiply the odds are not vectorized.
    """
    shown, predicted = terms.shown, terms.predicted
    for k in range(predicted.shape[1]):
        x = predicted[0, k]
        y = predicted[1, k]
        z = predicted[2, k]
        c0 = shown[side, n, 8, k]
        c1 = shown[side, n, 9, k]
        c2 = shown[side, n, 10, k]
        depth = c0 * x + c1 * y + c2 * z + shown[side, n, 11, k]
        inverse = 1.0 / depth
        a0 = shown[side, n, 0, k]
        a1 = shown[side, n, 1, k]
        a2 = shown[side, n, 2, k]
        b0 = shown[side, n, 4, k]
        b1 = shown[side, n, 5, k]
        b2 = shown[side, n, 6, k]
        # The residual (r, s) in px and its derivatives a and b.
        r = (a0 * x + a1 * y + a2 * z + shown[side, n, 3, k]) * inverse
        s = (b0 * x + b1 * y + b2 * z + shown[side, n, 7, k]) * inverse
        a0 = (a0 - r * c0) * inverse
        a1 = (a1 - r * c1) * inverse
        a2 = (a2 - r * c2) * inverse
        b0 = (b0 - s * c0) * inverse
        b1 = (b1 - s * c1) * inverse
        b2 = (b2 - s * c2) * inverse
        p0 = predicted[3, k] * a0 + predicted[4, k] * a1 + predicted[5, k] * a2
        p1 = predicted[4, k] * a0 + predicted[6, k] * a1 + predicted[7, k] * a2
        p2 = predicted[5, k] * a0 + predicted[7, k] * a1 + predicted[8, k] * a2
        q0 = predicted[3, k] * b0 + predicted[4, k] * b1 + predicted[5, k] * b2
        q1 = predicted[4, k] * b0 + predicted[6, k] * b1 + predicted[7, k] * b2
        q2 = predicted[5, k] * b0 + predicted[7, k] * b1 + predicted[8, k] * b2
        own = shown[side, n, 12, k]
        xx = a0 * p0 + a1 * p1 + a2 * p2 + own
        xy = b0 * p0 + b1 * p1 + b2 * p2
        yy = b0 * q0 + b1 * q1 + b2 * q2 + own
        determinant = xx * yy - xy * xy
        # The determinant times the growth of the t distribution, whose density falls with the power 5 / 2 of it.
        grown = determinant + (yy * r * r - 2.0 * xy * r * s + xx * s * s) * (1.0 / 3.0)
        ratio = area * determinant * determinant / (grown * grown * math.sqrt(grown))
        is_common = x + own == x + own
        # By rounding, the covariance of rays that are almost parallel may not be one. Its limit is infinite.
        is_certain = (depth > 0.0) & (determinant > 0.0) & (grown >= determinant)
        odds = (1.0 - outlier_share) * (ratio if is_certain else 0.0) + outlier_share
        terms.odds[k] = odds if is_common else 1.0
        terms.common[k] = 1.0 if is_common else 0.0


@subroutine
def bone_log_odds(candidates, parameters, points):
    """Return the log odds of the distances between keypoints, for a body against arbitrary points.

    The length of a bone is taken as normally distributed, with the plausible range as plus and minus three sigmas. The
    alternative is a uniform distribution up to twice the longest length.

    Args:
        candidates: detections of the frame.
        parameters: of the log odds.
        points: shape (core, POINT_COLUMNS).
    """
    bones = candidates.bones
    total = 0.0
    n_valid = 0
    for i in range(bones.shape[0]):
        a = int(bones[i, 0])
        b = int(bones[i, 1])
        if points[a, VALID] == 0.0 or points[b, VALID] == 0.0:
            continue
        dx = points[a, POINT] - points[b, POINT]
        dy = points[a, POINT + 1] - points[b, POINT + 1]
        dz = points[a, POINT + 2] - points[b, POINT + 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        deviation = length - 0.5 * (bones[i, 2] + bones[i, 3])
        own_variance = (bones[i, 3] - bones[i, 2]) * (1.0 / 6.0)
        variance = own_variance * own_variance
        variance += _variance_along(points, a, dx, dy, dz, length) + _variance_along(points, b, dx, dy, dz, length)
        # By rounding, the variance of a point on rays that are almost parallel may be negative. Its limit is infinite.
        likelihood_ratio = 0.0
        if variance > 0.0:
            density = math.exp(-0.5 * deviation * deviation / variance) / math.sqrt(variance) * _NORMAL_PEAK
            likelihood_ratio = 2.0 * bones[i, 3] * density
        total += _keypoint_log_odds(likelihood_ratio, parameters.outlier_share)
        n_valid += 1
    return _effective_log_odds(total, n_valid, 1, parameters.independent_bones)


@inline
def _variance_along(points, k, dx, dy, dz, length):
    """Return the variance in m^2 of point ``k`` along a direction."""
    i = INFORMATION
    _, xx, xy, xz, yy, yz, zz = invert_symmetric(
        points[k, i], points[k, i + 1], points[k, i + 2], points[k, i + 3], points[k, i + 4], points[k, i + 5]
    )
    form = dx * (xx * dx + 2.0 * (xy * dy + xz * dz)) + dy * (yy * dy + 2.0 * yz * dz) + dz * dz * zz
    return form / (length * length)
