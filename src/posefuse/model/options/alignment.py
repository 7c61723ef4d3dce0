"""Options of the coordinate system in which a result is given."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from posefuse.errors import OptionsError
from posefuse.model.cameras import UpAxis
from posefuse.model.options.bounds import check_fields, option

Floor = Literal["keep", "feet"]
Origin = Literal["keep", "subject"]
Forward = Literal["keep", "subject", "walk"]
Preset = Literal["none", "opensim", "blender", "unreal"]

PRESETS: dict[Preset, tuple[UpAxis, UpAxis]] = {
    "none": ("z", "x"),
    "opensim": ("y", "x"),
    "blender": ("z", "-y"),
    "unreal": ("z", "x"),
}
"""Up axis and forward axis of each preset."""


@dataclass(frozen=True)
class AlignOptions:
    """Coordinate system and scale of a result; the defaults keep those of the calibration.

    Attributes:
        floor: Floor: keep or feet. "keep" uses the calibration's up axis, "feet" fits the plane on which
            feet rest.
        floor_points_m: Three points on the floor in calibration coordinates, nine numbers, instead of align.floor.
        origin: Position of the origin: "keep" projects the calibration's origin onto the floor, "subject" uses the
            subject's first position on the floor.
        origin_m: Origin in calibration coordinates, projected onto the floor, instead of align.origin.
        forward: Forward direction: "keep" uses the calibration's first horizontal axis, "subject" the mean facing
            direction of the subject, "walk" the mean walking direction.
        forward_m: Forward direction in calibration coordinates, three numbers, instead of align.forward.
        preset: Axes of the result: none, opensim, blender or unreal. "none" and "unreal" are z up and x forward,
            "opensim" is y up and x forward, "blender" is z up and -y forward; Unreal Engine itself is left-handed, in
            centimeters.
        height_m: Standing height of the subject, for the scale.
        length_m: Known distance between two keypoints, from which the scale is computed.
        length_between: Names of the two keypoints whose distance is align.length_m.
    """

    floor: Floor = option("keep", common=True)
    floor_points_m: tuple[float, ...] = option(
        (), lengths=(0, 9), example="[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]"
    )
    origin: Origin = "keep"
    origin_m: tuple[float, ...] = option((), lengths=(0, 3), example="[0.0, 0.0, 0.0]")
    forward: Forward = "keep"
    forward_m: tuple[float, ...] = option((), lengths=(0, 3), example="[1.0, 0.0, 0.0]")
    preset: Preset = option("none", common=True)
    height_m: float | None = option(None, above=0.0, at_most=100.0, example="1.78", common=True)
    length_m: float | None = option(None, above=0.0, at_most=1e5, example="0.43")
    length_between: tuple[str, ...] = option((), lengths=(0, 2), example='["left_knee", "left_ankle"]')

    def __post_init__(self) -> None:
        check_fields(self, "align")
        for name, alternative in (("floor_points_m", "floor"), ("origin_m", "origin"), ("forward_m", "forward")):
            if getattr(self, name) and getattr(self, alternative) != "keep":
                value = getattr(self, alternative)
                raise OptionsError(f"align.{name} and align.{alternative} = {value!r} exclude each other. Set one.")
        if len(self.length_between) != (0 if self.length_m is None else 2):
            raise OptionsError(
                "align.length_m needs two keypoint names in align.length_between, got "
                f"{self.length_m} and {len(self.length_between)} names."
            )
        if self.height_m is not None and self.length_m is not None:
            raise OptionsError("align.height_m and align.length_m both define the scale. Set one of them.")
        if self.forward_m and not np.linalg.norm(self.forward_m) > 0:
            raise OptionsError("align.forward_m must be a nonzero vector, got 0, 0, 0.")

    @property
    def scales(self) -> bool:
        """Whether the options change lengths."""
        return self.height_m is not None or self.length_m is not None

    @property
    def turns(self) -> bool:
        """Whether the options change the origin or the axes."""
        explicit = bool(self.floor_points_m or self.origin_m or self.forward_m)
        return explicit or (self.floor, self.origin, self.forward, self.preset) != ("keep", "keep", "keep", "none")
