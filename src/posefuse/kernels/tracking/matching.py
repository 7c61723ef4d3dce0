"""Which detection in a view is whose: how likely each is, left and right as labelled or swapped, and the best matching.

A keypoint of a detection is either where the person is expected to have it (Student's t in two dimensions, wider by
what is not known of the person) or anywhere within about the person's own size. The evidence that a detection is a
person's is the mean logarithm of the ratio, counted as so many keypoints' worth, because the keypoints of a wrong
person are wrong together.
"""

import math

import numpy as np

from posefuse.kernels.jit import inline, kernel, step
from posefuse.kernels.tracking.articulated import noise_growth

_NEVER = 1e9
_SURELY = 1.0 + 1e-9


@inline
def evidence(du, dv, uu, uv, vv, nu, area, least, far):
    """The log of how much likelier a residual is for this keypoint than for any place within ``area``, px^2.

    Most keypoints are somebody else's and far off: that they say the least, ``far = exp(-least)``, is seen without a
    logarithm, because ``s^(1 + nu / 2)`` is no less than ``s`` where s > 1, nor than its square where nu is 2 or more.
    """
    determinant = uu * vv - uv * uv
    squared = (vv * du * du - 2.0 * uv * du * dv + uu * dv * dv) / determinant
    times = area / (2.0 * math.pi * math.sqrt(determinant))
    growth = 1.0 + squared / nu
    if (growth * growth if nu >= 2.0 else growth) > _SURELY * times * far:
        return least
    ratio = math.log(times) - 0.5 * (nu + 2.0) * math.log(growth)
    return ratio if ratio > least else least


@step
def _of_keypoint(p, row, v, k, label, pixels, spread, size_px, keypoints_px, noise_px2, law, clutter_m, least, far):
    """Evidence of one keypoint under one label, NaN where there is none."""
    du = keypoints_px[row, label, 0] - pixels[p, v, k, 0]
    dv = keypoints_px[row, label, 1] - pixels[p, v, k, 1]
    if not math.isfinite(du + dv + noise_px2[row, label]):
        return math.nan
    metre = size_px[p, v, k]
    noise = noise_px2[row, label] + (law.floor_m * metre) ** 2
    uu = spread[p, v, k, 0] + noise
    vv = spread[p, v, k, 2] + noise
    return evidence(du, dv, uu, spread[p, v, k, 1], vv, law.nu, (clutter_m * metre) ** 2, least, far)


@step
def _weigh(confidence, view_of_row, law, noise_px2):
    """The variance of each keypoint by the law, px^2 per axis; NaN where its confidence is too low to count."""
    for row in range(confidence.shape[0]):
        scale = law.scale_px[view_of_row[row]]
        for k in range(confidence.shape[1]):
            trust = confidence[row, k]
            growth = noise_growth(trust, law.exponent)
            noise_px2[row, k] = math.nan if trust < law.min_confidence else scale * scale * growth


@kernel
def score_detections(
    pixels,
    spread,
    size_px,
    keypoints_px,
    confidence,
    view_of_row,
    mirror,
    group_of,
    n_groups,
    law,
    was_swapped,
    clutter_m,
    least,
    worth,
    scores,
    swapped,
    swap_odds,
):
    """Evidence that detections are people's.

    Args:
        pixels, spread, size_px: from ``foresee_people``.
        keypoints_px: shape (row, keypoint, 2).
        confidence: shape (row, keypoint).
        view_of_row: shape (row,), int64.
        mirror: shape (keypoint,), int64: the keypoint's partner on the other side.
        group_of: shape (keypoint,), int64: which limb's sides swap together, -1 for none.
        n_groups: how many of them.
        law: a Law.
        was_swapped: shape (person, view, group): how probable it is, before this frame, that the limb is swapped.
        clutter_m: within which size a wrong keypoint may lie anywhere.
        least: the least evidence of one keypoint.
        worth: as how many keypoints the whole counts at most.
        scores: shape (person, row), written: -inf without a common keypoint.
        swapped: shape (person, row, group), int8, written.
        swap_odds: shape (person, row, group), written: the log odds of that.
    """
    noise_px2 = np.empty(confidence.shape)
    _weigh(confidence, view_of_row, law, noise_px2)
    far = math.exp(-least)
    straight = np.empty(n_groups)
    crossed = np.empty(n_groups)
    prior = np.empty((pixels.shape[1], n_groups))
    for p in range(pixels.shape[0]):
        for v in range(pixels.shape[1]):
            for g in range(n_groups):
                prior[v, g] = math.log(was_swapped[p, v, g] / (1.0 - was_swapped[p, v, g]))
        for row in range(keypoints_px.shape[0]):
            v = view_of_row[row]
            total = 0.0
            count = 0
            for g in range(n_groups):
                straight[g] = 0.0
                crossed[g] = 0.0
            for k in range(mirror.shape[0]):
                as_is = _of_keypoint(
                    p, row, v, k, k, pixels, spread, size_px, keypoints_px, noise_px2, law, clutter_m, least, far
                )
                count += 1 if as_is == as_is else 0
                g = group_of[k]
                if g < 0:
                    total += as_is if as_is == as_is else 0.0
                    continue
                other = _of_keypoint(
                    p, row, v, k, mirror[k], pixels, spread, size_px, keypoints_px, noise_px2, law, clutter_m, least,
                    far,
                )  # fmt: skip
                straight[g] += as_is if as_is == as_is else 0.0
                crossed[g] += other if other == other else 0.0
            for g in range(n_groups):
                swap_odds[p, row, g] = crossed[g] - straight[g] + prior[v, g]
                turned = swap_odds[p, row, g] > 0.0
                swapped[p, row, g] = 1 if turned else 0
                total += crossed[g] if turned else straight[g]
            scores[p, row] = total / count * min(float(count), worth) if count > 0 else -math.inf


