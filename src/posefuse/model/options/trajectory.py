"""Options of the trajectory solve over a whole recording."""

from dataclasses import dataclass
from typing import Literal

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option

SmoothnessPrior = Literal["jerk", "acceleration"]
"""Derivative of the position that is modeled as white noise. Noise-free trajectories are parabolas with white jerk and
straight lines with white acceleration."""


@dataclass(frozen=True)
class TrajectoryOptions:
    """Options of the trajectory solve, which estimates the points of all frames together.

    Attributes:
        prior: Derivative of a keypoint's position that is modeled as white noise: jerk or acceleration.
        density: Spectral density of the prior for every keypoint, in m^2/s^5 for jerk and m^2/s^3 for acceleration; by
            default fitted to the recording per keypoint.
        density_window_s: Window over which the spectral density follows the motion; 0 uses one density throughout.
        density_prior_s: Amount of data by which the windowed density is pulled toward the keypoint's overall density.
        bones: Constrain the skeleton's bones to their lengths, as tightly as the recording supports.
        min_bone_variation: Minimum standard deviation of bone lengths that the bone constraint assumes, as a fraction
            of the length.
        max_rigid_bone_variation: Maximum standard deviation of rigid bones that the bone constraint assumes, as a
            fraction of the length.
        correlation_s: Correlation time (1/e) of detection errors; 0 assumes white noise, and by default it is
            estimated from the recording.
        max_gap_s: Longest time without any observation of a keypoint that a trajectory bridges; longer gaps split it.
        max_sd_share: Maximum standard deviation of a point that fewer than two views observe, as a fraction of the
            subject's size; points above it are missing.
        full_weight_sigma: Distance from the trajectory up to which an observation has full weight.
        zero_weight_sigma: Distance from the trajectory beyond which an observation is rejected; the weight falls
            smoothly in between.
        iterations: Maximum number of times that observations are reweighted and linearized.
    """

    prior: SmoothnessPrior = "jerk"
    density: float | None = option(None, above=0.0, unit="m^2/s^5 or m^2/s^3", example="1000.0")
    density_window_s: float = option(0.1, at_least=0.0, at_most=60.0)
    density_prior_s: float = option(0.005, above=0.0)
    bones: bool = True
    min_bone_variation: float = option(0.003, at_least=0.0)
    max_rigid_bone_variation: float = option(0.03, at_least=0.0)
    correlation_s: float | None = option(None, at_least=0.0, example="0.25")
    max_gap_s: float = option(0.5, at_least=0.0)
    max_sd_share: float = option(0.05, above=0.0)
    full_weight_sigma: float = option(2.5, above=0.0)
    zero_weight_sigma: float = option(5.0, above=0.0)
    iterations: int = option(6, at_least=1, at_most=1000)

    def __post_init__(self) -> None:
        check_fields(self, "trajectory")
        if not self.min_bone_variation <= self.max_rigid_bone_variation:
            raise OptionsError(
                "trajectory.max_rigid_bone_variation must be at least min_bone_variation, got "
                f"{self.max_rigid_bone_variation} and {self.min_bone_variation}."
            )
        if not self.full_weight_sigma < self.zero_weight_sigma:
            raise OptionsError(
                "trajectory.full_weight_sigma must be below zero_weight_sigma, got "
                f"{self.full_weight_sigma} and {self.zero_weight_sigma}."
            )
