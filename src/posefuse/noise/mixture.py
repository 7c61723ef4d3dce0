"""How noisy right observations are, where some points have a wrong one that is not wrong enough to be told apart.

Each point either has right observations only or one wrong one, of no particular law; expectation maximisation finds
the noise of the right ones, how often there is a wrong one, and how far off those lie. See docs/methods.md, "Noise".
"""

from dataclasses import dataclass

import numpy as np

from posefuse.triangulation.linearized import LinearFit, multiply_2x2

_ROUNDS = 150
_SETTLED = 2e-4
_BINS = 20
# Nearer than so many standard deviations a wrong observation is as good as a right one; and as far as any goes.
_NEAREST, _FARTHEST = 2.75, 100.0
_FEWEST_RIGHT = 1e-3


@dataclass(frozen=True)
class Mixture:
    """What was found.

    Attributes:
        scale: the standard deviation of right observations, in the units of the residuals.
        all_right: shape (point,): how likely a point has right observations only.
        wrong: shape (point, view): how likely this is the wrong one.
        law: how far off wrong observations lie: the share of each step of distance.
    """

    scale: float
    all_right: np.ndarray
    wrong: np.ndarray
    law: np.ndarray


def separate(fit: LinearFit, start: Mixture | None = None) -> Mixture:
    """Tell right from wrong observations.

    Args:
        fit: of points with two views or more, all used ones counted as right.
        start: what came of nearly the same fit with a scale of 1, to begin from.

    Returns:
        The maximum-likelihood mixture.
    """
    left_out, inverse = fit.leave_one_out()
    with np.errstate(divide="ignore"):
        distance = np.log(np.linalg.norm(left_out, axis=-1) / _NEAREST)
    # By so much a point's sum of squares falls if the view is left out.
    gain = (left_out * multiply_2x2(inverse, left_out)).sum(axis=-1)
    determinant = inverse[..., 0, 0] * inverse[..., 1, 1] - inverse[..., 0, 1] ** 2
    root = np.sqrt(np.maximum(determinant, 1e-9))
    views = fit.used.sum(axis=1)
    may_go = fit.used & (views > 2)[:, None]
    squared, freedom = fit.squared, fit.degrees_of_freedom
    scale = 1.0 if start else 0.5 * float(np.sqrt(squared.sum() / freedom.sum()))
    share_right = float(start.all_right.mean()) if start else 0.8
    law = start.law if start else np.full(_BINS, 1.0 / _BINS)
    width = np.log(_FARTHEST / _NEAREST) / _BINS
    areas = np.pi * np.diff(np.exp(2.0 * width * np.arange(_BINS + 1))) * _NEAREST**2
    all_right = np.ones(len(views))
    point, view = np.nonzero(may_go)
    distance, gain, root = (values[point, view] for values in (distance, gain, root))
    gone, odds = np.zeros(0, dtype=int), np.zeros(0)
    for _ in range(_ROUNDS):
        place = (distance - np.log(scale)) / width
        # Most observations lie so near that they can only be right.
        gone = np.flatnonzero((place >= 0.0) & (place < _BINS))
        bins, of = place[gone].astype(int), point[gone]
        density = (law / (areas * scale**2))[bins]
        # How much likelier the view is wrong than right: its own law against the noise about what the others expect.
        expected = root[gone] / (2.0 * np.pi * scale**2) * np.exp(-0.5 * gain[gone] / scale**2)
        odds = density / np.maximum(expected, 1e-300) * (1.0 - share_right) / (share_right * views[of])
        all_right = 1.0 / (1.0 + np.bincount(of, odds, len(views)))
        odds *= all_right[of]
        before = scale
        # Without its wrong view a point's sum of squares is less by the gain, and its degrees of freedom by two.
        left = squared.sum() - (odds * gain[gone]).sum()
        scale = float(np.sqrt(left / (freedom.sum() - 2.0 * odds.sum())))
        share_right = min(max(float(all_right.mean()), _FEWEST_RIGHT), 1.0 - _FEWEST_RIGHT)
        law = np.bincount(bins, odds, _BINS) + 1e-9
        law /= law.sum()
        if abs(scale - before) < _SETTLED * scale:
            break
    wrong = np.zeros(may_go.shape)
    wrong[point[gone], view[gone]] = odds
    return Mixture(scale, all_right, wrong, law)
