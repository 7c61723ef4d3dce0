"""Units of the errors of camera poses, relative to how far and how large the subject is."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.joint.equations import Rows

_ROTATION, _CENTER_SHARE = np.radians(1.0), 0.008
_USUAL_RATIO = 0.2
"""A person 5 m away: half of the keypoints lie within a circle of 1 m."""


@dataclass(frozen=True)
class PoseUnits:
    """Hold the size of a usual fault of a pose: 1 degree, and 4 cm for cameras 5 m away.

    A subject that fills a small part of the view, as through a telephoto lens, makes the same angle as harmful as a
    larger one elsewhere; the units shrink in proportion.

    Attributes:
        rotation: in rad.
        center_m: in meters.
    """

    rotation: float
    center_m: float

    @classmethod
    def of(cls, rows: Rows) -> "PoseUnits":
        """Return the units for triangulated points."""
        points = rows.points_m[np.isfinite(rows.points_m).all(axis=-1)]
        middle = np.median(points, axis=0)
        size = 2.0 * float(np.median(np.linalg.norm(points - middle, axis=1)))
        distance = float(np.median(np.linalg.norm(rows.cameras[1] - middle, axis=1)))
        share = min(1.0, size / max(distance, 1e-9) / _USUAL_RATIO)
        return cls(float(_ROTATION * share), float(_CENTER_SHARE * distance * share))
