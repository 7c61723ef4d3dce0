"""Points that several cameras saw, as a table of observations."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np


@dataclass(frozen=True, eq=False)
class Sightings:
    """Points and what the views saw of them; a row of the first arrays is one view's observation of one point.

    Attributes:
        view: shape (observation,), int64.
        point: shape (observation,), int64, ascending: a row of the arrays of points.
        pixels: shape (observation, 2).
        sigma_px: shape (observation,): the noise of each observation, per axis, up to a factor of each view.
        points_m: shape (point, 3): where the points seem to be, in the world.
        frame: shape (point,), int64: place of the point's frame in the recording.
        keypoint: shape (point,), int64: which keypoint of whom; errors of one keypoint may last.
    """

    view: np.ndarray
    point: np.ndarray
    pixels: np.ndarray
    sigma_px: np.ndarray
    points_m: np.ndarray
    frame: np.ndarray
    keypoint: np.ndarray

    @property
    def n_points(self) -> int:
        """How many points there are."""
        return len(self.points_m)

    def counts(self, n_views: int) -> np.ndarray:
        """Shape (view,), int64: observations of each view."""
        return np.bincount(self.view, minlength=n_views)

    def keep(self, kept: np.ndarray) -> Self:
        """The observations that are kept, of the points that two views or more still see.

        Args:
            kept: shape (observation,), bool.
        """
        views = np.bincount(self.point[kept], minlength=self.n_points)
        kept = kept & (views[self.point] >= 2)
        return self._with(kept, views >= 2)

    def of_points(self, chosen: np.ndarray) -> Self:
        """Some of the points; ``chosen`` has shape (point,), bool."""
        return self._with(chosen[self.point], chosen)

    def _with(self, kept: np.ndarray, chosen: np.ndarray) -> Self:
        renumbered = np.cumsum(chosen) - 1
        return replace(
            self,
            view=self.view[kept],
            point=renumbered[self.point[kept]],
            pixels=self.pixels[kept],
            sigma_px=self.sigma_px[kept],
            points_m=self.points_m[chosen],
            frame=self.frame[chosen],
            keypoint=self.keypoint[chosen],
        )
