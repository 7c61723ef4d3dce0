"""Options of the motion of tracked bodies, and of tracked hands and faces.

Lengths are those of an adult human. Other bodies have them in proportion to their size.
"""

from dataclasses import dataclass, replace

from posefuse.arguments import checked
from posefuse.model.options.bounds import check_fields, option

_TIME_EXPONENT = 1.0 / 3.0
"""Running animals' strides quicken nearly as the square root of their size (Heglund & Taylor 1988). Most animals do not
run, and a motion model that expects too much distinguishes bodies less well."""


def time_factor(scale: float) -> float:
    """Return the factor on the times in which movements fade, for a body of another size.

    Args:
        scale: Size of the body relative to an adult human.
    """
    return scale**_TIME_EXPONENT


@checked
@dataclass(frozen=True)
class MotionOptions:
    """Motion model of bodies.

    Attributes:
        root_decay_s: Time constant of the decay of the trunk's velocity, in seconds.
        root_acceleration: Spectral density of the trunk's acceleration, in m^2/s^3.
        turn_decay_s: Time constant of the decay of the angular velocity of trunk, head and feet, in seconds.
        turn_acceleration: Spectral density of angular acceleration of trunk, head and feet, in rad^2/s^3.
        limb_decay_s: Time constant of the decay of the angular velocity of limbs, in seconds.
        limb_acceleration: Spectral density of angular acceleration of limbs, in rad^2/s^3.
        shape_walk: Variance per second of the random walk of bone lengths, in m^2/s.
        top_speed_m_s: Maximum speed of a person, in m/s; it limits where a lost person is re-acquired or re-identified.
    """

    root_decay_s: float = option(0.6, above=0.0)
    root_acceleration: float = option(5.0, at_least=0.0, unit="m^2/s^3")
    turn_decay_s: float = option(0.3, above=0.0)
    turn_acceleration: float = option(60.0, at_least=0.0, unit="rad^2/s^3")
    limb_decay_s: float = option(0.3, above=0.0)
    limb_acceleration: float = option(60.0, at_least=0.0, unit="rad^2/s^3")
    shape_walk: float = option(1e-7, at_least=0.0, unit="m^2/s")
    top_speed_m_s: float = option(3.0, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.motion")

    def in_proportion(self, scale: float) -> "MotionOptions":
        """Return the same options for bodies of another size.

        Args:
            scale: Size of the body relative to an adult human.
        """
        slower = time_factor(scale)
        return replace(
            self,
            root_decay_s=self.root_decay_s * slower,
            root_acceleration=self.root_acceleration * scale**2 / slower**3,
            turn_decay_s=self.turn_decay_s * slower,
            turn_acceleration=self.turn_acceleration / slower**3,
            limb_decay_s=self.limb_decay_s * slower,
            limb_acceleration=self.limb_acceleration / slower**3,
            shape_walk=self.shape_walk * scale**2,
            top_speed_m_s=self.top_speed_m_s * scale / slower,
        )


@checked
@dataclass(frozen=True)
class PartOptions:
    """Tracking of hands and faces, each anchored where the body has it.

    Attributes:
        model_floor_m: Systematic offset between a part's model joint and the detector's keypoint, in meters.
        error_memory_s: Correlation time of detection errors, for the filter, in seconds.
        smoother_error_memory_s: Correlation time of detection errors, for the smoother, in seconds.
        smoother_independent_share: Fraction of each frame's information about hands that the smoother treats as
            independent.
        face_independent_share: Fraction of each frame's information about faces that the smoother treats as
            independent.
        turn_decay_s: Time constant of the decay of the angular velocity of palms, faces and jaws, in seconds.
        turn_acceleration: Spectral density of angular acceleration of palms, faces and jaws, in rad^2/s^3.
        limb_decay_s: Time constant of the decay of the angular velocity of fingers, in seconds.
        limb_acceleration: Spectral density of angular acceleration of fingers, in rad^2/s^3.
        anchor_sd_m: Standard deviation of the distance between a part's root and its anchor on the body, in meters.
        anchor_sd_deg: Standard deviation of the angle between a part's orientation and its anchor's, in degrees.
        anchor_memory_s: Correlation time of the body's errors at the anchor, in seconds.
        initiate_share: Fraction of a part's points that two views must show before the part is tracked.
        initiate_within_m: Maximum distance of a part from its anchor when its track is initiated, in meters.
        swap_margin_m: Distance by which two hands must be closer to each other's wrists before they are swapped, in
            meters.
    """

    model_floor_m: float = option(0.004, at_least=0.0)
    error_memory_s: float = option(0.094, at_least=0.0)
    smoother_error_memory_s: float = option(0.25, at_least=0.0)
    smoother_independent_share: float = option(0.0, at_least=0.0, at_most=1.0)
    face_independent_share: float = option(0.2, at_least=0.0, at_most=1.0)
    turn_decay_s: float = option(0.3, above=0.0)
    turn_acceleration: float = option(60.0, at_least=0.0, unit="rad^2/s^3")
    limb_decay_s: float = option(0.3, above=0.0)
    limb_acceleration: float = option(200.0, at_least=0.0, unit="rad^2/s^3")
    anchor_sd_m: float = option(0.01, at_least=0.0)
    anchor_sd_deg: float = option(15.0, at_least=0.0)
    anchor_memory_s: float = option(0.15, at_least=0.0)
    initiate_share: float = option(0.5, at_least=0.0, at_most=1.0)
    initiate_within_m: float = option(0.3, at_least=0.0)
    swap_margin_m: float = option(0.1, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.parts")

    def in_proportion(self, scale: float) -> "PartOptions":
        """Return the same options for bodies of another size.

        Args:
            scale: Size of the body relative to an adult human.
        """
        slower = time_factor(scale)
        return replace(
            self,
            model_floor_m=self.model_floor_m * scale,
            turn_decay_s=self.turn_decay_s * slower,
            turn_acceleration=self.turn_acceleration / slower**3,
            limb_decay_s=self.limb_decay_s * slower,
            limb_acceleration=self.limb_acceleration / slower**3,
            anchor_sd_m=self.anchor_sd_m * scale,
            initiate_within_m=self.initiate_within_m * scale,
            swap_margin_m=self.swap_margin_m * scale,
        )
