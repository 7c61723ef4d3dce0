"""What a user can choose about following people; in seconds, metres and sigmas, so that frame rates do not matter.

Metres are those of an adult human. Other bodies have them in proportion to their size.
"""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Literal, get_args

from posefuse.errors import OptionsError, choices
from posefuse.model.options.named_numbers import named_numbers
from posefuse.model.options.specification import SpecificationOptions

Preset = Literal["posefuse", "specification"]

PRESETS: dict[Preset, str] = {
    "posefuse": "odds, the noise law tempered for how long errors last, the propagated covariance as prior",
    "specification": "the seed's scores, noise recursion, prior and distance of proposals; causal",
}
"""Presets of the tracker and their line in help; a file each under ``tracking/presets``."""

Smoother = Literal["none", "lag", "full"]
SMOOTHERS: tuple[Smoother, ...] = get_args(Smoother)

_TIMES = 1.0 / 3.0
"""Running animals' strides quicken nearly as the square root of their size (Heglund & Taylor 1988). Most do not
run, and expecting too much tells bodies apart the less."""


@dataclass(frozen=True)
class BirthOptions:
    """When what detections propose becomes a person.

    Attributes:
        min_age_s: A tentative person is at least so old before it is believed (A_min).
        min_age_two_views_s: The same where two views see it on average.
        two_views_log_odds: And then, with the preset `posefuse`, it is so old that these views and those that should
            show it and do not make it this likely to be there: 1 s where none is silent.
        hit_share: In at least this share of its frames it was seen (K of L).
        min_views: By so many views on average (V_min).
        max_error_sigma: Its median reprojection error is at most this (tau_repr).
        max_bone_variation: And the lengths of its bones vary by at most this share, noise taken off (tau_len).
        promote_log_odds: And the evidence of its frames together is at least this (tau_promote).
        max_age_s: What is not believed by then is forgotten (A_tent_max).
        max_missing_s: And what was not seen for this long (M_tent).
        gate_m: A proposal goes on with a tentative person this near, more by how fast people move.
        apart_m: A proposal whose keypoints are on average this near to an established person is that person.
    """

    min_age_s: float = 0.12
    min_age_two_views_s: float = 0.3
    two_views_log_odds: float = 5.5
    hit_share: float = 0.6
    min_views: float = 2.0
    max_error_sigma: float = 4.0
    max_bone_variation: float = 0.25
    promote_log_odds: float = 6.0
    max_age_s: float = 1.5
    max_missing_s: float = 0.25
    gate_m: float = 0.35
    apart_m: float = 0.3


@dataclass(frozen=True)
class MotionOptions:
    """How people move.

    Attributes:
        root_decay_s: In what time the trunk's velocity fades.
        root_acceleration: Spectral density of the trunk's accelerations, m^2 / s^3.
        turn_decay_s: The same of trunk, head and feet turning.
        turn_acceleration: Spectral density, rad^2 / s^3.
        limb_decay_s: The same of limbs.
        limb_acceleration: Spectral density, rad^2 / s^3.
        shape_walk: By how much lengths wander, variance in m^2 / s.
        leap_power: By how much larger these densities are for a moment where somebody leaps.
        leap_s: For how long they have leapt before that shows.
        top_speed_m_s: How fast a person moves at most, to be found again.
    """

    root_decay_s: float = 0.6
    root_acceleration: float = 5.0
    turn_decay_s: float = 0.3
    turn_acceleration: float = 60.0
    limb_decay_s: float = 0.3
    limb_acceleration: float = 60.0
    shape_walk: float = 1e-7
    leap_power: float = 16.0
    leap_s: float = 0.05
    top_speed_m_s: float = 3.0


