"""The point that most views agree on.

Every pair of views proposes a point, the best by confidence first; the proposal that costs least, each view's squared
residual being bounded, is refined over all views by reweighted Gauss-Newton. Views that end up too far off are
rejected, and the covariance is that of the others. See docs/methods.md, "consensus".
"""

from dataclasses import replace
from functools import cache

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.triangulation.consensus import triangulate_consensus
from posefuse.kernels.triangulation.pair_order import early_limit, ordered_pairs, required_tries
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks
from posefuse.triangulation.results import EmptyLayer, rows_by_person_frame

DEFAULT_MIN_VIEWS = 2


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
        frozen(detections.keypoints_px),
        frozen(detections.confidence),
        rows_by_person_frame(tracks, detections),
        noise.scale_px,
        noise.exponent,
        options.min_confidence,
        options.min_views,
        ordered_pairs(len(rig)),
        required_tries(len(rig)),
        early_limit(len(rig)),
        chosen.saturation_sigma,
        chosen.full_weight_sigma,
        chosen.zero_weight_sigma,
        *out.arrays,
    )
    layer = out.finish()
    lost = reweighting_loss(chosen.full_weight_sigma, chosen.zero_weight_sigma)
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
