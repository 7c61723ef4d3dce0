"""Scores of pairs of detections in one frame, and their points.

The log odds are those of :mod:`posefuse.kernels.association.log_odds`. See docs/methods/association.md.
"""

import math

import numpy as np

from posefuse.kernels.association.group_points import (
    GROUP_ITERATIONS,
    POINT,
    POINT_COLUMNS,
    VALID,
    GroupMembers,
    is_within_volume,
    residual_at,
    triangulate_group,
)
from posefuse.kernels.association.log_odds import bone_log_odds, pair_log_odds
from posefuse.kernels.jit import kernel


@kernel
def score_pairs(candidates, parameters, volume, pair_scores, seed_scores):
    """Compute the log odds that detections of different views show the same person, for all pairs.

    Args:
        candidates: detections of the frame.
        parameters: of the log odds.
        volume: shape (6,): low x y z, high x y z of the region where people can be.
        pair_scores: shape (detection, detection), written: log odds from the rays; -inf for impossible pairs.
        seed_scores: shape (detection, detection), written: the same plus the log odds of the bone lengths.
    """
    n_detections, n_core = candidates.weights.shape
    points = np.empty((n_core, POINT_COLUMNS))
    members = np.empty(2, np.int64)
    swapped = np.zeros(2, np.bool_)
    for a in range(n_detections):
        pair_scores[a, a] = -math.inf
        seed_scores[a, a] = -math.inf
        for b in range(a):
            odds = -math.inf
            bone_score = 0.0
            if candidates.views[a] != candidates.views[b] and candidates.allowed[a, b]:
                members[0] = b
                members[1] = a
                odds = pair_log_odds(candidates, parameters, members, swapped, points)
                if odds > -math.inf and is_within_volume(points, volume):
                    bone_score = bone_log_odds(candidates, parameters, points)
                else:
                    odds = -math.inf
            pair_scores[a, b] = odds
            pair_scores[b, a] = odds
            seed_scores[a, b] = odds + bone_score
            seed_scores[b, a] = odds + bone_score


@kernel
def triangulate_pairs(rays, weights, pairs, bodies, errors_px):
    """Triangulate all keypoints of pairs of detections, with the reprojection errors of both views.

    Args:
        rays: shape (detection, keypoint, 12).
        weights: shape (detection, keypoint).
        pairs: shape (pair, 2), int64.
        bodies: shape (pair, keypoint, 3), written; NaN where missing.
        errors_px: shape (pair, keypoint, 2), written.
    """
    n_core = weights.shape[1]
    points = np.empty((n_core, POINT_COLUMNS))
    mirror = np.arange(n_core)
    swapped = np.zeros(2, np.bool_)
    members = np.empty(2, np.int64)
    group = GroupMembers(rays, weights, mirror, members, swapped)
    for i in range(len(pairs)):
        members[0] = pairs[i, 0]
        members[1] = pairs[i, 1]
        triangulate_group(group, 2, GROUP_ITERATIONS, points)
        for k in range(n_core):
            valid = points[k, VALID] > 0.0
            for j in range(3):
                bodies[i, k, j] = points[k, POINT + j] if valid else math.nan
            for m in range(2):
                _, r, s = residual_at(rays, members[m], k, points[k, POINT], points[k, POINT + 1], points[k, POINT + 2])
                errors_px[i, k, m] = math.sqrt(r * r + s * s) if valid else math.nan


@kernel
def score_support(seed_scores, pair_scores, view, n_views, support_scores):
    """Score the support of each pair: its log odds plus those of the best common detection in every other view.

    Args:
        seed_scores: shape (detection, detection), from :func:`score_pairs`.
        pair_scores: shape (detection, detection).
        view: shape (detection,), int64.
        n_views: number of cameras.
        support_scores: shape (detection, detection), written below the diagonal; -inf above it and for pairs with
            non-positive log odds.
    """
    best = np.empty(n_views)
    for a in range(len(view)):
        for b in range(len(view)):
            support_scores[a, b] = -math.inf
            if b >= a or not seed_scores[a, b] > 0.0:
                continue
            best[:] = 0.0
            for c in range(len(view)):
                both = min(pair_scores[a, c], pair_scores[b, c])
                best[view[c]] = max(best[view[c]], both)
            support_scores[a, b] = seed_scores[a, b] + best.sum()


@kernel
def find_near_people(rays, weights, view, people_m, focal_px, within_m, core, near):
    """Find the already tracked people that each detection may show.

    Args:
        rays: shape (detection, core, 12).
        weights: shape (detection, core).
        view: shape (detection,), int64.
        people_m: shape (person, keypoint, 3), NaN where missing.
        focal_px: shape (view,).
        within_m: a detection may show a person if the mean distance of their keypoints, at their depth, is at most
            this.
        core: shape (core,), int64.
        near: shape (detection, person), bool, written.
    """
    for n in range(len(view)):
        for i in range(people_m.shape[0]):
            total = 0.0
            common = 0
            for j in range(len(core)):
                x = people_m[i, core[j], 0]
                y = people_m[i, core[j], 1]
                z = people_m[i, core[j], 2]
                if not (weights[n, j] > 0.0 and math.isfinite(x + y + z)):
                    continue
                depth = rays[n, j, 8] * x + rays[n, j, 9] * y + rays[n, j, 10] * z + rays[n, j, 11]
                r = rays[n, j, 0] * x + rays[n, j, 1] * y + rays[n, j, 2] * z + rays[n, j, 3]
                s = rays[n, j, 4] * x + rays[n, j, 5] * y + rays[n, j, 6] * z + rays[n, j, 7]
                off = math.sqrt(r * r + s * s) / focal_px[view[n]] if depth > 0.0 else math.inf
                total += min(off, 4.0 * within_m)
                common += 1
            near[n, i] = common > 0 and total <= within_m * common
