"""What to simulate: the record behind ``posefuse simulate`` and its flags."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from posefuse.errors import OptionsError, suggestion

Layout = Literal["ring", "corners", "aisle"]
LensKind = Literal["pinhole", "barrel", "fisheye"]
NoiseLaw = Literal["measured", "gaussian"]
SwapLaw = Literal["chain", "pair", "body"]
Activity = Literal["walk", "turn", "reach", "sit", "jump", "stand"]
ACTIVITIES: tuple[Activity, ...] = get_args(Activity)
MOST_CAMERAS = 32


@dataclass(frozen=True)
class DetectorOptions:
    """How the simulated detector errs.

    Attributes:
        noise: The law of small errors: as measured on a real detector, or white Gaussian.
        sigma_px: Standard deviation per axis of the Gaussian law, in px.
        outlier_share: Share of keypoints thrown somewhere else.
        outlier_px: How far they are thrown, from and to, in px.
        miss_share: Share of keypoints not detected, in spells of 0.2 s on average.
        swap_share: Share of time a limb's left and right are taken for each other in a view.
        max_offset_s: Each view's clock is off by up to this much either way.
        swap_law: What is swapped together: a limb in spells of 0.4 s, each pair in each frame by itself, or the whole
            body in spells of 1 s.
        swap_shares: The same share for each view, where views differ; by default all have swap_share.
    """

    noise: NoiseLaw = "measured"
    sigma_px: float = 2.0
    outlier_share: float = 0.01
    outlier_px: tuple[float, float] = (30.0, 300.0)
    miss_share: float = 0.02
    swap_share: float = 0.003
    max_offset_s: float = 0.0
    swap_law: SwapLaw = "chain"
    swap_shares: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("outlier_share", "miss_share", "swap_share"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise OptionsError(f"{name} must lie between 0 and 1, got {getattr(self, name)}.")
        object.__setattr__(self, "swap_shares", tuple(self.swap_shares))
        if not all(0.0 <= share < 1.0 for share in self.swap_shares):
            raise OptionsError(f"swap_shares must lie between 0 and 1, got {self.swap_shares}.")
        if self.swap_law not in get_args(SwapLaw):
            raise OptionsError(f"swap_law: no {self.swap_law!r}. {suggestion(self.swap_law, get_args(SwapLaw))}")
        if self.sigma_px < 0 or self.max_offset_s < 0 or not 0 <= self.outlier_px[0] <= self.outlier_px[1]:
            raise OptionsError(
                "sigma_px, max_offset_s and outlier_px must be 0 or more, outlier_px from small to large."
            )


CLEAN = DetectorOptions("gaussian", 2.0, outlier_share=0.0, miss_share=0.0, swap_share=0.0)
"""Nothing but white Gaussian noise of 2 px."""


@dataclass(frozen=True)
class SceneOptions:
    """What to simulate.

    Attributes:
        skeleton: Which keypoints, a shipped name or a TOML file; a human's if a human has them all, else a creature's.
        layout: Where the cameras stand.
        cameras: How many, 1 to 32.
        lens: What they see through; barrel has k1 = -0.28.
        duration_s: How long.
        rate_hz: Frames per second.
        activities: What the person does, in turn, 3 s each.
        size_m: Of a creature.
        seed: Of everything random; the same seed gives the same bytes.
        detector: How the detector errs.
    """

    skeleton: str = "halpe_26"
    layout: Layout = "ring"
    cameras: int = 5
    lens: LensKind = "pinhole"
    duration_s: float = 12.0
    rate_hz: float = 30.0
    activities: tuple[Activity, ...] = ("walk", "turn", "reach", "sit", "jump")
    size_m: float = 0.3
    seed: int = 0
    detector: DetectorOptions = field(default_factory=DetectorOptions)

    def __post_init__(self) -> None:
        if not (self.duration_s > 0 and self.rate_hz > 0):
            raise OptionsError(f"duration_s and rate_hz must be positive, got {self.duration_s} and {self.rate_hz}.")
        if not self.activities:
            raise OptionsError("activities must name at least one.")
        for activity in self.activities:
            if activity not in ACTIVITIES:
                raise OptionsError(f"No activity {activity!r}. {suggestion(activity, ACTIVITIES)}")
        if not 1 <= self.cameras <= MOST_CAMERAS:
            raise OptionsError(f"A simulated rig has 1 to {MOST_CAMERAS} cameras, got {self.cameras}.")
