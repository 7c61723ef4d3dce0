"""Points that a few detections determine, one keypoint at a time.

Points and weights follow :mod:`posefuse.kernels.cameras.points`, but one keypoint at a time, because the few people of
one frame do not fill a block.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.cameras.observation_rows import BLOCK, rows_block
from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.linear_algebra.symmetric_3x3 import solve_symmetric

# Columns of the array of points.
POINT = 0


INFORMATION = 3
"""Six numbers: the inverse covariance."""


COST = 9
"""Sum of squared residuals, in squared sigmas."""


VALID = 10
"""1 if the point was solved and lies in front of its views, else 0."""


POINT_COLUMNS = 11

GROUP_ITERATIONS = 3
"""Gauss-Newton iterations of the points of a group."""


# A view whose squared residual exceeds this many squared sigmas has weight 0.
_CUTOFF_SQUARED = 25.0


class GroupMembers(NamedTuple):
    """Detections that show the same person.

    Attributes:
        rays: shape (detection, core, 12), from :func:`compute_observations`.
        weights: shape (detection, core), likewise.
        mirror: shape (core,), int64: the partner of each keypoint.
        members: shape (at least the number of members,), int64: detections.
        swapped: shape (at least the number of members,), bool: whether left and right are swapped in each member.
    """

    rays: Any
    weights: Any
    mirror: Any
    members: Any
    swapped: Any


@kernel
def compute_observations(cameras, detections, noise, selected, core, rays, weights):
    """Compute observation rows and weights of single detections.

    Args:
        cameras: the camera array.
        detections: Detections.
        noise: NoiseParameters.
        selected: shape (detection,), int64: the rows to use.
        core: shape (core,), int64: the keypoints to use.
        rays: shape (detection, core, 12), written: g0, g1, c of
            :func:`posefuse.kernels.cameras.observation_rows.rows_block`.
        weights: shape (detection, core), written: 1 / sigma^2 in 1/px^2, 0 where there is no observation.
    """
    keypoints_px, confidence, view = detections
    scale_px, exponent, min_confidence = noise
    n_views = cameras.shape[0]
    pixels = np.empty((n_views, 2, BLOCK))
    block_codes = np.empty((n_views, BLOCK), np.int64)
    block_rows = np.empty((n_views, 12, BLOCK))
    scratch = np.empty((6, BLOCK))
    for n in range(len(selected)):
        row = selected[n]
        v = view[row]
        base = 1.0 / (scale_px[v] * scale_px[v])
        for first in range(0, len(core), BLOCK):
            here = min(BLOCK, len(core) - first)
            for j in range(BLOCK):
                pixels[v, 0, j] = keypoints_px[row, core[first + j], 0] if j < here else math.nan
                pixels[v, 1, j] = keypoints_px[row, core[first + j], 1] if j < here else math.nan
            rows_block(cameras, v, pixels, block_codes, block_rows, scratch)
            for j in range(here):
                c = confidence[row, core[first + j]]
                usable_confidence = c if c == c else 1.0
                usable = (block_codes[v, j] == OK) & (usable_confidence >= min_confidence) & (usable_confidence > 0.0)
                weight = base * usable_confidence ** (2.0 * exponent) if usable else 0.0
                weights[n, first + j] = weight
                for i in range(12):
                    rays[n, first + j, i] = block_rows[v, i, j]


@inline
def residual_at(rays, n, k, x, y, z):
    """Return ``(depth, r, s)`` of a point seen as keypoint ``k`` of detection ``n``; the residual (r, s) is in px."""
    depth = rays[n, k, 8] * x + rays[n, k, 9] * y + rays[n, k, 10] * z + rays[n, k, 11]
    inverse = 1.0 / depth
    r = (rays[n, k, 0] * x + rays[n, k, 1] * y + rays[n, k, 2] * z + rays[n, k, 3]) * inverse
    s = (rays[n, k, 4] * x + rays[n, k, 5] * y + rays[n, k, 6] * z + rays[n, k, 7]) * inverse
    return depth, r, s


@inline
def residual_derivative(rays, n, k, depth, r, s):
    """Return the derivative of the residual with respect to the point: three numbers of r, then three of s."""
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
def keypoint_index(k, swapped, mirror):
    """Return the keypoint whose ray observes keypoint ``k``: its mirror partner if left and right are swapped."""
    return mirror[k] if swapped else k


@inline
def _add_normal_equations(a0, a1, a2, b0, b1, b2, r, s, w, sums):
    """Add two residuals of weight ``w``, with derivatives a and b, to nine sums."""
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


@subroutine
def _linear_point(group, count, k):
    """Return ``(solved, x, y, z)`` with the least depth-weighted (algebraic) residuals over all members."""
    rays, weights, mirror, members, swapped = group
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    n_views = 0
    for i in range(count):
        n = members[i]
        m = keypoint_index(k, swapped[i], mirror)
        if weights[n, m] > 0.0:
            n_views += 1
            sums = _add_normal_equations(
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
    return solved & (n_views >= 2), -x, -y, -z


@subroutine
def _robust_equations(group, count, k, x, y, z, cutoff):
    """Return ``(n_front, cost, nine sums)`` at a point; the weight of a member falls to 0 at ``cutoff`` sigma^2."""
    rays, weights, mirror, members, swapped = group
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cost = 0.0
    front = 0
    for i in range(count):
        n = members[i]
        m = keypoint_index(k, swapped[i], mirror)
        w = weights[n, m]
        if not w > 0.0:
            continue
        depth, r, s = residual_at(rays, n, m, x, y, z)
        squared = w * (r * r + s * s)
        if depth > 0.0:
            front += 1
            cost += min(squared, cutoff)
            falloff = max(1.0 - squared / cutoff, 0.0)
            sums = _add_normal_equations(
                *residual_derivative(rays, n, m, depth, r, s), r, s, w * falloff * falloff, sums
            )
        else:
            cost += cutoff
    return front, cost, sums


@subroutine
def triangulate_keypoint(group, count, iterations, k, points):
    """Triangulate core keypoint ``k`` if at least two members observe it; see :func:`triangulate_group`."""
    points[k, VALID] = 0.0
    solved_linear, x, y, z = _linear_point(group, count, k)
    if not solved_linear:
        return
    # With two views no residual can identify an outlier, so nothing is down-weighted.
    cutoff = math.inf
    for iteration in range(iterations + 1):
        if count > 2:
            cutoff = 4.0 * _CUTOFF_SQUARED if iteration < 2 else _CUTOFF_SQUARED
        front, cost, sums = _robust_equations(group, count, k, x, y, z, cutoff)
        if front < 2:
            return
        if iteration < iterations:
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
            points[k, VALID] = 1.0


@subroutine
def triangulate_group(group, count, iterations, points):
    """Triangulate every core keypoint that at least two members observe.

    Args:
        group: GroupMembers.
        count: number of members.
        iterations: Gauss-Newton iterations after the linear start; with more than two members they are reweighted.
        points: shape (core, POINT_COLUMNS), written.
    """
    for k in range(group.weights.shape[1]):
        triangulate_keypoint(group, count, iterations, k, points)


@inline
def centroid(points):
    """Return ``(count, x, y, z)``: the number of valid points and their mean."""
    n_valid = 0
    x = 0.0
    y = 0.0
    z = 0.0
    for k in range(points.shape[0]):
        if points[k, VALID] > 0.0:
            n_valid += 1
            x += points[k, POINT]
            y += points[k, POINT + 1]
            z += points[k, POINT + 2]
    return n_valid, x / n_valid, y / n_valid, z / n_valid


@subroutine
def is_within_volume(points, volume):
    """Return whether the mean of the valid points lies in a box (low x y z, then high x y z)."""
    n_valid, x, y, z = centroid(points)
    low = (x >= volume[0]) & (y >= volume[1]) & (z >= volume[2])
    return (n_valid > 0) & low & (x <= volume[3]) & (y <= volume[4]) & (z <= volume[5])
