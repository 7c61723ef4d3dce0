"""Options of the tracker's strategy `specification`: the weights and thresholds of the specification's terms.

The specification counts in frames and pixels; these options are in seconds and in standard deviations of the noise
model at confidence 1.
"""

from dataclasses import dataclass, replace

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option


@dataclass(frozen=True)
class SpecificationOptions:
    """Weights and thresholds of the strategy `specification`.

    Attributes:
        score_memory_s: Time constant of the decay of scores, in seconds: lambda_s = exp(-dt / score_memory_s).
        pairs_weight: Weight of a pair of views in the tentative score (a1).
        views_weight: Weight of a view in the tentative score (a2).
        error_weight: Penalty per standard deviation of reprojection error in the tentative score (a3).
        bones_weight: Penalty on the coefficient of variation of bone lengths in the tentative score (a4).
        missing_weight: Penalty for a frame without an observation in the tentative score (a5).
        promote_score: Minimum tentative score for confirmation (tau_promote).
        active_views_weight: Weight of a view in the score of a confirmed track (b1).
        active_joints_weight: Weight of the fraction of observed keypoints in the score of a confirmed track (b2).
        active_error_weight: Penalty per standard deviation of reprojection error for a confirmed track (b3).
        active_missing_weight: Penalty for a frame without support for a confirmed track (b4).
        lost_score: Score below which a confirmed track is lost (tau_lost).
        noise_memory_s: Time constant of the noise estimates, in seconds: lambda_sigma = exp(-dt / noise_memory_s).
        noise_gain: Weight of a squared residual in the noise estimate (kappa).
        max_residual_sigma: Upper limit of a residual in the noise estimate (r_max).
        min_noise: Lower limit of the noise estimate, relative to the noise model (sigma_min).
        max_noise: Upper limit of the noise estimate, relative to the noise model (sigma_max).
        match_gate: Mean squared normalized distance of keypoints below which a detection can match a track.
        id_bonus: Reduction of the matching cost for an unchanged 2D track identity (lambda_id).
        tau_root_m: Scale of the distance between the pelvises of two proposals, in meters (tau_r).
        tau_core_m: Scale of the distance between core keypoints relative to the pelvis, in meters (tau_Z).
        core_weight: Weight of a core keypoint relative to the pelvis (lambda_Z).
        cluster_gate: Distance below which proposals are merged, and continue a tentative track.
        reacquire_gate: Distance from a lost track's prediction below which a proposal continues it (tau_reacq).

    Raises:
        OptionsError: If a value is out of range, or ``max_noise`` is less than ``min_noise``.
    """

    score_memory_s: float = option(0.4, above=0.0)
    pairs_weight: float = option(0.2, at_least=0.0)
    views_weight: float = option(1.0, at_least=0.0)
    error_weight: float = option(0.5, at_least=0.0)
    bones_weight: float = option(4.0, at_least=0.0)
    missing_weight: float = option(2.0, at_least=0.0)
    promote_score: float = option(0.5, unit="score units")
    active_views_weight: float = option(0.5, at_least=0.0)
    active_joints_weight: float = option(1.0, at_least=0.0)
    active_error_weight: float = option(0.5, at_least=0.0)
    active_missing_weight: float = option(2.0, at_least=0.0)
    lost_score: float = option(0.0, unit="score units")
    noise_memory_s: float = option(0.4, above=0.0)
    noise_gain: float = option(0.5, at_least=0.0)
    max_residual_sigma: float = option(5.0, above=0.0)
    min_noise: float = option(0.5, above=0.0)
    max_noise: float = option(5.0, above=0.0)
    match_gate: float = option(30.0, at_least=0.0)
    id_bonus: float = option(10.0, at_least=0.0)
    tau_root_m: float = option(0.3, above=0.0)
    tau_core_m: float = option(0.15, above=0.0)
    core_weight: float = option(0.25, at_least=0.0)
    cluster_gate: float = option(4.0, at_least=0.0)
    reacquire_gate: float = option(9.0, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.specification")
        if self.max_noise < self.min_noise:
            raise OptionsError(
                f"tracker.specification.max_noise must be at least min_noise ({self.min_noise}), got {self.max_noise}."
            )

    def in_proportion(self, scale: float) -> "SpecificationOptions":
        """Return the same options for bodies of another size.

        Args:
            scale: Size of the body relative to an adult human.
        """
        return replace(self, tau_root_m=self.tau_root_m * scale, tau_core_m=self.tau_core_m * scale)