@dataclass(frozen=True)
class PartOptions:
    """How hands and faces are followed, each given where the body has it.

    Attributes:
        model_floor_m: By how much a part's points are not what the detector means by their name.
        error_memory_s: For how long detections' errors last: so much less a frame counts.
        smoother_error_memory_s: The same for the smoother.
        smoother_own_share: Which share of what a frame says, its errors taken as its own, is known beside that.
        turn_decay_s: In what time the turning of palms, faces and jaws fades.
        turn_acceleration: Spectral density, rad^2 / s^3.
        limb_decay_s: The same of fingers.
        limb_acceleration: Spectral density, rad^2 / s^3.
        anchor_sd_m: How far a part's root is from where the body has it.
        anchor_sd_deg: How far it is turned from how the body has it, where the body knows.
        anchor_memory_s: For how long the body's errors there last: so much less a frame counts.
        begin_share: So many of a part's points two views must show for it to begin.
        begin_within_m: And no farther from where the body has it.
    """

    model_floor_m: float = 0.004
    error_memory_s: float = 0.094
    smoother_error_memory_s: float = 0.25
    smoother_own_share: float = 0.0
    turn_decay_s: float = 0.3
    turn_acceleration: float = 60.0
    limb_decay_s: float = 0.3
    limb_acceleration: float = 200.0
    anchor_sd_m: float = 0.01
    anchor_sd_deg: float = 15.0
    anchor_memory_s: float = 0.15
    begin_share: float = 0.5
    begin_within_m: float = 0.3

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise OptionsError(f"tracker.parts.{each.name} must be a finite number of at least 0, got {value}.")
        for name in ("begin_share", "smoother_own_share"):
            if getattr(self, name) > 1.0:
                raise OptionsError(f"tracker.parts.{name} is a share, at most 1, got {getattr(self, name)}.")


