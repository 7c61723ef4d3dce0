"""Triangulate the point that most views agree on.

Every pair of views proposes a point, in order of confidence. The proposal with the lowest cost, with each view's
squared residual bounded, is refined over all views by reweighted Gauss-Newton. Views with large final residuals are
rejected, and the covariance is that of the remaining views. See docs/methods.
"""

from functools import cache

import numpy as np

from posefuse.kernels.records import NoiseParameters
from posefuse.kernels.triangulation.consensus import triangulate_consensus
from posefuse.kernels.triangulation.pair_order import early_limit, ordered_pairs, required_tries
from posefuse.kernels.triangulation.workspace import ConsensusParameters
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import ConsensusOptions, TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks
from posefuse.triangulation.method import Method
from posefuse.triangulation.results import LayerBuffers, observations_of


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    Residuals are compared with the saturation and rejection limits in units of the noise.
    """
    assert options.min_views is not None
    out = LayerBuffers.allocate(tracks, len(detections.skeleton))
    chosen = options.consensus
    triangulate_consensus(
        rig.packed,
        observations_of(tracks, detections),
        NoiseParameters(noise.scale_px, noise.exponent, options.min_confidence),
        ConsensusParameters(
            options.min_views,
            ordered_pairs(len(rig)),
            required_tries(len(rig)),
            early_limit(len(rig)),
            chosen.saturation_sigma,
            chosen.full_weight_sigma,
            chosen.zero_weight_sigma,
        ),
        out.arrays,
    )
    out.arrays.covariance[:] *= reweighting_loss(chosen.full_weight_sigma, chosen.zero_weight_sigma)
    return out.finish()


@cache
def reweighting_loss(full_sigma: float, zero_sigma: float) -> float:
    """Return the factor by which reweighting increases variances over those of maximum likelihood, for Gaussian noise.

    It is the sandwich ``B / A^2`` with the weight ``w`` as a function of the squared residual ``s`` in squared standard
    deviations, where ``s / 2`` is exponentially distributed: ``A`` is the mean of ``w + s w'``, and ``B`` that of ``w^2
    s / 2`` (Huber 1981).
    """
    full, zero = full_sigma**2, zero_sigma**2
    s = np.linspace(0.0, zero, 20_001)
    density = 0.5 * np.exp(-0.5 * s)
    weight_root = 1.0 - np.clip((s - full) / (zero - full), 0.0, 1.0)
    slope = np.where(s > full, -2.0 * weight_root / (zero - full), 0.0)
    a = np.trapezoid(density * (weight_root**2 + s * slope), s)
    b = np.trapezoid(density * weight_root**4 * s, s) / 2.0
    return float(b / a**2)


METHOD = Method(
    "consensus",
    solve,
    default_min_views=2,
    supports_left_right=True,
    supports_trajectory=True,
    options=ConsensusOptions,
)
