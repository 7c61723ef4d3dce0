"""Data association per view: log odds of track-detection pairs, with or without swapped sides, and best matching.

A keypoint of a detection is either at the predicted position of the person (Student t distribution in two dimensions,
widened by the uncertainty of the person) or anywhere within an area of about the person's size. The score of a
detection is the mean log likelihood ratio of its keypoints, counted as a limited number of keypoints, because the
keypoints of a wrong person are wrong together.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.tracking.error_model import variance_factor
from posefuse.kernels.tracking.screening import Screening, arrange_detections, arrange_person, may_match

_FORBIDDEN_COST = 1e9
_MARGIN = 1.0 + 1e-9


@inline
def keypoint_log_odds(du, dv, uu, uv, vv, nu, area, min_log_odds, min_odds):
    """Return the log likelihood ratio of a residual: this keypoint against a uniform density over ``area``, px^2.

    Most keypoints belong to other people and lie far away. Whether the ratio falls below its lower bound,
    ``min_odds = exp(-min_log_odds)``, is tested without a logarithm: ``s^(1 + nu / 2)`` is at least ``s`` for s > 1,
    and at least its square if nu is 2 or more.
    """
    determinant = uu * vv - uv * uv
    squared = (vv * du * du - 2.0 * uv * du * dv + uu * dv * dv) / determinant
    density_ratio = area / (2.0 * math.pi * math.sqrt(determinant))
    growth = 1.0 + squared / nu
    if (growth * growth if nu >= 2.0 else growth) > _MARGIN * density_ratio * min_odds:
        return min_log_odds
    ratio = math.log(density_ratio) - 0.5 * (nu + 2.0) * math.log(growth)
    return ratio if ratio > min_log_odds else min_log_odds


class Scoring(NamedTuple):
    """What scores a keypoint: noise variances, shape (row, keypoint), px^2, and numbers.

    The numbers are those of the error model and of MatchParameters, and ``min_odds = exp(-min_log_odds)``.
    """

    noise_px2: Any
    floor_m: float
    nu: float
    clutter_m: float
    min_log_odds: float
    min_odds: float


class _AssignmentWorkspace(NamedTuple):
    """Scratch arrays of an assignment of n rows to m columns, each of shape (m + n + 1,); ``potential_row`` (n,)."""

    row_of_column: Any
    potential_row: Any
    potential_column: Any
    slack: Any
    previous: Any
    visited: Any


@subroutine
def score_keypoint(projected, keypoints_px, scoring, p, row, v, k, label):
    """Return the log odds of one keypoint under one label, NaN where it is missing."""
    noise_px2 = scoring.noise_px2
    du = keypoints_px[row, label, 0] - projected.pixels[p, v, k, 0]
    dv = keypoints_px[row, label, 1] - projected.pixels[p, v, k, 1]
    if not math.isfinite(du + dv + noise_px2[row, label]):
        return math.nan
    px_per_m = projected.scale_px_per_m[p, v, k]
    noise = noise_px2[row, label] + (scoring.floor_m * px_per_m) ** 2
    uu = projected.pixel_covariance[p, v, k, 0] + noise
    vv = projected.pixel_covariance[p, v, k, 2] + noise
    return keypoint_log_odds(
        du,
        dv,
        uu,
        projected.pixel_covariance[p, v, k, 1],
        vv,
        scoring.nu,
        (scoring.clutter_m * px_per_m) ** 2,
        scoring.min_log_odds,
        scoring.min_odds,
    )


@subroutine
def compute_noise(confidence, view_of_row, error_model, noise_px2):
    """Write the noise variance of each keypoint, px^2 per axis; NaN where its confidence is too low."""
    for row in range(confidence.shape[0]):
        scale = error_model.scale_px[view_of_row[row]]
        for k in range(confidence.shape[1]):
            keypoint_confidence = confidence[row, k]
            growth = variance_factor(keypoint_confidence, error_model.exponent)
            noise_px2[row, k] = math.nan if keypoint_confidence < error_model.min_confidence else scale * scale * growth


@subroutine
def _sum_log_odds(projected, keypoints_px, scoring, sides, screening, p, row, v):
    """Sum the log odds of keypoints by limb, with labels as they are and swapped, in the screening.

    Args:
        projected: ProjectedKeypoints.
        keypoints_px: shape (row, keypoint, 2).
        scoring: a Scoring.
        sides: SideGroups.
        screening: a Screening of the pair.
        p: the person.
        row: the detection.
        v: its view.

    Returns:
        The sum of keypoints outside all limbs, and the number of all keypoints.
    """
    mirror, group_of, n_groups = sides
    is_least, sums = screening.is_least, screening.sums
    total = 0.0
    count = 0
    for g in range(n_groups):
        sums[0, g] = 0.0
        sums[1, g] = 0.0
    for k in range(mirror.shape[0]):
        unswapped = is_least[0, k] * scoring.min_log_odds
        if is_least[0, k] == 0.0:
            unswapped = score_keypoint(projected, keypoints_px, scoring, p, row, v, k, k)
        count += 1 if unswapped == unswapped else 0
        g = group_of[k]
        if g < 0:
            total += unswapped if unswapped == unswapped else 0.0
            continue
        mirrored = is_least[1, k] * scoring.min_log_odds
        if is_least[1, k] == 0.0:
            mirrored = score_keypoint(projected, keypoints_px, scoring, p, row, v, k, mirror[k])
        sums[0, g] += unswapped if unswapped == unswapped else 0.0
        sums[1, g] += mirrored if mirrored == mirrored else 0.0
    return total, count


@kernel
def score_detections(projected, detections, sides, error_model, swap_probability, parameters, out):
    """Score every detection against every person.

    Pairs whose score is certainly below the least one that counts have a score of -inf, and unswapped sides.

    Args:
        projected: ProjectedKeypoints.
        detections: Detections.
        sides: SideGroups.
        error_model: an ErrorModel.
        swap_probability: shape (person, view, group): prior probability that the limb is swapped.
        parameters: MatchParameters.
        out: DetectionScores, written.

    Returns:
        Number of pairs whose keypoints were compared.
    """
    keypoints_px, confidence, view_of_row = detections
    n_groups = sides.n_groups
    clutter_m, min_log_odds, max_keypoints, _ = parameters
    scores, swapped, swap_odds = out
    n_people, n_views, n_keypoints = projected.scale_px_per_m.shape
    n_rows = confidence.shape[0]
    noise_px2 = np.empty(confidence.shape)
    compute_noise(confidence, view_of_row, error_model, noise_px2)
    scoring = Scoring(noise_px2, error_model.floor_m, error_model.nu, clutter_m, min_log_odds, math.exp(-min_log_odds))
    screening = Screening(
        shown=np.empty((2, 3, n_rows, n_keypoints)),
        predicted=np.empty((n_views, 7, n_keypoints)),
        log_noise=np.empty(n_rows),
        is_least=np.empty((2, n_keypoints)),
        sums=np.empty((2, n_groups)),
    )
    arrange_detections(keypoints_px, noise_px2, sides.mirror, screening)
    sums = screening.sums
    prior = np.empty((n_views, n_groups))
    most = np.empty(n_views)
    n_compared = 0
    for p in range(n_people):
        arrange_person(projected, scoring, p, screening.predicted, most)
        for v in range(n_views):
            for g in range(n_groups):
                prior[v, g] = math.log(swap_probability[p, v, g] / (1.0 - swap_probability[p, v, g]))
        for row in range(n_rows):
            v = view_of_row[row]
            if not may_match(screening, scoring, row, v, most[v], parameters):
                scores[p, row] = -math.inf
                for g in range(n_groups):
                    swapped[p, row, g] = 0
                    swap_odds[p, row, g] = prior[v, g]
                continue
            n_compared += 1
            total, count = _sum_log_odds(projected, keypoints_px, scoring, sides, screening, p, row, v)
            for g in range(n_groups):
                swap_odds[p, row, g] = sums[1, g] - sums[0, g] + prior[v, g]
                is_swapped = swap_odds[p, row, g] > 0.0
                swapped[p, row, g] = 1 if is_swapped else 0
                total += sums[1, g] if is_swapped else sums[0, g]
            scores[p, row] = total / count * min(float(count), max_keypoints)
    return n_compared


@inline
def _assignment_cost(gain, row, j, m, min_log_odds):
    """Return the cost of a row and a column; columns from ``m`` on leave a row unassigned."""
    if j >= m:
        return -min_log_odds if j - m == row else _FORBIDDEN_COST
    return -gain[row, j] if gain[row, j] > min_log_odds else _FORBIDDEN_COST


@inline
def _next_column(gain, n, m, min_log_odds, column, workspace):
    """Return the next column on the shortest path; potentials change so that the step to it is free."""
    row_of_column, potential_row, potential_column, slack, previous, visited = workspace
    width = m + n
    row = row_of_column[column]
    delta = math.inf
    next_column = -1
    for j in range(width):
        if visited[j]:
            continue
        reduced = _assignment_cost(gain, row, j, m, min_log_odds) - potential_row[row] - potential_column[j]
        if reduced < slack[j]:
            slack[j] = reduced
            previous[j] = column
        if slack[j] < delta:
            delta = slack[j]
            next_column = j
    for j in range(width + 1):
        if visited[j]:
            potential_row[row_of_column[j]] += delta
            potential_column[j] -= delta
        else:
            slack[j] -= delta
    return next_column


@subroutine
def assign(gain, n, m, min_log_odds, column_of_row, workspace):
    """Assign ``n`` rows to ``m`` columns with the highest total gain; only gains above ``min_log_odds`` count.

    Shortest augmenting paths (Jonker & Volgenant 1987). Every row has an additional column of its own that leaves it
    unassigned.

    Args:
        gain: shape (n, m).
        n: number of rows.
        m: number of columns.
        min_log_odds: threshold of the gain.
        column_of_row: shape (n,), written: the column of each row, -1 for none.
        workspace: an _AssignmentWorkspace.
    """
    row_of_column, potential_row, potential_column, slack, previous, visited = workspace
    width = m + n
    for j in range(width + 1):
        row_of_column[j] = -1
        potential_column[j] = 0.0
    for i in range(n):
        potential_row[i] = 0.0
    for i in range(n):
        row_of_column[width] = i
        column = width
        for j in range(width + 1):
            slack[j] = math.inf
            visited[j] = False
            previous[j] = width
        while row_of_column[column] >= 0:
            visited[column] = True
            column = _next_column(gain, n, m, min_log_odds, column, workspace)
        while column != width:
            row_of_column[column] = row_of_column[previous[column]]
            column = previous[column]
    for i in range(n):
        column_of_row[i] = -1
    for j in range(m):
        if row_of_column[j] >= 0:
            column_of_row[row_of_column[j]] = j


@kernel
def match_views(scores, view_of_row, n_views, min_log_odds, rows):
    """Find, for each view, the one-to-one matching of people and detections with the highest total score.

    Args:
        scores: shape (person, row).
        view_of_row: shape (row,), int64, ascending.
        n_views: number of views.
        min_log_odds: a detection with a score at or below this stays unassigned.
        rows: shape (person, view), int64, written: -1 for none.
    """
    n = scores.shape[0]
    n_detections = scores.shape[1]
    size = n + n_detections + 1
    gain = np.empty((n, n_detections))
    column_of_row = np.empty(n, np.int64)
    workspace = _AssignmentWorkspace(
        row_of_column=np.empty(size, np.int64),
        potential_row=np.empty(n),
        potential_column=np.empty(size),
        slack=np.empty(size),
        previous=np.empty(size, np.int64),
        visited=np.empty(size, np.bool_),
    )
    first = 0
    for v in range(n_views):
        last = first
        while last < n_detections and view_of_row[last] == v:
            last += 1
        for i in range(n):
            for j in range(first, last):
                gain[i, j - first] = scores[i, j]
        assign(gain, n, last - first, min_log_odds, column_of_row, workspace)
        for i in range(n):
            rows[i, v] = first + column_of_row[i] if column_of_row[i] >= 0 else -1
        first = last
