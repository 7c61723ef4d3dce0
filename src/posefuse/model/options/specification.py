"""What a user can choose about the tracker's preset `specification`: the weights and thresholds of the seed's terms.

Where the specification counts in frames, these are seconds; its pixels are sigmas of the noise law at confidence 1.
"""

import math
from dataclasses import dataclass, fields, replace

from posefuse.errors import OptionsError

_ONLY_POSITIVE = (
    "score_memory_s",
    "noise_memory_s",
    "max_residual_sigma",
    "min_noise",
    "max_noise",
    "tau_root_m",
    "tau_core_m",
)


@dataclass(frozen=True)
class SpecificationOptions:
    """Of the preset `specification`.

    Attributes:
        score_memory_s: In what time scores fade: lambda_s = exp(-dt / this), and what a frame adds counts 1 - lambda_s.
        pairs_weight: Tentative score: a pair of views (a1).
        views_weight: A view (a2).
        error_weight: A sigma of reprojection error, against it (a3).
        bones_weight: The coefficient of variation of its bones, against it (a4).
        missing_weight: A frame that does not show it, against it (a5).
        promote_score: From which tentative score on it is believed (tau_promote).
        active_views_weight: Score of who is followed: a view (b1).
        active_joints_weight: The share of their keypoints that any view shows (b2).
        active_error_weight: A sigma of reprojection error, against it (b3).
        active_missing_weight: A frame without support, against it (b4).
        lost_score: Below this they are lost (tau_lost).
        noise_memory_s: In what time a keypoint's noise in a view is forgotten: lambda_sigma = exp(-dt / this).
        noise_gain: By how much a squared residual adds to it (kappa).
        max_residual_sigma: No residual counts for more (r_max).
        min_noise: The least noise (sigma_min).
        max_noise: The greatest (sigma_max).
        match_gate: A detection can be a person's if its keypoints' squared distances, in sigmas, are on average less.
        id_bonus: By how much the detector's own identity being that of the last frame lessens the cost (lambda_id).
        tau_root_m: Distance of proposals: the pelvis' unit (tau_r).
        tau_core_m: The unit of core keypoints about the pelvis (tau_Z).
        core_weight: Of one of them against the pelvis (lambda_Z).
        cluster_gate: Proposals nearer than this are one, and go on with a tentative person.
        reacquire_gate: A proposal nearer than this to where a lost person is foretold is them (tau_reacq).
    """

    score_memory_s: float = 0.4
    pairs_weight: float = 0.2
    views_weight: float = 1.0
    error_weight: float = 0.5
    bones_weight: float = 4.0
    missing_weight: float = 2.0
    promote_score: float = 0.5
    active_views_weight: float = 0.5
    active_joints_weight: float = 1.0
    active_error_weight: float = 0.5
    active_missing_weight: float = 2.0
    lost_score: float = 0.0
    noise_memory_s: float = 0.4
    noise_gain: float = 0.5
    max_residual_sigma: float = 5.0
    min_noise: float = 0.5
    max_noise: float = 5.0
    match_gate: float = 30.0
    id_bonus: float = 10.0
    tau_root_m: float = 0.3
    tau_core_m: float = 0.15
    core_weight: float = 0.25
    cluster_gate: float = 4.0
    reacquire_gate: float = 9.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not math.isfinite(value):
                raise OptionsError(f"tracker.specification.{each.name} must be a finite number, got {value}.")
        for name in _ONLY_POSITIVE:
            if not getattr(self, name) > 0.0:
                raise OptionsError(f"tracker.specification.{name} must be positive, got {getattr(self, name)}.")
        if self.max_noise < self.min_noise:
            raise OptionsError(
                f"tracker.specification.max_noise must be at least min_noise ({self.min_noise}), got {self.max_noise}."
            )

    def in_proportion(self, scale: float) -> "SpecificationOptions":
        """The same for bodies of another size; lengths go with it.

        Args:
            scale: how large the body is next to an adult human.
        """
        return replace(self, tau_root_m=self.tau_root_m * scale, tau_core_m=self.tau_core_m * scale)
