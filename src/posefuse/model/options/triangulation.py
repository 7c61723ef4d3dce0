"""Options of triangulation."""

from dataclasses import dataclass, field
from typing import Literal

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, check_one_of, option

FreeMoCapRules = Literal["documentation", "program"]
FREEMOCAP_METHODS = ("simple", "weighted_subsets", "percentile_filter")

METHODS: dict[str, str] = {
    "consensus": "finds the point that most views agree on, then identifies and rejects outlier views",
    "simple": "uses every valid view with maximum likelihood and rejects none (FreeMoCap's standard triangulation)",
    "weighted_subsets": "takes the weighted mean over subsets of the cameras (FreeMoCap's outlier rejection)",
    "percentile_filter": "drops the worst cameras until errors are small (FreeMoCap's reprojection error filter)",
    "ransac": "samples pairs of views and refines the hypothesis with the most inliers",
    "irls": "uses every valid view and reweights them with the Huber loss, from the linear solution",
    "midpoint": "takes the point closest to all rays and rejects none",
}
"""Triangulation methods and their line in ``posefuse methods``; one file each under ``triangulation/``."""


@dataclass(frozen=True)
class ConsensusOptions:
    """Options of the method consensus; residuals are in standard deviations of the detection noise.

    Attributes:
        saturation_sigma: Residual beyond which a view's cost stays constant in the search for the consensus.
        full_weight_sigma: Residual up to which a view has full weight in the refinement.
        zero_weight_sigma: Residual beyond which a view is rejected; the weight falls smoothly in between.
    """

    saturation_sigma: float = option(4.0, above=0.0)
    full_weight_sigma: float = option(2.5, above=0.0)
    zero_weight_sigma: float = option(5.0, above=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "triangulation.consensus")
        if not self.full_weight_sigma < self.zero_weight_sigma:
            raise OptionsError(
                "triangulation.consensus.full_weight_sigma must be below zero_weight_sigma, got "
                f"{self.full_weight_sigma} and {self.zero_weight_sigma}."
            )


@dataclass(frozen=True)
class WeightedSubsetsOptions:
    """Options of the method weighted_subsets.

    Attributes:
        target_px: Mean reprojection error above which a point is triangulated with fewer cameras.
        target_normalized: Mean reprojection error, as a fraction of the focal length, above which a point is
            triangulated with fewer cameras. It replaces target_px; FreeMoCap uses 0.01.
        max_cameras_to_drop: Maximum number of cameras that are left out of a point.
    """

    target_px: float = option(10.0, above=0.0)
    target_normalized: float | None = option(None, above=0.0, below=1.0, example="0.01")
    max_cameras_to_drop: int = option(1, at_least=0)

    def __post_init__(self) -> None:
        check_fields(self, "triangulation.weighted_subsets")
        check_one_of(self, "triangulation.weighted_subsets", "target_px", "target_normalized")


@dataclass(frozen=True)
class PercentileFilterOptions:
    """Options of the method percentile_filter.

    Attributes:
        percentile: Percentile of the views' reprojection errors over the recording that becomes the threshold.
        threshold_px: Threshold for reprojection errors, instead of the percentile.
        min_views_left: Minimum number of views to which a point is reduced before it is missing; with as many cameras
            or fewer, the method percentile_filter drops none.
    """

    percentile: float = option(90.0, at_least=0.0, at_most=100.0)
    threshold_px: float | None = option(None, at_least=0.0, example="15.0")
    min_views_left: int = option(3, at_least=2)

    def __post_init__(self) -> None:
        check_fields(self, "triangulation.percentile_filter")


@dataclass(frozen=True)
class RansacOptions:
    """Options of the method ransac.

    Attributes:
        threshold_px: Maximum reprojection error of an inlier view.
        threshold_m: Maximum distance between the point and the ray of an inlier view, instead of threshold_px.
        max_iterations: Maximum number of view pairs to sample.
        confidence: Probability of having sampled a pair of inlier views at which sampling stops.
        seed: Random seed of the sampled view pairs.
    """

    threshold_px: float = option(15.0, above=0.0)
    threshold_m: float | None = option(None, above=0.0, example="0.05")
    max_iterations: int = option(200, at_least=1)
    confidence: float = option(0.999, above=0.0, below=1.0)
    seed: int = option(0, at_least=0)

    def __post_init__(self) -> None:
        check_fields(self, "triangulation.ransac")
        check_one_of(self, "triangulation.ransac", "threshold_px", "threshold_m")


@dataclass(frozen=True)
class TriangulationOptions:
    """Options of the triangulation of 3D points from 2D detections.

    Attributes:
        method: Triangulation method; `posefuse methods` lists them.
        min_views: Minimum number of views per point. The default is 2 or 3, depending on the method; a smaller rig
            lowers it to the number of cameras, with a warning.
        min_confidence: Minimum detection confidence.
        confidence_exponent: Exponent of the noise model: the standard deviation of a detection is proportional to its
            confidence raised to minus this value; 0 gives all detections the same noise.
        flatten_single_view: With a single camera, place the keypoints in the plane z = 0 instead of at the detector's
            depth.
        freemocap_rules: Rules of the methods simple, weighted_subsets and percentile_filter: those of FreeMoCap's
            documentation, with maximum-likelihood points, or those of its program, with linear points.
        consensus: Options of the method consensus.
        weighted_subsets: Options of the method weighted_subsets.
        percentile_filter: Options of the method percentile_filter.
        ransac: Options of the method ransac.
    """

    method: str = option("consensus", choices=METHODS, common=True)
    min_views: int | None = option(None, at_least=2, common=True, example="3")
    min_confidence: float = option(0.2, at_least=0.0, common=True)
    confidence_exponent: float = option(0.0, at_least=0.0, at_most=4.0)
    flatten_single_view: bool = True
    freemocap_rules: FreeMoCapRules = "documentation"
    consensus: ConsensusOptions = field(default_factory=ConsensusOptions)
    weighted_subsets: WeightedSubsetsOptions = field(default_factory=WeightedSubsetsOptions)
    percentile_filter: PercentileFilterOptions = field(default_factory=PercentileFilterOptions)
    ransac: RansacOptions = field(default_factory=RansacOptions)

    def __post_init__(self) -> None:
        check_fields(self, "triangulation")

    @property
    def follows_program(self) -> bool:
        """Whether the method has the rules of FreeMoCap's program."""
        return self.freemocap_rules == "program" and self.method in FREEMOCAP_METHODS
