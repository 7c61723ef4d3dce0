"""Everything a user can choose, once: the Python API, the command line's flags and the TOML file are this record.

The text of each attribute is the help a user reads, in ``--help`` and in the file that ``posefuse init`` writes.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from posefuse.errors import OptionsError, choices, suggestion
from posefuse.model.cameras import UP_AXES, UpAxis
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.options.association import AssociationOptions
from posefuse.model.options.left_right import SideMethod, SideOptions
from posefuse.model.options.named_numbers import named_numbers
from posefuse.model.options.pairs import PairMethod, PairOptions
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.options.subject import SubjectOptions
from posefuse.model.options.sync import SyncOptions
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.options.trajectory import TrajectoryOptions

People = Literal["auto", "one", "many"]
Bodies = Literal["auto", "fit", "none"]
Pick = Literal["largest", "track-id"]
ThirdChannel = Literal["confidence", "depth"]
LengthUnit = Literal["m", "cm", "mm"]
ErrorUnit = Literal["px", "normalised"]
RansacUnit = Literal["px", "m"]
LayerName = Literal["measured", "solved", "model"]
Solve = Literal["auto", "frame", "trajectory"]

METHODS: dict[str, str] = {
    "consensus": "the point most views agree on; wrong views are found, named and left out",
    "simple": "every valid view, maximum likelihood, nothing rejected (FreeMoCap's standard triangulation)",
    "weighted_subsets": "the weighted mean over subsets of the cameras (FreeMoCap's outlier rejection)",
    "percentile_filter": "the worst cameras dropped until errors are small (FreeMoCap's reprojection error filter)",
    "ransac": "two views propose, the proposal that most views agree with is refined",
    "irls": "every valid view, reweighted by Huber's law, from the linear start",
    "midpoint": "where the rays come closest to each other, nothing rejected",
}
"""Triangulation methods and their line in ``posefuse methods``; one file each under ``triangulation/``."""


@dataclass(frozen=True)
class ConsensusOptions:
    """How the method `consensus` tells views that agree from views that do not, in units of a detection's noise.

    Attributes:
        bound_sigma: Searching: a view this far off says nothing more by being farther off.
        full_sigma: Refining: a view no farther off counts whole.
        none_sigma: Refining: a view farther off is rejected; between the two its weight falls smoothly.
    """

    bound_sigma: float = 4.0
    full_sigma: float = 2.5
    none_sigma: float = 5.0

    def __post_init__(self) -> None:
        if not self.bound_sigma > 0:
            raise OptionsError(f"triangulation.consensus.bound_sigma must be positive, got {self.bound_sigma}.")
        if not 0 < self.full_sigma < self.none_sigma:
            raise OptionsError(
                "triangulation.consensus.full_sigma must be positive and less than none_sigma, got "
                f"{self.full_sigma} and {self.none_sigma}."
            )


@dataclass(frozen=True)
class WeightedSubsetsOptions:
    """Of the method `weighted_subsets`.

    Attributes:
        target_reprojection_error: Points with a mean reprojection error above are tried with fewer cameras.
        target_unit: What the target is in, px or shares of the focal length (as in FreeMoCap's program, 0.01 there).
        max_cameras_to_drop: How many cameras at most are left out of a point.
    """

    target_reprojection_error: float = 10.0
    target_unit: ErrorUnit = "px"
    max_cameras_to_drop: int = 1

    def __post_init__(self) -> None:
        if not self.target_reprojection_error > 0:
            raise OptionsError(
                "triangulation.weighted_subsets.target_reprojection_error must be positive, got "
                f"{self.target_reprojection_error}."
            )
        if self.max_cameras_to_drop < 0:
            raise OptionsError(
                "triangulation.weighted_subsets.max_cameras_to_drop cannot be negative, got "
                f"{self.max_cameras_to_drop}."
            )


@dataclass(frozen=True)
class PercentileFilterOptions:
    """Of the method `percentile_filter`.

    Attributes:
        percentile: Of all reprojection errors of a recording, in each view, those beyond this percentile are too large.
        threshold_px: Too large is what exceeds this; by default what the percentile comes to.
    """

    percentile: float = 90.0
    threshold_px: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.percentile <= 100:
            raise OptionsError(
                f"triangulation.percentile_filter.percentile must lie between 0 and 100, got {self.percentile}."
            )


@dataclass(frozen=True)
class RansacOptions:
    """Of the method `ransac`.

    Attributes:
        threshold: A view agrees with a point no farther off.
        threshold_unit: What the threshold is in, px in the image or m between point and ray.
        max_iterations: Beyond so many pairs of views, so many are drawn.
        confidence: Drawing ends when a pair of agreeing views was drawn with this probability.
        seed: Of the draws.
    """

    threshold: float = 15.0
    threshold_unit: RansacUnit = "px"
    max_iterations: int = 200
    confidence: float = 0.999
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.threshold > 0:
            raise OptionsError(f"triangulation.ransac.threshold must be positive, got {self.threshold}.")
        if self.max_iterations < 1:
            raise OptionsError(f"triangulation.ransac.max_iterations must be at least 1, got {self.max_iterations}.")
        if not 0 < self.confidence < 1:
            raise OptionsError(f"triangulation.ransac.confidence must lie between 0 and 1, got {self.confidence}.")


@dataclass(frozen=True)
class TriangulationOptions:
    """How 3D points come from 2D detections.

    Attributes:
        method: One of the methods that `posefuse methods` lists.
        min_views: Points with fewer valid views are missing; by default what the method says, 2 or 3. Lowered to the
            number of cameras, with a warning, on a smaller rig.
        min_confidence: Detections below are not used.
        confidence_exponent: Trust a detection in proportion to its confidence to twice this power; 0 trusts all alike.
        flatten_single_view: With one camera, put the keypoints in the plane z = 0; if false, z is the detector's depth.
        consensus: Of the method of that name.
        weighted_subsets: Of the method of that name.
        percentile_filter: Of the method of that name.
        ransac: Of the method of that name.
    """

    method: str = "consensus"
    min_views: int | None = None
    min_confidence: float = 0.2
    confidence_exponent: float = 0.0
    flatten_single_view: bool = True
    consensus: ConsensusOptions = field(default_factory=ConsensusOptions)
    weighted_subsets: WeightedSubsetsOptions = field(default_factory=WeightedSubsetsOptions)
    percentile_filter: PercentileFilterOptions = field(default_factory=PercentileFilterOptions)
    ransac: RansacOptions = field(default_factory=RansacOptions)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise OptionsError(f"triangulation.method: no method {self.method!r}. {suggestion(self.method, METHODS)}")
        if self.min_views is not None and self.min_views < 2:
            raise OptionsError(f"triangulation.min_views must be at least 2, got {self.min_views}.")
        if not self.min_confidence >= 0.0:
            raise OptionsError(f"triangulation.min_confidence must be 0 or more, got {self.min_confidence}.")
        if not 0.0 <= self.confidence_exponent <= 4.0:
            raise OptionsError(
                f"triangulation.confidence_exponent must lie between 0 and 4, got {self.confidence_exponent}."
            )


@dataclass(frozen=True)
class NoiseOptions:
    """The noise of a detector, as `posefuse calibrate-noise` writes it; what is not set is estimated.

    Attributes:
        cameras: Which cameras the scales are of, by name.
        scale_px: The standard deviation of each one's detections at a confidence of 1, in px per axis.
        spread: How far accepted detections err in these units; covariances are larger by its square.
        nu: Degrees of freedom of the errors' tails; kept with the result.
    """

    cameras: tuple[str, ...] = ()
    scale_px: tuple[float, ...] = ()
    spread: float = 1.0
    nu: float | None = None

    def __post_init__(self) -> None:
        for name in ("cameras", "scale_px"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if len(self.cameras) != len(self.scale_px):
            raise OptionsError(
                f"noise.scale_px holds one number for each of noise.cameras: expected {len(self.cameras)}, got "
                f"{len(self.scale_px)}."
            )
        for name, value in (
            *((f"scale_px of {c}", s) for c, s in zip(self.cameras, self.scale_px, strict=True)),
            ("spread", self.spread),
            ("nu", self.nu),
        ):
            if value is not None and not value > 0:
                raise OptionsError(f"noise.{name} must be positive, got {value}.")


@dataclass(frozen=True)
class Options:
    """Everything a user can choose about a reconstruction.

    Attributes:
        people: How many there are: one subject in every view, many who come and go, or auto: many if a view ever shows
            several.
        person: Keep only these people of many, by name (person_1); by default all.
        bodies: Whether articulated bodies are fitted to people: to many (auto), to one subject too (fit), or to
            nobody (none; many are followed all the same).
        pick: Which person to take where a view shows several; by default that is an error.
        skeleton: What the keypoints are, a shipped name or a TOML file; by default the one the files name or
            their number of keypoints allows.
        rate_hz: Frames per second, for files that do not say.
        view_rates_hz: Frames per second of views that began together, each as view=rate, such as cam_2=60; `rate_hz` is
            of the others.
        reference_view: The view that frames are put together by, where times say that views differ in length or rate;
            by default the slowest, and of the slowest the longest.
        third_channel: What the third number of a keypoint array is.
        image_size: Width and height of the images in px, for keypoints that are shares of them.
        length_unit: The unit of the calibration's lengths, for formats that do not say.
        up: The world's up axis, for calibrations that do not say.
        cameras: Use only these cameras, by name.
        exclude_camera: Leave these cameras out, by name.
        camera_order: Which camera each view belongs to, in the order of the views, where names do not tell.
        start_s: Leave out what comes before, in seconds.
        end_s: Leave out what comes from then on, in seconds.
        noise_scale_px: The standard deviation of every detection in px per axis; by default estimated from the
            recording.
        layer: Which layer exports and evaluation take; by default the best present.
        triangulation: How 3D points come from 2D detections.
        noise: The noise of each camera's detections, from a file.
        sync: How late views are, from a file.
        pairs: How left and right keypoints are found, by solving for two points without believing the labels
            (enumerate, sds) or each by its label; by default enumerate with the method consensus, labels with others.
        sides: How it is decided which of the two points is left: limb by limb and over time (chains), frame by frame
            (votes), or by where the person faces (plane).
        pair_search: How pairs are solved.
        side_search: How sides are decided.
        association: How people are proposed from the detections of several views.
        tracker: How people are followed.
        solve: What points over time are solved from: each frame by itself (frame), or all frames together (trajectory);
            auto takes the trajectory for one subject, seen by two cameras or more for ten seconds or more, where the
            method is consensus.
        trajectory: How all frames are solved together.
        postprocess: What is done with points over time, once they are solved.
        subject: Of whom the recording is.
        align: How the world of the result is laid.
        chunk_frames: How many frames are worked on at once; of a longer recording every chunk is kept when it is done,
            and the same command goes on from there after it was ended.
    """

    people: People = "auto"
    person: tuple[str, ...] = ()
    bodies: Bodies = "auto"
    pick: Pick | None = None
    skeleton: str | None = None
    rate_hz: float | None = None
    view_rates_hz: tuple[str, ...] = ()
    reference_view: str | None = None
    third_channel: ThirdChannel | None = None
    image_size: tuple[int, ...] = ()
    length_unit: LengthUnit | None = None
    up: UpAxis | None = None
    cameras: tuple[str, ...] = ()
    exclude_camera: tuple[str, ...] = ()
    camera_order: tuple[str, ...] = ()
    start_s: float | None = None
    end_s: float | None = None
    noise_scale_px: float | None = None
    layer: LayerName | None = None
    triangulation: TriangulationOptions = field(default_factory=TriangulationOptions)
    noise: NoiseOptions = field(default_factory=NoiseOptions)
    sync: SyncOptions = field(default_factory=SyncOptions)
    pairs: PairMethod | None = None
    sides: SideMethod = "chains"
    pair_search: PairOptions = field(default_factory=PairOptions)
    side_search: SideOptions = field(default_factory=SideOptions)
    association: AssociationOptions = field(default_factory=AssociationOptions)
    tracker: TrackerOptions = field(default_factory=TrackerOptions)
    solve: Solve = "auto"
    trajectory: TrajectoryOptions = field(default_factory=TrajectoryOptions)
    postprocess: PostprocessOptions = field(default_factory=PostprocessOptions)
    subject: SubjectOptions = field(default_factory=SubjectOptions)
    align: AlignOptions = field(default_factory=AlignOptions)
    chunk_frames: int = 2048

    def __post_init__(self) -> None:
        for name in ("rate_hz", "noise_scale_px", "chunk_frames"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise OptionsError(f"{name} must be positive, got {value}.")
        object.__setattr__(self, "image_size", tuple(self.image_size))
        if self.image_size and (len(self.image_size) != 2 or min(self.image_size) < 1):
            raise OptionsError(f"image_size is two numbers, width and height in px, got {self.image_size}.")
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise OptionsError(f"end_s ({self.end_s}) must come after start_s ({self.start_s}).")
        for name in ("cameras", "exclude_camera", "camera_order", "person", "view_rates_hz"):
            value = getattr(self, name)
            if isinstance(value, str) or not all(isinstance(one, str) for one in value):
                raise OptionsError(f"{name} is a tuple of names, got {value!r}.")
            object.__setattr__(self, name, tuple(value))
        for name, allowed in (
            ("people", get_args(People)),
            ("bodies", get_args(Bodies)),
            ("up", UP_AXES),
            ("pick", get_args(Pick)),
            ("layer", get_args(LayerName)),
            ("solve", get_args(Solve)),
            ("pairs", get_args(PairMethod)),
            ("sides", get_args(SideMethod)),
        ):
            value = getattr(self, name)
            if value is not None and value not in allowed:
                raise OptionsError(f"{name}: no {value!r}. {suggestion(str(value), allowed)}")
        for name, rate_hz in self.rates_hz.items():
            if not (name and 0.0 < rate_hz < math.inf):
                raise OptionsError(f"view_rates_hz holds view=rate, rates above 0, got {name}={rate_hz}.")
        both = sorted(set(self.cameras) & set(self.exclude_camera))
        if both:
            raise OptionsError(f"cameras and exclude_camera both name {choices(both)}.")

    @property
    def rates_hz(self) -> dict[str, float]:
        """By view, the rates that ``view_rates_hz`` holds.

        Raises:
            OptionsError: if an entry is not view=rate.
        """
        return named_numbers(self.view_rates_hz, "view_rates_hz", "view=rate", "cam_2=60")
