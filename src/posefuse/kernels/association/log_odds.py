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
    residual_at,
    residual_derivative,
    triangulate_keypoint,
)
from posefuse.kernels.jit import inline, subroutine
from posefuse.kernels.linear_algebra.symmetric_3x3 import invert_symmetric

# Density of the Student t distribution with 3 degrees of freedom at its center, in one dimension.
_T3_PEAK = 0.3675525969478613


_INVERSE_TWO_PI = 0.15915494309189535


_NORMAL_PEAK = 0.3989422804014327


_PAIR_ITERATIONS = 1


_EARLY_COUNT = 5


_EARLY_REJECTION = -1.0


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


@subroutine
def join_log_odds(candidates, parameters, points, n, swapped):
    """Return the log odds that a detection shows the person whose points other views determine.

    The predicted position has the projected covariance of the point plus the variance of the detection, so an uncertain
    point contributes little.

    Args:
        candidates: detections of the frame.
        parameters: of the log odds.
        points: points of the group, from :func:`triangulate_group`.
        n: the detection.
        swapped: whether to take left and right of the detection as swapped.
    """
    rays, weights = candidates.rays, candidates.weights
    clutter = candidates.clutter_px[candidates.views[n]]
    total = 0.0
    common = 0
    for k in range(weights.shape[1]):
        m = keypoint_index(k, swapped, candidates.mirror)
        if points[k, VALID] == 0.0 or not weights[n, m] > 0.0:
            continue
        common += 1
        depth, r, s = residual_at(rays, n, m, points[k, POINT], points[k, POINT + 1], points[k, POINT + 2])
        likelihood_ratio = 0.0
        if depth > 0.0:
            xx, xy, yy = _innovation_covariance(rays, points[k], n, m, depth, r, s, 1.0 / weights[n, m])
            determinant = xx * yy - xy * xy
            spread_factor = 1.0 + (yy * r * r - 2.0 * xy * r * s + xx * s * s) / determinant * (1.0 / 3.0)
            likelihood_ratio = (
                clutter
                * clutter
                * _INVERSE_TWO_PI
                / (math.sqrt(determinant * spread_factor) * spread_factor * spread_factor)
            )
        total += _keypoint_log_odds(likelihood_ratio, parameters.outlier_share)
    return _effective_log_odds(total, common, parameters.min_common, parameters.independent)


@inline
def _innovation_covariance(rays, point, n, m, depth, r, s, own_variance):
    """Return the residual covariance ``(xx, xy, yy)`` in px^2: the projected point plus the detection noise."""
    i = INFORMATION
    _, cxx, cxy, cxz, cyy, cyz, czz = invert_symmetric(
        point[i], point[i + 1], point[i + 2], point[i + 3], point[i + 4], point[i + 5]
    )
    a0, a1, a2, b0, b1, b2 = residual_derivative(rays, n, m, depth, r, s)
    p0 = cxx * a0 + cxy * a1 + cxz * a2
    p1 = cxy * a0 + cyy * a1 + cyz * a2
    p2 = cxz * a0 + cyz * a1 + czz * a2
    q0 = cxx * b0 + cxy * b1 + cxz * b2
    q1 = cxy * b0 + cyy * b1 + cyz * b2
    q2 = cxz * b0 + cyz * b1 + czz * b2
    return (
        a0 * p0 + a1 * p1 + a2 * p2 + own_variance,
        b0 * p0 + b1 * p1 + b2 * p2,
        b0 * q0 + b1 * q1 + b2 * q2 + own_variance,
    )


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
        likelihood_ratio = (
            2.0 * bones[i, 3] * math.exp(-0.5 * deviation * deviation / variance) / math.sqrt(variance) * _NORMAL_PEAK
        )
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
