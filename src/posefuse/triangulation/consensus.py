"""The point that most views agree on.

Every pair of views proposes a point, the best by confidence first; the proposal that costs least, each view's squared
residual being bounded, is refined over all views by reweighted Gauss-Newton. Views that end up too far off are
rejected, and the covariance is that of the others. See docs/methods.md, "consensus".
"""

import math
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np

from posefuse.kernels.consensus import triangulate_consensus
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks
from posefuse.triangulation.results import EmptyLayer, rows_by_person_frame

DEFAULT_MIN_VIEWS = 2

_ALL_PAIRS_UP_TO = 12
_PAIRS_PER_VIEW = 8
_MISSED = 1e-4
"""How likely it may be that no pair of agreeing views was among those tried when the search ends early."""
_MISSED_DECIDED = 0.05
"""The same where so many agree that the best would share three views with them, and so be their point."""


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint of every person in a range of frames.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory.
        tracks: whose detection is whose, of the same frames.
        noise: the standard deviation of a detection, in whose units views agree or not.
        options: ``min_views`` must be set.

    Returns:
        The measured layer: points in metres, covariance, status, and each view's part.
    """
    assert options.min_views is not None
    out = EmptyLayer.of(tracks, len(detections.skeleton))
    chosen = options.consensus
    triangulate_consensus(
        *rig.packed,
        np.asarray(detections.keypoints_px),
        np.asarray(detections.confidence),
        rows_by_person_frame(tracks, detections),
        noise.scale_px,
        noise.exponent,
        options.min_confidence,
        options.min_views,
        pairs_to_try(len(rig)),
        enough_tries(len(rig)),
        brief_tries(len(rig)),
        chosen.bound_sigma,
        chosen.full_sigma,
        chosen.none_sigma,
        *out.arrays,
    )
    layer = out.finish()
    lost = reweighting_loss(chosen.full_sigma, chosen.none_sigma)
    return replace(layer, covariance_m2=np.asarray(layer.covariance_m2) * lost)


@cache
def reweighting_loss(full_sigma: float, none_sigma: float) -> float:
    """By how much reweighting makes variances larger than those of maximum likelihood, on normal noise.

    The sandwich ``B / A^2`` with the weight ``w`` as a function of the squared residual ``s``, in squared sigmas, which
    is twice an exponential variable: ``A`` the mean of ``w + s w'``, ``B`` that of ``w^2 s / 2`` (Huber 1981).
    """
    full, none = full_sigma**2, none_sigma**2
    s = np.linspace(0.0, none, 20_001)
    density = 0.5 * np.exp(-0.5 * s)
    fall = 1.0 - np.clip((s - full) / (none - full), 0.0, 1.0)
    slope = np.where(s > full, -2.0 * fall / (none - full), 0.0)
    a = np.trapezoid(density * (fall**2 + s * slope), s)
    b = np.trapezoid(density * fall**4 * s, s) / 2.0
    return float(b / a**2)


@cache
def pairs_to_try(n_views: int) -> np.ndarray:
    """Shape (pair, 2), int64: pairs of ranks, best first; all of them up to 12 views, 8 a view beyond."""
    pairs = sorted(combinations(range(n_views), 2), key=lambda pair: (sum(pair), pair))
    most = len(pairs) if n_views <= _ALL_PAIRS_UP_TO else _PAIRS_PER_VIEW * n_views
    return np.array(pairs[:most], dtype=np.int64)


@cache
def enough_tries(n_views: int) -> np.ndarray:
    """Shape (view + 1, view + 1), int64: with n views of which m agree, how many pairs need to be tried.

    If m views are right, a pair is right with probability ``m (m - 1) / (n (n - 1))``; the search may end when it is
    certain enough that a right one was tried. With all views in agreement one is. As many others as agree, or more,
    share ``2 m - n`` views with them: where these are three there is no other point to be found, only a better start.
    """
    table = np.zeros((n_views + 1, n_views + 1), dtype=np.int64)
    for n in range(2, n_views + 1):
        every = math.comb(n, 2)
        table[n, :2] = every
        table[n, n] = 1
        for m in range(2, n):
            share = m * (m - 1) / (n * (n - 1))
            missed = _MISSED_DECIDED if decided(n, m) else _MISSED
            table[n, m] = min(every, math.ceil(math.log(missed) / math.log1p(-share)))
    return table


def decided(n_views: int, agreeing: int) -> bool:
    """Whether any rival of a point must share three views with it."""
    return 2 * agreeing - n_views >= 3


def brief_tries(n_views: int) -> int:
    """After how many pairs a point of all views is found if it is decided by as few as can; 0 if only all can."""
    least = (n_views + 4) // 2
    return int(enough_tries(n_views)[n_views, least]) if least < n_views else 0
