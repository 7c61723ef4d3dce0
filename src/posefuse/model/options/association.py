"""What a user can choose about how detections of different views become people."""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

from posefuse.errors import OptionsError, choices

ProposalMethod = Literal["groups", "rpt"]

PROPOSAL_METHODS: dict[ProposalMethod, str] = {
    "groups": "pairs grown to at most one detection a view, by the odds that they show one person",
    "rpt": "pairs triangulated, scored and averaged in 3D (the baseline, after RapidPoseTriangulation)",
}
"""Methods that propose people and their line in help; one file each under ``association/``."""


@dataclass(frozen=True)
class RptOptions:
    """Of the method `rpt`; the defaults are the published ones as far as they are known.

    Attributes:
        min_score: Pairs whose keypoints score less on average are dropped; 1 is perfect, 0.92 about 9 px at 1000 px.
        min_joint_score: Keypoints of a pair that score less are not merged.
        centre_within_m: Pairs are of one person if their centres are no farther apart.
        joints_within_m: And their common keypoints on average no farther.
        spread_m: Keypoints of a pair farther than this from the mean of all are not merged.
        nearest: So many of the pairs, those nearest to the mean, are merged.
        min_pairs: People whom fewer pairs support are dropped.
    """

    min_score: float = 0.92
    min_joint_score: float = 0.8
    centre_within_m: float = 0.6
    joints_within_m: float = 0.3
    spread_m: float = 0.5
    nearest: int = 3
    min_pairs: int = 1

    def __post_init__(self) -> None:
        for name in ("min_score", "min_joint_score"):
            _check_share("rpt.", name, getattr(self, name))
        for name in ("centre_within_m", "joints_within_m", "spread_m"):
            _check_positive("rpt.", name, getattr(self, name))
        for name in ("nearest", "min_pairs"):
            if getattr(self, name) < 1:
                raise OptionsError(f"association.rpt.{name} must be at least 1, got {getattr(self, name)}.")


@dataclass(frozen=True)
class AssociationOptions:
    """How people are proposed from detections that nobody claims.

    Odds compare two explanations of where a detection's keypoints lie: the person that other views show, or anything
    anywhere within ``clutter_share`` of the image.

    Attributes:
        method: How people are proposed.
        sigma_factor: Views are compared with the noise model's sigma times this: two detectors, or one from two
            sides, differ in what they call a hip by more than either errs.
        bound_sigma: Solving: a view this far off says nothing more by being farther off.
        full_sigma: Solving: a view no farther off counts whole.
        none_sigma: Solving: a view farther off is left out.
        min_confidence: Keypoints with less are not used.
        min_common: So many core keypoints must be common to two detections, or to a detection and a group.
        clutter_share: A keypoint of somebody else lies anywhere in a region as wide as this share of the image.
        outlier_share: How many keypoints of a detection are wrong although the person is right.
        independent_keypoints: More common keypoints than this add no more evidence: if one fits by chance, so do
            its neighbours.
        join_log_odds: A detection joins a group from these odds on.
        prior_log_odds: The odds of a group before anything is known of it; people are proposed where all odds together
            are positive.
        miss_log_odds: For every view that should show a person and shows nothing there.
        independent_bones: More bones than this add no more evidence: a wrong depth makes all of them wrong.
        swap_log_odds: The odds that a detection has left and right mixed up.
        known_within_m: A detection shows a known person if its keypoints are on average no farther from theirs.
        duplicate_sigma: Two detections of a view are of one person if their keypoints are on average no farther apart.
        max_seeds: At most so many pairs are grown at a time.
        volume_m: Where people can be, the least x, y, z and the greatest x, y, z; by default anywhere.
        rpt: Of the method of that name.
    """

    method: ProposalMethod = "groups"
    sigma_factor: float = 2.0
    bound_sigma: float = 3.0
    full_sigma: float = 2.0
    none_sigma: float = 4.0
    min_confidence: float = 0.1
    min_common: int = 3
    clutter_share: float = 0.25
    outlier_share: float = 0.1
    independent_keypoints: float = 6.0
    join_log_odds: float = 0.0
    prior_log_odds: float = -3.0
    miss_log_odds: float = -0.5
    independent_bones: float = 2.0
    swap_log_odds: float = -4.0
    known_within_m: float = 0.25
    duplicate_sigma: float = 1.5
    max_seeds: int = 64
    volume_m: tuple[float, ...] = ()
    rpt: RptOptions = field(default_factory=RptOptions)

    def __post_init__(self) -> None:
        if self.method not in PROPOSAL_METHODS:
            raise OptionsError(
                f"association.method: no method {self.method!r}. Choose one of: {choices(PROPOSAL_METHODS)}."
            )
        for name in ("sigma_factor", "independent_keypoints", "independent_bones", "known_within_m", "duplicate_sigma"):
            _check_positive("", name, getattr(self, name))
        for name in ("min_confidence", "clutter_share", "outlier_share"):
            _check_share("", name, getattr(self, name))
        for name in ("miss_log_odds", "swap_log_odds"):
            if not -math.inf < getattr(self, name) <= 0.0:
                raise OptionsError(f"association.{name} must be 0 or less, got {getattr(self, name)}.")
        for name in ("min_common", "max_seeds"):
            if getattr(self, name) < 1:
                raise OptionsError(f"association.{name} must be at least 1, got {getattr(self, name)}.")
        if not 0.0 < self.outlier_share < 1.0 or not self.clutter_share > 0.0:
            raise OptionsError(
                "association.outlier_share must lie between 0 and 1 and clutter_share above 0, got "
                f"{self.outlier_share} and {self.clutter_share}."
            )
        if not (self.bound_sigma > 0.0 and 0.0 < self.full_sigma < self.none_sigma):
            raise OptionsError(
                "association.bound_sigma must be positive, and full_sigma positive and less than none_sigma, got "
                f"{self.bound_sigma}, {self.full_sigma} and {self.none_sigma}."
            )
        object.__setattr__(self, "volume_m", tuple(self.volume_m))
        low, high = self.volume_m[:3], self.volume_m[3:]
        if self.volume_m and not (len(self.volume_m) == 6 and all(a < b for a, b in zip(low, high, strict=True))):
            raise OptionsError(
                "association.volume_m is six numbers, the least x, y, z and the greatest x, y, z, each least below its "
                f"greatest; got {self.volume_m}."
            )

    def in_proportion(self, scale: float) -> "AssociationOptions":
        """The same for bodies of another size: lengths go with it, but for where they can be.

        Args:
            scale: how large a body is next to an adult human.
        """
        rpt = self.rpt
        wider = replace(
            rpt, centre_within_m=rpt.centre_within_m * scale, joints_within_m=rpt.joints_within_m * scale,
            spread_m=rpt.spread_m * scale,
        )  # fmt: skip
        return self if scale == 1.0 else replace(self, known_within_m=self.known_within_m * scale, rpt=wider)


def _check_positive(table: str, name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise OptionsError(f"association.{table}{name} must be positive, got {value}.")


def _check_share(table: str, name: str, value: float) -> None:
    if not 0.0 <= value <= 1.0:
        raise OptionsError(f"association.{table}{name} must lie between 0 and 1, got {value}.")
