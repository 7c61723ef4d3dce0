"""Everything a user can choose, once: the Python API, the command line's flags and the TOML file are this record.

The text of each attribute is the help a user reads, in ``--help`` and in the file that ``posefuse init`` writes.
"""

from dataclasses import dataclass, field
from typing import Literal

from posefuse.errors import OptionsError, choices, suggestion
from posefuse.model.cameras import UpAxis

People = Literal["one"]
Pick = Literal["largest", "track-id"]
ThirdChannel = Literal["confidence", "depth"]
LengthUnit = Literal["m", "cm", "mm"]
LayerName = Literal["measured", "solved", "model"]

METHODS: dict[str, str] = {
    "simple": "every valid view, maximum likelihood, nothing rejected (FreeMoCap's standard triangulation)",
}
"""Triangulation methods and their line in ``posefuse methods``; one file each under ``triangulation/``."""


@dataclass(frozen=True)
class TriangulationOptions:
    """How 3D points come from 2D detections.

    Attributes:
        method: One of the methods that `posefuse methods` lists.
        min_views: Points with fewer valid views are missing; by default 3, or what the method says. Lowered to the
            number of cameras, with a warning, on a smaller rig.
        min_confidence: Detections below are not used.
        confidence_exponent: Trust a detection in proportion to its confidence to twice this power; 0 trusts all alike.
        flatten_single_view: With one camera, put the keypoints in the plane z = 0; if false, z is the detector's depth.
    """

    method: str = "simple"
    min_views: int | None = None
    min_confidence: float = 0.2
    confidence_exponent: float = 0.0
    flatten_single_view: bool = True

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
class Options:
    """Everything a user can choose about a reconstruction.

    Attributes:
        people: How many there are; one subject per recording.
        pick: Which person to take where a view shows several; by default that is an error.
        skeleton: What the keypoints are, a shipped name or a TOML file; by default the one the files name or
            their number of keypoints allows.
        rate_hz: Frames per second, for files that do not say.
        third_channel: What the third number of a keypoint array is.
        length_unit: The unit of the calibration's lengths, for formats that do not say.
        up: The world's up axis, for calibrations that do not say.
        cameras: Use only these cameras, by name.
        exclude_camera: Leave these cameras out, by name.
        camera_order: Which camera each view belongs to, in the order of the views, where names do not tell.
        start_s: Leave out what comes before, in seconds.
        end_s: Leave out what comes after, in seconds.
        noise_scale_px: The standard deviation of a detection in px per axis; by default estimated from the recording.
        layer: Which layer exports and evaluation take; by default the best present.
        triangulation: How 3D points come from 2D detections.
    """

    people: People = "one"
    pick: Pick | None = None
    skeleton: str | None = None
    rate_hz: float | None = None
    third_channel: ThirdChannel | None = None
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

    def __post_init__(self) -> None:
        for name in ("rate_hz", "noise_scale_px"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise OptionsError(f"{name} must be positive, got {value}.")
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise OptionsError(f"end_s ({self.end_s}) must come after start_s ({self.start_s}).")
        both = sorted(set(self.cameras) & set(self.exclude_camera))
        if both:
            raise OptionsError(f"cameras and exclude_camera both name {choices(both)}.")
