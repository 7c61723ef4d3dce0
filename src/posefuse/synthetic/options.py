"""Options of ``posefuse simulate``: the scene and the errors of its detector."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option

Layout = Literal["ring", "corners", "aisle"]
LensKind = Literal["pinhole", "barrel", "fisheye"]
NoiseLaw = Literal["measured", "rtmpose", "gaussian"]
SwapLaw = Literal["chain", "pair", "body"]
Activity = Literal["walk", "turn", "reach", "sit", "jump", "stand"]
ACTIVITIES: tuple[Activity, ...] = get_args(Activity)
MOST_CAMERAS = 32


@dataclass(frozen=True)
class DetectorOptions:
    """Errors of the simulated detector.

    Attributes:
        noise: Distribution of small errors: measured on OpenPose, rtmpose (half of that, an assumption), or white
            Gaussian.
        sigma_px: Standard deviation per axis of Gaussian errors.
        outlier_share: Fraction of keypoints that are displaced as outliers.
        outlier_px: Minimum and maximum displacement of outliers.
        miss_share: Fraction of keypoints that are not detected, in intervals of 0.2 s on average.
        swap_share: Fraction of time in which a view has a limb's left and right swapped.
        max_offset_s: Maximum absolute clock offset of a view.
        swap_law: Keypoints that swap together: a limb (chain) for 0.4 s, each pair per frame (pair), or the whole body
            for 1 s (body).
        swap_shares: Fraction of swapped time per view, in the order of the views; by default swap_share for all.
    """

    noise: NoiseLaw = "measured"
    sigma_px: float = option(2.0, at_least=0.0)
    outlier_share: float = option(0.01, at_least=0.0, below=1.0)
    outlier_px: tuple[float, float] = option((30.0, 300.0), at_least=0.0, lengths=(2,))
    miss_share: float = option(0.02, at_least=0.0, below=1.0)
    swap_share: float = option(0.003, at_least=0.0, below=1.0)
    max_offset_s: float = option(0.0, at_least=0.0)
    swap_law: SwapLaw = "chain"
    swap_shares: tuple[float, ...] = option((), at_least=0.0, below=1.0)

    def __post_init__(self) -> None:
        check_fields(self, "detector")
        if self.outlier_px[0] > self.outlier_px[1]:
            raise OptionsError(f"detector.outlier_px must be a minimum and a maximum, got {self.outlier_px}.")


CURRENT = DetectorOptions("rtmpose", outlier_share=0.005, miss_share=0.01, swap_share=0.0015)
"""Assumed errors of a current detector such as RTMPose: half as large and frequent as those measured on OpenPose."""
CLEAN = DetectorOptions("gaussian", 2.0, outlier_share=0.0, miss_share=0.0, swap_share=0.0)
"""White Gaussian noise of 2 px and no other errors."""


@dataclass(frozen=True)
class SceneOptions:
    """Options of a simulated scene with one subject.

    Attributes:
        skeleton: Keypoint set, as a built-in name or a TOML file; keypoints that are not all human give a creature.
        layout: Arrangement of the cameras.
        cameras: Number of cameras.
        lens: Lens model of the cameras; barrel has k1 = -0.28.
        duration_s: Duration of the recording.
        rate_hz: Frame rate.
        activities: Activities of the person, 3 s each, in turn.
        size_m: Size of a creature.
        seed: Random seed; the same seed gives the same bytes.
        detector: Errors of the detector.
    """

    skeleton: str = "halpe_26"
    layout: Layout = "ring"
    cameras: int = option(5, at_least=1, at_most=MOST_CAMERAS)
    lens: LensKind = "pinhole"
    duration_s: float = option(12.0, above=0.0)
    rate_hz: float = option(30.0, above=0.0)
    activities: tuple[Activity, ...] = ("walk", "turn", "reach", "sit", "jump")
    size_m: float = option(0.3, above=0.0)
    seed: int = option(0, at_least=0)
    detector: DetectorOptions = field(default_factory=DetectorOptions)

    def __post_init__(self) -> None:
        check_fields(self, "")
        if not self.activities:
            raise OptionsError("activities must name at least one activity.")