@dataclass(frozen=True)
class TrackerOptions:
    """How people are followed.

    Attributes:
        preset: Whose scores, noise, prior and distance of proposals: "posefuse" or "specification". The latter's states
            forget from frame to frame how well they are known, so that nothing is smoothed.
        iterations: Gauss-Newton steps a frame, at most.
        nu: Degrees of freedom of detections' errors, Student's t.
        gate: The largest squared innovation of a keypoint, in its own covariance, that counts (tau_joint).
        limb_anew_s: A limb that most views see elsewhere for this long is turned to where their detections put it, and
            sought anew.
        model_floor_m: By how much a body's points are not what the detector means by their name.
        error_memory_s: For how long detections' errors last, where five views show somebody 20 times a second: so much
            less a frame counts. Where fewer do it is longer.
        limit_sigma: How far a joint limit is overstepped, as a sine or cosine.
        clutter_m: A wrong detection's keypoints may lie anywhere within this of a person.
        match_evidence: The least evidence, in nats, for a detection to be a person's.
        keypoint_evidence: The least that one keypoint counts.
        independent_keypoints: All keypoints together count as this many at most.
        id_evidence: What the detector's own identity being that of the last frame counts (lambda_id).
        swap_log_odds: The odds that a limb's sides are exchanged, where nothing is known.
        swap_lasts_s: For how long they are when they are.
        min_joints: A view supports a person with at least so many keypoints.
        lost_after_s: A person without support for this long is lost (M_lost).
        weak_after_s: One whom a single view alone has shown for this long is where others see that view's detection.
        lost_log_odds: Or if it has become this unlikely that they are there (tau_lost).
        most_log_odds: No person is more certain than this.
        evidence_time_s: What views show and do not show counts whole over this time.
        detection_share: How often a view that should see a person does.
        false_share: How often a detection is near a person who is not there.
        reacquire_views: A lost person is found again where so many views see them (V_reacq).
        reacquire_log_odds: Or where a new person is this much likelier to be them than to be new (tau_reacq).
        forget_after_s: Who is lost for longer is not looked for any more (A_delete).
        forget_beyond_m: Nor who is lost and may be anywhere within more than this (tau_P, on the root's standard
            deviation, x, y and z together; it ends at 8.7); None leaves it to the time.
        outside_s: Nor who is lost and has for longer been where no two views overlap, nor within 0.5 m of it (G); None
            lets people come back.
        camera_silent_s: A camera without frames, or that shows nobody where others show people whom it should see, is
            silent after this long, and that is said.
        camera_heard_s: It is heard again after it has been for this long.
        shape_settle_s: For how long two views show somebody before the lengths of their body are kept.
        stature_m: How tall everybody is who is followed, or how large an animal; None where that is not known.
        known_m: Lengths of their bodies that were measured, each as name=metres, such as left_knee=0.43 for the bone
            that ends there; both sides have one. Names are those of `pose_length` in a result.
        known_sd_m: How well these were measured.
        max_people: No more are followed at a time.
        population: How many there are in all, where nobody comes in and goes out, as of animals in an arena: once all
            have been seen, whoever appears is one of those who are lost. None where that is not known.
        smoother: What later frames tell of earlier ones: "none", "lag" (those of the next ``lag_s``) or "full" (all).
        lag_s: How far behind a fixed lag is.
        look_ahead_s: How far the full smoother looks ahead of a block of frames: what is later changes nothing.
        smoother_error_memory_s: For how long detections' errors last, for the smoother, and for the filter of whom a
            single view alone has shown for ``weak_after_s``.
        smoother_own_share: Which share of what a frame says, its errors taken as its own, is known beside that.
        bridge_s: Who is lost for no longer is smoothed through it.
        births: When detections become a person.
        motion: How people move.
        parts: How their hands and faces are followed.
        specification: Of the preset of that name.
    """

    preset: Preset = "posefuse"
    iterations: int = 2
    nu: float = 3.0
    gate: float = 60.0
    limb_anew_s: float = 0.2
    model_floor_m: float = 0.015
    error_memory_s: float = 0.06
    limit_sigma: float = 0.1
    clutter_m: float = 1.0
    match_evidence: float = 0.0
    keypoint_evidence: float = -3.0
    independent_keypoints: float = 6.0
    id_evidence: float = 2.0
    swap_log_odds: float = -5.0
    swap_lasts_s: float = 0.2
    min_joints: int = 4
    lost_after_s: float = 0.36
    weak_after_s: float = 0.2
    lost_log_odds: float = -2.0
    most_log_odds: float = 6.0
    evidence_time_s: float = 1.0
    detection_share: float = 0.85
    false_share: float = 0.05
    reacquire_views: int = 2
    reacquire_log_odds: float = 0.0
    forget_after_s: float = 30.0
    forget_beyond_m: float | None = None
    outside_s: float | None = None
    camera_silent_s: float = 2.0
    camera_heard_s: float = 0.2
    shape_settle_s: float = 4.0
    stature_m: float | None = None
    known_m: tuple[str, ...] = ()
    known_sd_m: float = 0.005
    max_people: int = 50
    population: int | None = None
    smoother: Smoother = "full"
    lag_s: float = 0.3
    look_ahead_s: float = 2.0
    smoother_error_memory_s: float = 0.25
    smoother_own_share: float = 0.3
    bridge_s: float = 2.0
    births: BirthOptions = field(default_factory=BirthOptions)
    motion: MotionOptions = field(default_factory=MotionOptions)
    parts: PartOptions = field(default_factory=PartOptions)
    specification: SpecificationOptions = field(default_factory=SpecificationOptions)

    def __post_init__(self) -> None:
        for name in ("iterations", "min_joints", "reacquire_views", "max_people"):
            if getattr(self, name) < 1:
                raise OptionsError(f"tracker.{name} must be at least 1, got {getattr(self, name)}.")
        if self.population is not None and self.population < 1:
            raise OptionsError(f"tracker.population must be at least 1, or left out, got {self.population}.")
        if self.preset not in PRESETS:
            raise OptionsError(f"No tracker.preset is called {self.preset!r}; there are {choices(PRESETS)}.")
        if self.smoother not in SMOOTHERS:
            raise OptionsError(f"No tracker.smoother is called {self.smoother!r}; there are {choices(SMOOTHERS)}.")
        for name in ("detection_share", "false_share"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise OptionsError(f"tracker.{name} must lie between 0 and 1, got {getattr(self, name)}.")
        self._check_lengths()
        for name in ("forget_beyond_m", "outside_s", "stature_m", "swap_lasts_s"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise OptionsError(f"tracker.{name} must be positive, or left out, got {value}.")
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise OptionsError(f"tracker.{each.name} must be a finite number, got {value}.")

    def _check_lengths(self) -> None:
        object.__setattr__(self, "known_m", tuple(self.known_m))
        if not self.known_sd_m > 0.0:
            raise OptionsError(f"tracker.known_sd_m must be positive, got {self.known_sd_m}.")
        for name, length_m in self.known_lengths_m.items():
            if not (name and 0.0 < length_m < math.inf):
                raise OptionsError(f"tracker.known_m holds name=metres, lengths above 0, got {name}={length_m}.")

    @property
    def known_lengths_m(self) -> dict[str, float]:
        """By name, the lengths that ``known_m`` holds.

        Raises:
            OptionsError: if an entry is not name=metres.
        """
        return named_numbers(self.known_m, "tracker.known_m", "name=metres", "left_knee=0.43")

    def in_proportion(self, scale: float) -> "TrackerOptions":
        """The same for bodies of another size.

        Lengths go with the size, and the times in which movements fade with its third root: small animals turn and
        accelerate faster. For how long somebody is looked for stays.

        Args:
            scale: how large the body is next to an adult human.
        """
        if scale == 1.0:
            return self
        births, motion, parts, slower = self.births, self.motion, self.parts, scale**_TIMES
        return replace(
            self,
            model_floor_m=self.model_floor_m * scale,
            clutter_m=self.clutter_m * scale,
            forget_beyond_m=None if self.forget_beyond_m is None else self.forget_beyond_m * scale,
            births=replace(births, gate_m=births.gate_m * scale, apart_m=births.apart_m * scale),
            motion=replace(
                motion,
                root_decay_s=motion.root_decay_s * slower,
                root_acceleration=motion.root_acceleration * scale**2 / slower**3,
                turn_decay_s=motion.turn_decay_s * slower,
                turn_acceleration=motion.turn_acceleration / slower**3,
                limb_decay_s=motion.limb_decay_s * slower,
                limb_acceleration=motion.limb_acceleration / slower**3,
                shape_walk=motion.shape_walk * scale**2,
                leap_s=motion.leap_s * slower,
                top_speed_m_s=motion.top_speed_m_s * scale / slower,
            ),
            specification=self.specification.in_proportion(scale),
            parts=replace(
                parts,
                model_floor_m=parts.model_floor_m * scale,
                turn_decay_s=parts.turn_decay_s * slower,
                turn_acceleration=parts.turn_acceleration / slower**3,
                limb_decay_s=parts.limb_decay_s * slower,
                limb_acceleration=parts.limb_acceleration / slower**3,
                anchor_sd_m=parts.anchor_sd_m * scale,
                begin_within_m=parts.begin_within_m * scale,
            ),
        )

    def of_parts(self) -> "TrackerOptions":
        """The same for a part of the body, which moves by laws of its own."""
        parts = self.parts
        return replace(
            self,
            model_floor_m=parts.model_floor_m,
            error_memory_s=parts.error_memory_s,
            smoother_error_memory_s=parts.smoother_error_memory_s,
            smoother_own_share=parts.smoother_own_share,
            motion=replace(
                self.motion,
                turn_decay_s=parts.turn_decay_s,
                turn_acceleration=parts.turn_acceleration,
                limb_decay_s=parts.limb_decay_s,
                limb_acceleration=parts.limb_acceleration,
            ),
        )
