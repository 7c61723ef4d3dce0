"""Points of known position in a scene, and where cameras show them."""

from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import PickledByFields, frozen
from posefuse.errors import CalibrationError, choices
from posefuse.model.up_axis import UP_AXES, UpAxis


@checked
@dataclass(frozen=True, eq=False)
class ScenePoints(PickledByFields):
    """Points whose positions in the world were measured, and their places in the images of the cameras.

    Attributes:
        points_m: shape (point, 3), in the world.
        pixels: for each camera, shape (point, 2), NaN for points that it does not show.
        up_axis: up axis of the world, or None if it is unknown.

    Raises:
        CalibrationError: if the shapes do not agree, or values are not finite.
    """

    points_m: np.ndarray
    pixels: dict[str, np.ndarray]
    up_axis: UpAxis | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_m", frozen(self.points_m))
        object.__setattr__(self, "pixels", {name: frozen(places) for name, places in self.pixels.items()})
        if self.points_m.ndim != 2 or self.points_m.shape[1] != 3 or not np.isfinite(self.points_m).all():
            raise CalibrationError(
                f"Scene points need three finite coordinates each, in meters, got shape {self.points_m.shape}."
            )
        if not self.pixels:
            raise CalibrationError("The scene points have no places in the images of any camera.")
        for name, places in self.pixels.items():
            if places.shape != (len(self.points_m), 2):
                raise CalibrationError(
                    f"Camera {name!r} has {len(places)} places of scene points in its image; expected "
                    f"{len(self.points_m)}, one per point, empty for a point that it does not show."
                )
        if self.up_axis is not None and self.up_axis not in UP_AXES:
            raise CalibrationError(f"up {self.up_axis!r} is not an axis. Choose one of: {choices(UP_AXES)}.")
