"""What a user can choose about the world of a result; the text of each attribute is the help."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from posefuse.errors import OptionsError, suggestion
from posefuse.model.cameras import UpAxis

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
"""Which axes of the new world are up and forward."""


@dataclass(frozen=True)
class AlignOptions:
    """How the world of a result is laid; by default it is the calibration's.

    Attributes:
        floor: What the floor is: keep (the calibration's, so far as it has an up axis) or feet (the plane on which feet
            stand still).
        floor_points_m: Instead, three points on the floor, nine numbers in the calibration's world.
        origin: Where 0, 0, 0 is: keep (on the floor under the calibration's origin) or subject (on the floor where the
            subject is first seen).
        origin_m: Instead, a point, three numbers in the calibration's world; it is put on the floor.
        forward: What lies forward: keep (the calibration's first axis that is level), subject (where the subject faces
            on the whole) or walk (where the subject walks on the whole).
        forward_m: Instead, a direction, three numbers in the calibration's world.
        preset: Which axes are up and forward: none (z up, x forward), opensim (y up, x forward), blender (z up, -y
            forward) or unreal (z up, x forward; it is left-handed and in cm itself: see the result's notes).
        height_m: The height of the subject, from which the scale follows.
        length_m: The distance between two keypoints, from which the scale follows.
        length_between: The names of these two keypoints.
    """

    floor: Floor = "keep"
    floor_points_m: tuple[float, ...] = ()
    origin: Origin = "keep"
    origin_m: tuple[float, ...] = ()
    forward: Forward = "keep"
    forward_m: tuple[float, ...] = ()
    preset: Preset = "none"
    height_m: float | None = None
    length_m: float | None = None
    length_between: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, allowed in (("floor", Floor), ("origin", Origin), ("forward", Forward), ("preset", Preset)):
            value = getattr(self, name)
            if value not in get_args(allowed):
                raise OptionsError(f"align.{name}: no {value!r}. {suggestion(str(value), get_args(allowed))}")
        for name in ("floor_points_m", "origin_m", "forward_m", "length_between"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name, instead, number in (
            ("floor_points_m", "floor", 9),
            ("origin_m", "origin", 3),
            ("forward_m", "forward", 3),
        ):
            given = len(getattr(self, name))
            if given not in (0, number):
                raise OptionsError(f"align.{name} is {number} numbers, got {given}.")
            if given and getattr(self, instead) != "keep":
                raise OptionsError(f"align.{name} and align.{instead} = {getattr(self, instead)!r} say two things.")
        if len(self.length_between) != (0 if self.length_m is None else 2):
            raise OptionsError(
                "align.length_m goes with two names in align.length_between, got "
                f"{self.length_m} and {len(self.length_between)} names."
            )
        for name in ("height_m", "length_m"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise OptionsError(f"align.{name} must be positive, got {value}.")
        if self.height_m is not None and self.length_m is not None:
            raise OptionsError("align.height_m and align.length_m both give the scale. Give one of them.")
        if self.forward_m and not np.linalg.norm(self.forward_m) > 0:
            raise OptionsError("align.forward_m must have a direction, got 0, 0, 0.")

    @property
    def scales(self) -> bool:
        """Whether lengths change."""
        return self.height_m is not None or self.length_m is not None

    @property
    def turns(self) -> bool:
        """Whether the world is laid anew."""
        given = bool(self.floor_points_m or self.origin_m or self.forward_m)
        return given or (self.floor, self.origin, self.forward, self.preset) != ("keep", "keep", "keep", "none")
