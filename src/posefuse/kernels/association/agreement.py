"""Whether detections of different views show one person: observations of single detections, points of a few of them.

Points and weights are those of :mod:`posefuse.kernels.cameras.points`, one keypoint at a time, for a handful of people in one
frame does not fill a block. Odds compare two explanations of where a keypoint lies in an image: Student's t (3 degrees
of freedom) about where other views expect it, or anywhere in a region ``clutter_px`` wide. See docs/methods.md,
"People from several views".
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.cameras.observation_rows import BLOCK, rows_block
from posefuse.kernels.cameras.points import invert_symmetric, solve_symmetric
from posefuse.kernels.jit import inline, kernel, step

# Columns of the array of points.
POINT = 0
INFORMATION = 3
"""Six numbers: the inverse of the covariance."""
COST = 9
"""Sum of squared residuals, in squared sigmas."""
KNOWN = 10
"""1 where there is a point in front of its views, else 0."""
POINT_COLUMNS = 11

# Student's t with 3 degrees of freedom at its middle, in one dimension.
_T3_MIDDLE = 0.3675525969478613
_HALF_TURN = 0.15915494309189535
_NORMAL_MIDDLE = 0.3989422804014327
# A view farther off than so many squared sigmas has no say in where a keypoint is.
_REACH_SQUARED = 25.0
_PAIR_ROUNDS = 1
_FIRST_FEW = 5
_PLAINLY_AGAINST = -1.0


class Sight(NamedTuple):
    """Detections that nobody claims, as observations of core keypoints.

    Attributes:
        views: shape (detection,), int64, not decreasing: each one's view.
        rays: shape (detection, core, 12), from :func:`observe`.
        weights: shape (detection, core), 1/px^2, 0 where there is no observation.
        mirror: shape (core,), int64: each keypoint's partner on the other side, or itself.
        bones: shape (bone, 4): two core keypoints, shortest and longest distance in m.
        allowed: shape (detection, detection), bool, symmetric: which may be of one person.
        clutter_px: shape (view,): width of the region where anything else may lie.
    """

    views: Any
    rays: Any
    weights: Any
    mirror: Any
    bones: Any
    allowed: Any
    clutter_px: Any


class Law(NamedTuple):
    """The numbers that odds are made of; :class:`posefuse.model.options.association.AssociationOptions` explains them.

    Attributes:
        min_common: with fewer common keypoints nothing is said.
        outlier_share: how many keypoints are wrong in a detection of the right person.
        independent: at most so many keypoints count.
        independent_bones: at most so many bones count.
        join: log odds from which on a detection joins a group.
        swap: log odds that a detection has its sides swapped.
        miss: log odds of a view that should show the person and does not.
        prior: log odds of a group before anything is known.
        near: detections of a view are of one person if on average so many sigmas apart.
        max_seeds: at most so many pairs are grown at a time.
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


@kernel
def observe(
    cameras,
    distorted,
    fisheye,
    keypoints_px,
    confidence,
    view,
    chosen,
    core,
    scale_px,
    exponent,
    min_confidence,
    rays,
    weights,
):
    """Observation rows and weights of single detections.

    Args:
        cameras: the camera array, shape (view, COLUMNS).
        distorted: None if the rig has no lens with distortion polynomials.
        fisheye: None if it has no fisheye.
        keypoints_px: shape (row, keypoint, 2), NaN where missing.
        confidence: shape (row, keypoint), NaN where the detector gives none.
        view: shape (row,), int64.
        chosen: shape (detection,), int64: the rows wanted.
        core: shape (core,), int64: the keypoints wanted.
        scale_px: shape (view,): the noise of a detection of confidence 1, in px per axis.
        exponent: the noise is ``scale_px / confidence^exponent``.
        min_confidence: keypoints below are not used.
        rays: shape (detection, core, 12), written: g0, g1, c of :func:`posefuse.kernels.cameras.observation_rows.rows_block`.
        weights: shape (detection, core), written: 1 / sigma^2 in 1/px^2, 0 where there is no observation.
    """
    n_views = cameras.shape[0]
    pixels = np.empty((n_views, 2, BLOCK))
    block_codes = np.empty((n_views, BLOCK), np.int64)
    block_rows = np.empty((n_views, 12, BLOCK))
    scratch = np.empty((6, BLOCK))
    for n in range(len(chosen)):
        row = chosen[n]
        v = view[row]
        base = 1.0 / (scale_px[v] * scale_px[v])
        for first in range(0, len(core), BLOCK):
            here = min(BLOCK, len(core) - first)
            for j in range(BLOCK):
                pixels[v, 0, j] = keypoints_px[row, core[first + j], 0] if j < here else math.nan
                pixels[v, 1, j] = keypoints_px[row, core[first + j], 1] if j < here else math.nan
            rows_block(cameras, distorted, fisheye, v, pixels, block_codes, block_rows, scratch)
            for j in range(here):
                c = confidence[row, core[first + j]]
                trust = c if c == c else 1.0
                usable = (block_codes[v, j] == OK) & (trust >= min_confidence) & (trust > 0.0)
                weight = base * trust ** (2.0 * exponent) if usable else 0.0
                weights[n, first + j] = weight
                for i in range(12):
                    rays[n, first + j, i] = block_rows[v, i, j]


