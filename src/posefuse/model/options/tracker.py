"""Options of the tracker, in seconds, meters and standard deviations, so that they do not depend on the frame rate.

Lengths are those of an adult human. Other bodies have them in proportion to their size.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from posefuse.arguments import checked
from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option
from posefuse.model.options.named_numbers import named_numbers
from posefuse.model.options.specification import SpecificationOptions
from posefuse.model.options.tracking_motion import MotionOptions, PartOptions, time_factor
from posefuse.model.options.tracking_stages import (
    CameraMonitorOptions,
    FastMotionOptions,
    IdentityAuditOptions,
    InitiationOptions,
    LifecycleOptions,
    PartialDetectionOptions,
    ReidentificationOptions,
    ReinitializationOptions,
    SharedDetectionOptions,
    SingleViewOptions,
)

StrategyName = Literal["posefuse", "specification"]

STRATEGIES: dict[StrategyName, str] = {
    "posefuse": "log odds, tempered noise model, propagated covariance as prior",
    "specification": "every term as specified: proposals, scores, noise, prior, motion and first body; causal",
}
"""Strategies of the tracker with their line of help; one file each under ``tracking/strategies``."""

Smoother = Literal["none", "lag", "full"]
SMOOTHERS: tuple[Smoother, ...] = get_args(Smoother)


@checked
@dataclass(frozen=True)
class TrackerOptions:
    """Tracking of several people.

    Attributes:
        strategy: Strategy for proposals, scores, noise model, prior, motion, first body and termination: "posefuse" or
            "specification". The latter does not propagate covariances, so its results cannot be smoothed.
        iterations: Maximum number of Gauss-Newton steps per frame.
        nu: Degrees of freedom of the Student's t distribution of detection errors.
        gate: Maximum squared innovation of a keypoint, normalized by its covariance, for the keypoint to be used in the
            update (tau_joint).
        model_floor_m: Systematic offset between a model joint and the detector's keypoint, in meters.
        error_memory_s: Correlation time of detection errors for five views and 20 frames per second, in seconds. Fewer
            views or frames lengthen it.
        limit_sigma: Standard deviation of the overshoot of a joint limit, as a sine or cosine.
        clutter_m: Side length of the square around a person over which the keypoints of a wrong detection are uniformly
            distributed, in meters.
        match_evidence: Minimum evidence for assigning a detection to a person, in nats.
        keypoint_evidence: Lower limit of the evidence of a single keypoint, in nats.
        independent_keypoints: Maximum number of keypoints that count as independent evidence.
        id_evidence: Evidence, in nats, of an unchanged 2D track identity (lambda_id).
        swap_log_odds: Prior log odds of a left/right swap of a limb.
        swap_duration_s: Mean duration of a left/right swap, in seconds.
        min_joints: Minimum number of used keypoints for a view to support a person.
        lost_after_s: Time without support after which a track is lost (M_lost), in seconds.
        single_view_after_s: Time in a single view after which a track is re-localized from the other views, in seconds.
        lost_log_odds: Log odds of presence below which a track is lost (tau_lost).
        max_log_odds: Upper limit of the log odds of presence.
        evidence_time_s: Time over which detections, or missing detections, add up to one independent observation, in
            seconds.
        detection_share: Probability that a view that should show a person does so.
        false_share: Probability of a false detection at the position of an absent person.
        reacquire_views: Number of views that must show a lost track to re-acquire it (V_reacq).
        terminate_after_s: Time after which a lost track is terminated (A_delete), in seconds.
        terminate_beyond_m: Position uncertainty above which a lost track is terminated, in meters (tau_P, on the
            standard deviation of the root over x, y and z, which saturates at 8.7); None disables the rule.
        terminate_outside_after_s: Time outside the overlap of two views after which a lost track is terminated (G), in
            seconds; None disables the rule.
        fix_shape_after_s: Time in two views after which the bone lengths of a person are fixed even if they are not
            stable, in seconds.
        fix_shape_sd_m: Median standard deviation of the bone lengths below which they are fixed once they have been
            steady for 1 s, in meters; None disables the rule.
        reopen_shape_sigma: Bias of a bone length over about 2 s from which fixed lengths are estimated again, in
            standard deviations; None disables the rule.
        stature_m: Known stature of every tracked person, or size of an animal, in meters.
        known_m: Measured bone lengths as name=meters, such as left_knee=0.43 for the bone that ends there; both sides
            share one length. The names are those of `pose_length` in a result.
        known_sd_m: Standard deviation of the measured bone lengths, in meters.
        max_people: Maximum number of people tracked at a time.
        population: Number of individuals if none enters or leaves, such as animals in an arena. Once all of them were
            confirmed, every new person is re-identified as a lost one. None if the number is unknown.
        smoother: Later frames used to refine earlier ones: "none", "lag" (those of the next ``lag_s``) or "full" (all).
        lag_s: Lag of the fixed-lag smoother, in seconds.
        look_ahead_s: Time after each block of frames that the full smoother includes, in seconds.
        smoother_error_memory_s: Correlation time of detection errors for the smoother, and for the filter once only a
            single view has shown a person for ``single_view_after_s``, in seconds.
        smoother_independent_share: Fraction of each frame's information that the smoother treats as independent.
        bridge_s: Maximum duration of a loss across which a track is smoothed, in seconds.
        initiation: Conditions under which a proposal becomes a track.
        lifecycle: Rules for expected and missing detections.
        fast_motion: Search for people who moved farther than predicted.
        single_view: Priors for people seen by a single view.
        camera_monitor: Detection of moved and silent cameras.
        identity_audit: Comparison of bone lengths after close contact.
        reinitialization: Reinitialization of limbs and directions.
        partial_detections: Merging of partial detections.
        shared_detections: Sharing of detections between two people in contact.
        reidentification: Re-identification of lost people.
        motion: Motion model of bodies.
        parts: Tracking of hands and faces.
        specification: Options of the strategy `specification`.
    """

    strategy: StrategyName = "posefuse"
    iterations: int = option(2, at_least=1, at_most=1000)
    nu: float = option(3.0, above=0.0)
    gate: float = option(60.0, above=0.0)
    model_floor_m: float = option(0.015, at_least=0.0)
    error_memory_s: float = option(0.06, at_least=0.0)
    limit_sigma: float = option(0.1, above=0.0, unit="")
    clutter_m: float = option(1.0, above=0.0)
    match_evidence: float = option(0.0, unit="nats")
    keypoint_evidence: float = option(-3.0, unit="nats")
    independent_keypoints: float = option(6.0, above=0.0)
    id_evidence: float = option(2.0, unit="nats")
    swap_log_odds: float = option(-5.0)
    swap_duration_s: float = option(0.2, above=0.0)
    min_joints: int = option(4, at_least=1)
    lost_after_s: float = option(0.36, at_least=0.0)
    single_view_after_s: float = option(0.2, at_least=0.0)
    lost_log_odds: float = option(-2.0)
    max_log_odds: float = option(6.0, above=0.0)
    evidence_time_s: float = option(1.0, above=0.0)
    detection_share: float = option(0.85, above=0.0, below=1.0)
    false_share: float = option(0.05, above=0.0, below=1.0)
    reacquire_views: int = option(2, at_least=1)
    terminate_after_s: float = option(30.0, at_least=0.0)
    terminate_beyond_m: float | None = option(None, above=0.0, example="1.0")
    terminate_outside_after_s: float | None = option(None, above=0.0, example="1.0")
    fix_shape_after_s: float = option(4.0, at_least=0.0)
    fix_shape_sd_m: float | None = option(0.0075, above=0.0, example="0.005")
    reopen_shape_sigma: float | None = option(4.5, above=0.0, example="5.0")
    stature_m: float | None = option(None, above=0.0, at_most=100.0, example="1.75")
    known_m: tuple[str, ...] = option((), example='["left_knee=0.43"]')
    known_sd_m: float = option(0.005, above=0.0)
    max_people: int = option(50, at_least=1)
    population: int | None = option(None, at_least=1, example="3")
    smoother: Smoother = "full"
    lag_s: float = option(0.3, at_least=0.0)
    look_ahead_s: float = option(2.0, at_least=0.0)
    smoother_error_memory_s: float = option(0.25, at_least=0.0)
    smoother_independent_share: float = option(0.3, at_least=0.0, at_most=1.0)
    bridge_s: float = option(2.0, at_least=0.0)
    initiation: InitiationOptions = field(default_factory=InitiationOptions)
    lifecycle: LifecycleOptions = field(default_factory=LifecycleOptions)
    fast_motion: FastMotionOptions = field(default_factory=FastMotionOptions)
    single_view: SingleViewOptions = field(default_factory=SingleViewOptions)
    camera_monitor: CameraMonitorOptions = field(default_factory=CameraMonitorOptions)
    identity_audit: IdentityAuditOptions = field(default_factory=IdentityAuditOptions)
    reinitialization: ReinitializationOptions = field(default_factory=ReinitializationOptions)
    partial_detections: PartialDetectionOptions = field(default_factory=PartialDetectionOptions)
    shared_detections: SharedDetectionOptions = field(default_factory=SharedDetectionOptions)
    reidentification: ReidentificationOptions = field(default_factory=ReidentificationOptions)
    motion: MotionOptions = field(default_factory=MotionOptions)
    parts: PartOptions = field(default_factory=PartOptions)
    specification: SpecificationOptions = field(default_factory=SpecificationOptions)

    def __post_init__(self) -> None:
        check_fields(self, "tracker")
        for name, length_m in self.known_lengths_m.items():
            if not (name and 0.0 < length_m < float("inf")):
                raise OptionsError(
                    f"tracker.known_m must be a list of name=meters with lengths above 0, got {name}={length_m}."
                )

    @property
    def known_lengths_m(self) -> dict[str, float]:
        """The measured bone lengths of ``known_m`` by name, in meters.

        Raises:
            OptionsError: if an entry is not name=meters.
        """
        return named_numbers(self.known_m, "tracker.known_m", "name=meters", "left_knee=0.43")

    def in_proportion(self, scale: float) -> "TrackerOptions":
        """Return the same options for bodies of another size.

        Lengths scale with the size of the body. The times in which movements fade scale with its third root, because
        small animals turn and accelerate faster. The times of a track's lifecycle stay.

        Args:
            scale: Size of the body relative to an adult human.
        """
        if scale == 1.0:
            return self
        beyond_m, fast, fix_m = self.terminate_beyond_m, self.fast_motion, self.fix_shape_sd_m
        return replace(
            self,
            model_floor_m=self.model_floor_m * scale,
            clutter_m=self.clutter_m * scale,
            terminate_beyond_m=None if beyond_m is None else beyond_m * scale,
            fix_shape_sd_m=None if fix_m is None else fix_m * scale,
            initiation=_scaled(self.initiation, scale, "gate_m", "apart_m"),
            lifecycle=_scaled(self.lifecycle, scale, "outside_margin_m"),
            fast_motion=replace(fast, onset_s=fast.onset_s * time_factor(scale)),
            single_view=_scaled(self.single_view, scale, "height_sd_m"),
            identity_audit=_scaled(self.identity_audit, scale, "near_m", "apart_m"),
            shared_detections=_scaled(self.shared_detections, scale, "distance_m"),
            reidentification=_scaled(self.reidentification, scale, "length_sd_m", "reach_m", "room_m", "trunk_sd_m"),
            motion=self.motion.in_proportion(scale),
            specification=self.specification.in_proportion(scale),
            parts=self.parts.in_proportion(scale),
        )

    def of_parts(self, *, face: bool) -> "TrackerOptions":
        """Return the options of a part of the body, which has its own motion and noise."""
        parts = self.parts
        share = parts.face_independent_share if face else parts.smoother_independent_share
        return replace(
            self,
            model_floor_m=parts.model_floor_m,
            error_memory_s=parts.error_memory_s,
            smoother_error_memory_s=parts.smoother_error_memory_s,
            smoother_independent_share=share,
            motion=replace(
                self.motion,
                turn_decay_s=parts.turn_decay_s,
                turn_acceleration=parts.turn_acceleration,
                limb_decay_s=parts.limb_decay_s,
                limb_acceleration=parts.limb_acceleration,
            ),
        )


def _scaled(record: Any, scale: float, *names: str) -> Any:
    """Return a record of which some fields are multiplied by a factor."""
    return replace(record, **{name: getattr(record, name) * scale for name in names})