@inline
def _cost_of(gain, row, j, m, least):
    """What a row and a column cost; columns past ``m`` are the rows' own."""
    if j >= m:
        return -least if j - m == row else _NEVER
    return -gain[row, j] if gain[row, j] > least else _NEVER


@inline
def _reach_on(gain, n, m, least, here, of_column, potential_row, potential_column, slack, way, done):
    """The next column on the shortest path, potentials moved so that it costs nothing to go there."""
    width = m + n
    row = of_column[here]
    delta = math.inf
    following = -1
    for j in range(width):
        if done[j]:
            continue
        reduced = _cost_of(gain, row, j, m, least) - potential_row[row] - potential_column[j]
        if reduced < slack[j]:
            slack[j] = reduced
            way[j] = here
        if slack[j] < delta:
            delta = slack[j]
            following = j
    for j in range(width + 1):
        if done[j]:
            potential_row[of_column[j]] += delta
            potential_column[j] -= delta
        else:
            slack[j] -= delta
    return following


@step
def assign(gain, n, m, least, of_row, of_column, potential_row, potential_column, slack, way, done):
    """The matching of ``n`` rows and ``m`` columns that gains most; what gains less than ``least`` is not matched.

    Shortest augmenting paths (Jonker & Volgenant 1987); every row has a column of its own, of no gain, beside the
    ``m``.

    Args:
        gain: shape (n, m).
        of_row: shape (n,), written: the column of each row, -1 for none.
        of_column: shape (m + n + 1,), scratch, like all that follow.
    """
    width = m + n
    for j in range(width + 1):
        of_column[j] = -1
        potential_column[j] = 0.0
    for i in range(n):
        potential_row[i] = 0.0
    for i in range(n):
        of_column[width] = i
        here = width
        for j in range(width + 1):
            slack[j] = math.inf
            done[j] = False
            way[j] = width
        while of_column[here] >= 0:
            done[here] = True
            here = _reach_on(gain, n, m, least, here, of_column, potential_row, potential_column, slack, way, done)
        while here != width:
            of_column[here] = of_column[way[here]]
            here = way[here]
    for i in range(n):
        of_row[i] = -1
    for j in range(m):
        if of_column[j] >= 0:
            of_row[of_column[j]] = j


@kernel
def match_views(scores, view_of_row, n_views, least, rows):
    """Per view, the one-to-one matching of people and detections of the most evidence.

    Args:
        scores: shape (person, row).
        view_of_row: shape (row,), int64, ascending.
        n_views: how many.
        least: evidence below which a detection is nobody's.
        rows: shape (person, view), int64, written: -1 for none.
    """
    n = scores.shape[0]
    most = scores.shape[1]
    size = n + most + 1
    gain = np.empty((n, most))
    of_row = np.empty(n, np.int64)
    of_column = np.empty(size, np.int64)
    potential_row, potential_column = np.empty(n), np.empty(size)
    slack, way, done = np.empty(size), np.empty(size, np.int64), np.empty(size, np.bool_)
    first = 0
    for v in range(n_views):
        last = first
        while last < most and view_of_row[last] == v:
            last += 1
        for i in range(n):
            for j in range(first, last):
                gain[i, j - first] = scores[i, j]
        assign(gain, n, last - first, least, of_row, of_column, potential_row, potential_column, slack, way, done)
        for i in range(n):
            rows[i, v] = first + of_row[i] if of_row[i] >= 0 else -1
        first = last