@inline
def look(rays, n, k, x, y, z):
    """What detection ``n`` says of a point as its keypoint ``k``: ``(depth, r, s)``, the residual in px."""
    depth = rays[n, k, 8] * x + rays[n, k, 9] * y + rays[n, k, 10] * z + rays[n, k, 11]
    inverse = 1.0 / depth
    r = (rays[n, k, 0] * x + rays[n, k, 1] * y + rays[n, k, 2] * z + rays[n, k, 3]) * inverse
    s = (rays[n, k, 4] * x + rays[n, k, 5] * y + rays[n, k, 6] * z + rays[n, k, 7]) * inverse
    return depth, r, s


@inline
def slopes(rays, n, k, depth, r, s):
    """The derivative of the residual at a point, six numbers: of r, then of s."""
    inverse = 1.0 / depth
    c0 = inverse * rays[n, k, 8]
    c1 = inverse * rays[n, k, 9]
    c2 = inverse * rays[n, k, 10]
    return (
        inverse * rays[n, k, 0] - r * c0,
        inverse * rays[n, k, 1] - r * c1,
        inverse * rays[n, k, 2] - r * c2,
        inverse * rays[n, k, 4] - s * c0,
        inverse * rays[n, k, 5] - s * c1,
        inverse * rays[n, k, 6] - s * c2,
    )


@inline
def as_labelled(k, swapped, mirror):
    """The keypoint whose ray stands for keypoint ``k``: its partner's where left and right are swapped."""
    return mirror[k] if swapped else k


@inline
def _equations(a0, a1, a2, b0, b1, b2, r, s, w, sums):
    """Add two residuals of weight ``w``, whose derivatives are a and b, to nine sums."""
    xx, xy, xz, yy, yz, zz, gx, gy, gz = sums
    return (
        xx + w * (a0 * a0 + b0 * b0),
        xy + w * (a0 * a1 + b0 * b1),
        xz + w * (a0 * a2 + b0 * b2),
        yy + w * (a1 * a1 + b1 * b1),
        yz + w * (a1 * a2 + b1 * b2),
        zz + w * (a2 * a2 + b2 * b2),
        gx + w * (a0 * r + b0 * s),
        gy + w * (a1 * r + b1 * s),
        gz + w * (a2 * r + b2 * s),
    )


@step
def _algebraic(rays, weights, mirror, members, swapped, count, k):
    """Where the depth-weighted residuals of all members are least: ``(found, x, y, z)``."""
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    seen = 0
    for i in range(count):
        n = members[i]
        m = as_labelled(k, swapped[i], mirror)
        if weights[n, m] > 0.0:
            seen += 1
            sums = _equations(
                rays[n, m, 0],
                rays[n, m, 1],
                rays[n, m, 2],
                rays[n, m, 4],
                rays[n, m, 5],
                rays[n, m, 6],
                rays[n, m, 3],
                rays[n, m, 7],
                weights[n, m],
                sums,
            )
    solved, x, y, z = solve_symmetric(*sums)
    return solved & (seen >= 2), -x, -y, -z


@step
def _around(rays, weights, mirror, members, swapped, count, k, x, y, z, reach):
    """Robust normal equations at a point: ``(front, cost, nine sums)``; members beyond ``reach`` sigma^2 fade out."""
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cost = 0.0
    front = 0
    for i in range(count):
        n = members[i]
        m = as_labelled(k, swapped[i], mirror)
        w = weights[n, m]
        if not w > 0.0:
            continue
        depth, r, s = look(rays, n, m, x, y, z)
        squared = w * (r * r + s * s)
        if depth > 0.0:
            front += 1
            cost += min(squared, reach)
            fall = max(1.0 - squared / reach, 0.0)
            sums = _equations(*slopes(rays, n, m, depth, r, s), r, s, w * fall * fall, sums)
        else:
            cost += reach
    return front, cost, sums


