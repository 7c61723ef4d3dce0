"""Options of cross-view association: how detections of different views are combined into people."""

from dataclasses import dataclass, field, replace
from typing import Literal

from posefuse.arguments import checked
from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option

ProposalMethod = Literal["groups", "rpt"]

PROPOSAL_METHODS: dict[ProposalMethod, str] = {
    "groups": "pairs extended to at most one detection per view, scored by the odds that they show one person",
    "rpt": "pairs triangulated, scored and averaged in 3D (the baseline, after RapidPoseTriangulation)",
}
"""Proposal methods and their line in help; one file each under ``association/``."""


@dataclass(frozen=True)
class RptOptions:
    """Options of the proposal method rpt; the defaults are the published values where they are known.

    Attributes:
        min_score: Minimum mean keypoint score of a pair; 1 is a perfect match, 0.92 about 9 px at 1000 px image size.
        min_joint_score: Minimum score of a keypoint that is merged.
        center_distance_m: Maximum distance between the centers of two pairs of one person.
        keypoint_distance_m: Maximum mean distance between the common keypoints of two pairs for them to belong to one
            person.
        outlier_distance_m: Maximum distance of a pair's keypoint from the mean of all pairs; others are not merged.
        merged_pairs: Number of pairs nearest to the mean that are merged.
        min_pairs: Minimum number of pairs that support a person.
        score_steepness: Factor for the relative error in the score 1 / (1 + factor * error).
        max_error_share: Upper limit of a keypoint's reprojection error, as a fraction of the image size.
        reference_distance_m: Distance from the cameras at which the error has weight 1; the weight increases with
            distance.
        dropped_share: Fraction of a body's core keypoints, the worst ones, that its score leaves out.
    """

    min_score: float = option(0.92, at_least=0.0, at_most=1.0)
    min_joint_score: float = option(0.8, at_least=0.0, at_most=1.0)
    center_distance_m: float = option(0.6, above=0.0)
    keypoint_distance_m: float = option(0.3, above=0.0)
    outlier_distance_m: float = option(0.5, above=0.0)
    merged_pairs: int = option(3, at_least=1)
    min_pairs: int = option(1, at_least=1)
    score_steepness: float = option(10.0, above=0.0)
    max_error_share: float = option(0.25, above=0.0)
    reference_distance_m: float = option(3.5, above=0.0)
    dropped_share: float = option(0.2, at_least=0.0, below=1.0)

    def __post_init__(self) -> None:
        check_fields(self, "association.rpt")


@checked
@dataclass(frozen=True)
class AssociationOptions:
    """Options of the proposal of people from unassigned detections.

    The odds compare two hypotheses for the position of a detection's keypoints: the person that other views show, or a
    uniform distribution over a region as wide as ``clutter_share`` of the image.

    Attributes:
        method: Method that proposes people from the detections of several views.
        sigma_factor: Factor for the noise when views are compared; detectors and viewpoints differ in where they place
            a keypoint by more than their random error.
        saturation_sigma: Residual beyond which a view's cost stays constant in the robust triangulation of proposals.
        full_weight_sigma: Residual up to which a view has full weight in the refinement of proposals.
        zero_weight_sigma: Residual beyond which a view has no weight in the refinement of proposals.
        min_confidence: Minimum confidence of a keypoint that is used for association.
        min_common: Minimum number of core keypoints that two detections, or a detection and a group, must have in
            common.
        clutter_share: Width of the region in which another person's keypoint may be, as a fraction of the image width.
        outlier_share: Expected fraction of wrong keypoints in a detection of the right person.
        independent_keypoints: Number of common keypoints beyond which further keypoints add no evidence, because
            errors of neighboring keypoints are correlated.
        join_log_odds: Minimum log odds at which a detection joins a group.
        prior_log_odds: Prior log odds of a group; groups with positive posterior log odds are proposed.
        miss_log_odds: Change of a group's log odds for every view that should show the person and does not.
        independent_bones: Number of bones beyond which further bones add no evidence, because one wrong depth affects
            all of them.
        swap_log_odds: Prior log odds that a detection has left and right swapped.
        known_person_distance_m: Maximum mean keypoint distance at which a detection shows an already tracked person.
        duplicate_sigma: Maximum mean keypoint distance of two detections of one person in the same view.
        max_seeds: Maximum number of detection pairs that are extended in one pass.
        volume_m: Volume in which people are proposed, as minimum x, y, z and maximum x, y, z; unlimited by default.
        rpt: Options of the proposal method rpt.
    """

    method: ProposalMethod = "groups"
    sigma_factor: float = option(2.0, above=0.0)
    saturation_sigma: float = option(3.0, above=0.0)
    full_weight_sigma: float = option(2.0, above=0.0)
    zero_weight_sigma: float = option(4.0, above=0.0)
    min_confidence: float = option(0.1, at_least=0.0, at_most=1.0)
    min_common: int = option(3, at_least=1)
    clutter_share: float = option(0.25, above=0.0, at_most=1.0)
    outlier_share: float = option(0.1, above=0.0, below=1.0)
    independent_keypoints: float = option(6.0, above=0.0)
    join_log_odds: float = option(0.0)
    prior_log_odds: float = option(-3.0)
    miss_log_odds: float = option(-0.5, at_most=0.0)
    independent_bones: float = option(2.0, above=0.0)
    swap_log_odds: float = option(-4.0, at_most=0.0)
    known_person_distance_m: float = option(0.25, above=0.0)
    duplicate_sigma: float = option(1.5, above=0.0)
    max_seeds: int = option(64, at_least=1)
    volume_m: tuple[float, ...] = option((), lengths=(0, 6), example="[-3.0, -3.0, -0.5, 3.0, 3.0, 2.5]")
    rpt: RptOptions = field(default_factory=RptOptions)

    def __post_init__(self) -> None:
        check_fields(self, "association")
        if not self.full_weight_sigma < self.zero_weight_sigma:
            raise OptionsError(
                "association.full_weight_sigma must be below zero_weight_sigma, got "
                f"{self.full_weight_sigma} and {self.zero_weight_sigma}."
            )
        low, high = self.volume_m[:3], self.volume_m[3:]
        if not all(a < b for a, b in zip(low, high, strict=True)):
            raise OptionsError(
                "association.volume_m must be the minimum x, y, z followed by the maximum x, y, z, each minimum below "
                f"its maximum, got {self.volume_m}."
            )

    def in_proportion(self, scale: float) -> "AssociationOptions":
        """Return the options for bodies of another size: lengths scale, except the volume and distances of cameras.

        Args:
            scale: Size of the body relative to an adult human.
        """
        rpt = self.rpt
        scaled = replace(
            rpt,
            center_distance_m=rpt.center_distance_m * scale,
            keypoint_distance_m=rpt.keypoint_distance_m * scale,
            outlier_distance_m=rpt.outlier_distance_m * scale,
        )
        distance_m = self.known_person_distance_m * scale
        return self if scale == 1.0 else replace(self, known_person_distance_m=distance_m, rpt=scaled)
