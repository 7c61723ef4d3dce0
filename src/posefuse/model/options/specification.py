"""Options of the tracker's strategy `specification`: the weights and thresholds of the specification's terms.

The specification counts in frames and pixels; these options are in seconds and in standard deviations of the noise
model at confidence 1. Every term can be switched off.
"""

from dataclasses import dataclass, replace

from posefuse.arguments import checked
from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option
from posefuse.model.options.named_numbers import named_numbers
from posefuse.model.options.tracking_motion import time_factor


@checked
@dataclass(frozen=True)
class SpecificationOptions:
    """Weights, thresholds and switches of the strategy `specification`.

    Attributes:
        pair_proposals: Whether people are proposed from pairs of detections with a low energy E_pair, instead of from
            groups of detections.
        angle_weight: Weight of 1/sin^2 of the angle between the two rays of a keypoint in E_pair (lambda_theta).
        anthropometric_weight: Weight of implausible bone lengths in E_pair (lambda_anthro).
        pair_gate: Maximum energy E_pair of a proposed pair, per common core keypoint.
        normalized_distance: Whether the distance d_prop adds the covariances of both proposals to tau_r^2 and tau_Z^2.
        tentative_motion: Whether a tentative track has velocities and covariances of its root and its core, from which
            its position in a frame is predicted.
        tentative_speed_m_s: Standard deviation of the prior of a tentative track's velocities, in m/s.
        buffer_s: Duration of the latest observations that determine a tentative track and its first body (L), in
            seconds.
        promotion_fit: Whether the first body of a track has bone lengths from weighted medians over the buffer, and a
            pose fitted to the core keypoints, instead of a body filtered from the detections.
        shape_weight: Weight of the prior of bone lengths in the fits of lengths (lambda_beta).
        core_fit_sd_m: Standard deviation of a core keypoint in the first fit of a pose, in meters; its ratio to the
            tracker's ``limit_sigma`` is the weight of joint limits (lambda_lim).
        shape_gain: Fraction of each update of the bone lengths that is applied until they are fixed (eta_beta); None
            lets them follow the tracker's ``motion.shape_walk``.
        twist_motion: Whether the root moves by a constant twist in SE(3), instead of by independent translation and
            rotation.
        persistent_velocities: Whether predicted velocities persist, instead of decaying.
        core_matching: Whether only core keypoints count in the matching cost, instead of all.
        joint_weights: Weights of keypoints in the matching cost as name=weight, such as left_hip=0.5 (omega_i); all
            others have the weight 1.
        same_frame_reacquisition: Whether a proposal re-acquires a lost track in the same frame, instead of after the
            confirmation of a new track.
        terminate_variance_m2: Trace of the root's covariance above which a lost track is terminated (tau_P), in m^2;
            None disables the rule.
        terminate_outside_after_s: Time outside the overlap of two views after which a lost track is terminated (G), in
            seconds; None disables the rule.
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

    pair_proposals: bool = True
    angle_weight: float = option(0.2, at_least=0.0)
    anthropometric_weight: float = option(1.0, at_least=0.0)
    pair_gate: float = option(12.0, at_least=0.0)
    normalized_distance: bool = False
    tentative_motion: bool = True
    tentative_speed_m_s: float = option(1.5, above=0.0)
    buffer_s: float = option(0.4, above=0.0)
    promotion_fit: bool = True
    shape_weight: float = option(1.0, above=0.0)
    core_fit_sd_m: float = option(0.05, above=0.0)
    shape_gain: float | None = option(0.1, above=0.0, at_most=1.0)
    twist_motion: bool = True
    persistent_velocities: bool = True
    core_matching: bool = True
    joint_weights: tuple[str, ...] = option((), example='["left_hip=0.5"]')
    same_frame_reacquisition: bool = True
    terminate_variance_m2: float | None = option(50.0, above=0.0, unit="m^2")
    terminate_outside_after_s: float | None = option(1.0, above=0.0)
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

        for name, weight in self.weight_of_joint.items():
            if not (name and 0.0 <= weight < float("inf")):
                raise OptionsError(
                    "tracker.specification.joint_weights must be a list of name=weight with finite weights of at least "
                    f"0, got {name}={weight}."
                )

    @property
    def weight_of_joint(self) -> dict[str, float]:
        """The weights of ``joint_weights`` by keypoint.

        Raises:
            OptionsError: If an entry is not name=weight.
        """
        return named_numbers(
            self.joint_weights, "tracker.specification.joint_weights", "name=weight", "left_hip=0.5"
        )  # fmt: skip

    def in_proportion(self, scale: float) -> "SpecificationOptions":
        """Return the same options for bodies of another size.

        Args:
            scale: Size of the body relative to an adult human.
        """
        variance_m2 = self.terminate_variance_m2
        return replace(
            self,
            tau_root_m=self.tau_root_m * scale,
            tau_core_m=self.tau_core_m * scale,
            core_fit_sd_m=self.core_fit_sd_m * scale,
            tentative_speed_m_s=self.tentative_speed_m_s * scale / time_factor(scale),
            terminate_variance_m2=None if variance_m2 is None else variance_m2 * scale**2,
        )