@step
def locate_one(rays, weights, mirror, members, swapped, count, rounds, k, points):
    """The point of core keypoint ``k``, if at least two members show it; arguments as of :func:`locate`."""
    points[k, KNOWN] = 0.0
    found, x, y, z = _algebraic(rays, weights, mirror, members, swapped, count, k)
    if not found:
        return
    # Two views have nobody to overrule either.
    reach = math.inf
    for turn in range(rounds + 1):
        if count > 2:
            reach = 4.0 * _REACH_SQUARED if turn < 2 else _REACH_SQUARED
        front, cost, sums = _around(rays, weights, mirror, members, swapped, count, k, x, y, z, reach)
        if front < 2:
            return
        if turn < rounds:
            solved, sx, sy, sz = solve_symmetric(*sums)
            if not solved:
                return
            x -= sx
            y -= sy
            z -= sz
        else:
            points[k, POINT] = x
            points[k, POINT + 1] = y
            points[k, POINT + 2] = z
            for i in range(6):
                points[k, INFORMATION + i] = sums[i]
            points[k, COST] = cost
            points[k, KNOWN] = 1.0


@step
def locate(rays, weights, mirror, members, swapped, count, rounds, points):
    """Points of every core keypoint that at least two members show.

    Args:
        rays: from :func:`observe`.
        weights: from :func:`observe`.
        mirror: shape (core,), int64: each keypoint's partner.
        members: shape (at least count,), int64: detections.
        swapped: shape (at least count,), bool: whose left and right are swapped.
        count: of members.
        rounds: of Gauss-Newton after the algebraic start; with more than two members, reweighted.
        points: shape (core, POINT_COLUMNS), written.
    """
    for k in range(weights.shape[1]):
        locate_one(rays, weights, mirror, members, swapped, count, rounds, k, points)


@inline
def _odds(likeness, outlier_share):
    """Log odds of one keypoint: ``likeness`` is how many times likelier it lies there if it is the person's."""
    return math.log((1.0 - outlier_share) * likeness + outlier_share)


@inline
def _evidence(total, common, min_common, independent):
    """Log odds of neighbouring keypoints that err together: no more than so many count as independent."""
    return total / common * min(float(common), independent) if common >= min_common else 0.0


@step
def pair_odds(sight, law, members, swapped, points):
    """Log odds that two detections show one person, from how near their rays pass.

    Two rays have one residual more than a point has unknowns, so a keypoint's cost is a squared t variable with one
    degree of freedom. When the first few keypoints are plainly against it the rest is not looked at.

    Args:
        sight: of the frame.
        law: of odds.
        members: shape (at least 2,), int64: the two.
        swapped: shape (at least 2,), bool.
        points: shape (core, POINT_COLUMNS), written.

    Returns:
        The odds; -inf where the rest was not looked at, ``points`` is then not whole.
    """
    weights = sight.weights
    a = members[0]
    b = members[1]
    clutter = sight.clutter_px[sight.views[a]] * sight.clutter_px[sight.views[b]]
    total = 0.0
    common = 0
    for k in range(weights.shape[1]):
        points[k, KNOWN] = 0.0
        both = weights[a, k] * weights[b, k]
        if not both > 0.0:
            continue
        common += 1
        locate_one(sight.rays, weights, sight.mirror, members, swapped, 2, _PAIR_ROUNDS, k, points)
        likeness = 0.0
        if points[k, KNOWN] > 0.0:
            far = 1.0 + points[k, COST] * (1.0 / 3.0)
            likeness = math.sqrt(0.5 * clutter * math.sqrt(both)) * _T3_MIDDLE / (far * far)
        total += _odds(likeness, law.outlier_share)
        if common == _FIRST_FEW and total < _PLAINLY_AGAINST * common:
            return -math.inf
    return _evidence(total, common, law.min_common, law.independent)


@step
def join_odds(sight, law, points, n, swapped):
    """Log odds that a detection shows the person whose points are known from other views.

    The keypoint is expected with the covariance of the point, projected, and its own; a point that is poorly known
    therefore says little.

    Args:
        sight: of the frame.
        law: of odds.
        points: of the group, from :func:`locate`.
        n: the detection.
        swapped: whether its left and right are taken as swapped.
    """
    rays, weights = sight.rays, sight.weights
    clutter = sight.clutter_px[sight.views[n]]
    total = 0.0
    common = 0
    for k in range(weights.shape[1]):
        m = as_labelled(k, swapped, sight.mirror)
        if points[k, KNOWN] == 0.0 or not weights[n, m] > 0.0:
            continue
        common += 1
        depth, r, s = look(rays, n, m, points[k, POINT], points[k, POINT + 1], points[k, POINT + 2])
        likeness = 0.0
        if depth > 0.0:
            xx, xy, yy = _expected_spread(rays, points, n, m, k, depth, r, s, 1.0 / weights[n, m])
            determinant = xx * yy - xy * xy
            far = 1.0 + (yy * r * r - 2.0 * xy * r * s + xx * s * s) / determinant * (1.0 / 3.0)
            likeness = clutter * clutter * _HALF_TURN / (math.sqrt(determinant * far) * far * far)
        total += _odds(likeness, law.outlier_share)
    return _evidence(total, common, law.min_common, law.independent)


