"""What a user can choose about the solve over the whole recording; the text of each attribute is the help."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from posefuse.errors import OptionsError, suggestion

SmoothnessPrior = Literal["jerk", "acceleration"]
"""White jerk: a path without noise may be any parabola, a cubic costs as much as its jerk. White acceleration: without
noise it may be any straight line."""


@dataclass(frozen=True)
class TrajectoryOptions:
    """How paths are solved over a whole recording.

    Attributes:
        prior: What is white noise in a keypoint's motion: jerk, or acceleration.
        density: The prior's spectral density, m^2/s^5 for jerk and m^2/s^3 for acceleration, of every keypoint; by
            default fitted to the recording, keypoint by keypoint.
        burst_s: The density follows how lively the motion is over about so long; 0 for one density all the time.
        calm: How strongly that is drawn to the keypoint's own density, as if so many seconds had shown it.
        bones: Whether the skeleton's edges keep their lengths, as well as the recording shows that they do.
        least_bone_share: Bones keep their lengths no better than to this share.
        rigid_bone_share: Bones that the skeleton calls rigid keep theirs at least this well.
        correlation_s: How long detection errors last: the time in which their correlation falls to 1 / e; 0 if they
            are white; by default estimated from the recording.
        max_gap_s: Where no camera sees a keypoint for longer than this it has no point, and what comes before knows
            nothing of what comes after.
        max_sd_share: Points that no two views measured, and whose standard deviation is larger than this share of the
            subject's size, are not given.
        full_sigma: A view no farther from the path counts whole, in units of a detection's noise.
        none_sigma: A view farther from the path is rejected; between the two its weight falls smoothly.
        rounds: How often views are weighed and made linear anew.
    """

    prior: SmoothnessPrior = "jerk"
    density: float | None = None
    burst_s: float = 0.1
    calm: float = 0.005
    bones: bool = True
    least_bone_share: float = 0.003
    rigid_bone_share: float = 0.03
    correlation_s: float | None = None
    max_gap_s: float = 0.5
    max_sd_share: float = 0.05
    full_sigma: float = 2.5
    none_sigma: float = 5.0
    rounds: int = 6

    def __post_init__(self) -> None:
        if self.prior not in get_args(SmoothnessPrior):
            raise OptionsError(
                f"trajectory.prior: no {self.prior!r}. {suggestion(str(self.prior), get_args(SmoothnessPrior))}"
            )
        if self.density is not None and not 0.0 < self.density < math.inf:
            raise OptionsError(f"trajectory.density must be positive, got {self.density}.")
        for name in ("burst_s", "least_bone_share", "max_gap_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise OptionsError(f"trajectory.{name} must be 0 or more, got {getattr(self, name)}.")
        if not self.least_bone_share <= self.rigid_bone_share < math.inf:
            raise OptionsError(
                "trajectory.rigid_bone_share must be at least least_bone_share, got "
                f"{self.rigid_bone_share} and {self.least_bone_share}."
            )
        if self.correlation_s is not None and not 0.0 <= self.correlation_s < math.inf:
            raise OptionsError(f"trajectory.correlation_s must be 0 or more, got {self.correlation_s}.")
        for name in ("calm", "max_sd_share"):
            if not getattr(self, name) > 0.0:
                raise OptionsError(f"trajectory.{name} must be positive, got {getattr(self, name)}.")
        if not 0.0 < self.full_sigma < self.none_sigma:
            raise OptionsError(
                "trajectory.full_sigma must be positive and less than none_sigma, got "
                f"{self.full_sigma} and {self.none_sigma}."
            )
        if self.rounds < 1:
            raise OptionsError(f"trajectory.rounds must be at least 1, got {self.rounds}.")
