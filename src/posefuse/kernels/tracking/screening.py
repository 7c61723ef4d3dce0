"""Screening of keypoints whose log odds have their lower bound, without logarithms, roots or divisions.

A crowd has as many pairs of people and detections as the square of its size, and the keypoints of most pairs are far
apart. Arrays with keypoints as the last axis let the compiler test several at a time.
"""

import math
from typing import Any, NamedTuple

from posefuse.kernels.jit import inline, subroutine, vectorized

_MARGIN = 1.0 + 1e-6


class Screening(NamedTuple):
    """Keypoints of detections and of one predicted person, quantity by quantity.

    Attributes:
        shown: shape (side, 3, row, keypoint): u, v and noise variance of detections, with labels as they are, and
            swapped; NaN where missing.
        predicted: shape (view, 7, keypoint): u, v, covariance (uu, uv, vv), variance of the model's floor, and squared
            limit of the density ratio, of one person.
        log_noise: shape (row,): logarithm of the least noise variance.
        is_least: shape (side, keypoint): 1 where the log odds certainly have their lower bound, NaN where a keypoint is
            missing, else 0.
        sums: shape (side, group): log odds of the limbs of a pair.
    """

    shown: Any
    predicted: Any
    log_noise: Any
    is_least: Any
    sums: Any


@subroutine
def arrange_detections(keypoints_px, noise_px2, mirror, screening):
    """Write the keypoints of all detections, with labels as they are, and swapped, and their noise."""
    shown, log_noise = screening.shown, screening.log_noise
    for row in range(keypoints_px.shape[0]):
        least = math.inf
        for k in range(keypoints_px.shape[1]):
            for side in range(2):
                label = k if side == 0 else mirror[k]
                shown[side, 0, row, k] = keypoints_px[row, label, 0]
                shown[side, 1, row, k] = keypoints_px[row, label, 1]
                shown[side, 2, row, k] = noise_px2[row, label]
            least = min(least, noise_px2[row, k]) if noise_px2[row, k] == noise_px2[row, k] else least
        log_noise[row] = math.log(least)


@subroutine
def arrange_person(projected, scoring, p, predicted, most):
    """Write the keypoints of one predicted person in all views, and the greatest log odds where the noise is 1 px."""
    for v in range(predicted.shape[0]):
        largest = 0.0
        for k in range(predicted.shape[2]):
            px_per_m = projected.scale_px_per_m[p, v, k]
            predicted[v, 0, k] = projected.pixels[p, v, k, 0]
            predicted[v, 1, k] = projected.pixels[p, v, k, 1]
            for i in range(3):
                predicted[v, 2 + i, k] = projected.pixel_covariance[p, v, k, i]
            predicted[v, 5, k] = (scoring.floor_m * px_per_m) ** 2
            odds = _MARGIN * (scoring.clutter_m * px_per_m) ** 2 / (2.0 * math.pi)
            predicted[v, 6, k] = (scoring.min_odds * odds) ** 2
            largest = odds if odds > largest else largest
        most[v] = math.log(largest)


@vectorized
def find_least(screening, row, v, side, nu, tolerance):
    """Find the keypoints of a pair whose log odds certainly have their lower bound.

    With the determinant d of the covariance and the squared distance s / d, they do if the power 1 + nu / 2 of
    ``1 + s / (d nu)`` exceeds the limit divided by ``sqrt(d)``. Both sides are squared and multiplied by a power of d.
    The exponent is rounded down. The last argument is ``exp(2 min_log_odds)``.

    Returns:
        The number of keypoints, of those that have it, and of those whose log odds may be positive.
    """
    shown, predicted, is_least = screening.shown, screening.predicted, screening.is_least
    n_keypoints = 0.0
    n_least = 0.0
    n_positive = 0.0
    for k in range(is_least.shape[1]):
        du = shown[side, 0, row, k] - predicted[v, 0, k]
        dv = shown[side, 1, row, k] - predicted[v, 1, k]
        noise = shown[side, 2, row, k] + predicted[v, 5, k]
        uu = predicted[v, 2, k] + noise
        uv = predicted[v, 3, k]
        vv = predicted[v, 4, k] + noise
        determinant = uu * vv - uv * uv
        growth = determinant + (vv * du * du - 2.0 * uv * du * dv + uu * dv * dv) / nu
        limit = predicted[v, 6, k] * determinant
        power = growth * growth
        if nu >= 2.0:
            power *= power
            limit *= determinant * determinant
        if nu >= 3.0:
            power *= growth
            limit *= determinant
        is_least[side, k] = 1.0 if power > limit else 0.0 * power
        n_least += 1.0 if power > limit else 0.0
        n_positive += 1.0 if power <= limit * tolerance else 0.0
        n_keypoints += 1.0 if power == power else 0.0
    return n_keypoints, n_least, n_positive


@inline
def may_match(screening, scoring, row, v, most, parameters):
    """Return whether the score of a pair may reach the least score that counts, with labels as they are or swapped.

    Args:
        screening: a Screening.
        scoring: a Scoring.
        row: the detection.
        v: its view.
        most: greatest log odds of a keypoint where the noise is 1 px.
        parameters: MatchParameters.
    """
    tolerance = 1.0 / (scoring.min_odds * scoring.min_odds)
    count, n_least, n_positive = find_least(screening, row, v, 0, scoring.nu, tolerance)
    others = find_least(screening, row, v, 1, scoring.nu, tolerance)
    # Each limb has the labels that fit better; a keypoint that only they lack counts as zero.
    n_positive = min(count, n_positive + others[2])
    n_least = max(n_least - (screening.is_least.shape[1] - others[1]), 0.0)
    most -= screening.log_noise[row]
    total = n_positive * max(most, 0.0) + n_least * scoring.min_log_odds
    return count > 0.0 and total * min(count, parameters.max_keypoints) > parameters.min_score * count