@inline
def _expected_spread(rays, points, n, m, k, depth, r, s, own):
    """Covariance in px^2 of a residual: of the point, projected, and the detection's own: ``(xx, xy, yy)``."""
    i = INFORMATION
    _, cxx, cxy, cxz, cyy, cyz, czz = invert_symmetric(
        points[k, i], points[k, i + 1], points[k, i + 2], points[k, i + 3], points[k, i + 4], points[k, i + 5]
    )
    a0, a1, a2, b0, b1, b2 = slopes(rays, n, m, depth, r, s)
    p0 = cxx * a0 + cxy * a1 + cxz * a2
    p1 = cxy * a0 + cyy * a1 + cyz * a2
    p2 = cxz * a0 + cyz * a1 + czz * a2
    q0 = cxx * b0 + cxy * b1 + cxz * b2
    q1 = cxy * b0 + cyy * b1 + cyz * b2
    q2 = cxz * b0 + cyz * b1 + czz * b2
    return (
        a0 * p0 + a1 * p1 + a2 * p2 + own,
        b0 * p0 + b1 * p1 + b2 * p2,
        b0 * q0 + b1 * q1 + b2 * q2 + own,
    )


@step
def bone_odds(sight, law, points):
    """Log odds of the lengths between keypoints, if the body's are and if anything is.

    A body's length is taken as normally distributed with its plausible range as plus and minus three sigmas, anything
    else as even up to twice the longest.

    Args:
        sight: of the frame.
        law: of odds.
        points: shape (core, POINT_COLUMNS).
    """
    bones = sight.bones
    total = 0.0
    known = 0
    for i in range(bones.shape[0]):
        a = int(bones[i, 0])
        b = int(bones[i, 1])
        if points[a, KNOWN] == 0.0 or points[b, KNOWN] == 0.0:
            continue
        dx = points[a, POINT] - points[b, POINT]
        dy = points[a, POINT + 1] - points[b, POINT + 1]
        dz = points[a, POINT + 2] - points[b, POINT + 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        off = length - 0.5 * (bones[i, 2] + bones[i, 3])
        own = (bones[i, 3] - bones[i, 2]) * (1.0 / 6.0)
        variance = own * own
        variance += _variance_along(points, a, dx, dy, dz, length) + _variance_along(points, b, dx, dy, dz, length)
        likeness = 2.0 * bones[i, 3] * math.exp(-0.5 * off * off / variance) / math.sqrt(variance) * _NORMAL_MIDDLE
        total += _odds(likeness, law.outlier_share)
        known += 1
    return _evidence(total, known, 1, law.independent_bones)


@inline
def _variance_along(points, k, dx, dy, dz, length):
    """Variance in m^2 of point ``k`` in a direction."""
    i = INFORMATION
    _, xx, xy, xz, yy, yz, zz = invert_symmetric(
        points[k, i], points[k, i + 1], points[k, i + 2], points[k, i + 3], points[k, i + 4], points[k, i + 5]
    )
    form = dx * (xx * dx + 2.0 * (xy * dy + xz * dz)) + dy * (yy * dy + 2.0 * yz * dz) + dz * dz * zz
    return form / (length * length)


@inline
def middle(points):
    """The mean of the points that are known, and how many they are: ``(count, x, y, z)``."""
    known = 0
    x = 0.0
    y = 0.0
    z = 0.0
    for k in range(points.shape[0]):
        if points[k, KNOWN] > 0.0:
            known += 1
            x += points[k, POINT]
            y += points[k, POINT + 1]
            z += points[k, POINT + 2]
    return known, x / known, y / known, z / known


@step
def within(points, volume):
    """Whether the middle of the known points lies in a box, low x y z then high."""
    known, x, y, z = middle(points)
    low = (x >= volume[0]) & (y >= volume[1]) & (z >= volume[2])
    return (known > 0) & low & (x <= volume[3]) & (y <= volume[4]) & (z <= volume[5])
