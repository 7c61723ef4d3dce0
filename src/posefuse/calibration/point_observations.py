"""Points observed by several cameras, as a table of observations."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np


@dataclass(frozen=True, eq=False)
class PointObservations:
    """Hold points and their observations; a row of the first arrays is one view's observation of one point.

    Attributes:
        view: shape (observation,), int64.
        point: shape (observation,), int64, ascending: index into the arrays of points.
        pixels: shape (observation, 2).
        sigma_px: shape (observation,): standard deviation per axis, up to a factor for each view.
        points_m: shape (point, 3): initial points in the world.
        frame: shape (point,), int64: index of the point's frame in the recording.
        keypoint: shape (point,), int64: index of the keypoint and person; errors of one keypoint may be correlated.
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
        """Return the number of points."""
        return len(self.points_m)

    def counts(self, n_views: int) -> np.ndarray:
        """Return the number of observations of each view, shape (view,), int64."""
        return np.bincount(self.view, minlength=n_views)

    def select(self, used: np.ndarray) -> Self:
        """Return some of the observations, of points that at least two views still observe.

        Args:
            used: shape (observation,), bool.
        """
        views = np.bincount(self.point[used], minlength=self.n_points)
        used = used & (views[self.point] >= 2)
        return self._subset(used, views >= 2)

    def select_points(self, chosen: np.ndarray) -> Self:
        """Return some of the points; ``chosen`` has shape (point,), bool."""
        return self._subset(chosen[self.point], chosen)

    def _subset(self, used: np.ndarray, chosen: np.ndarray) -> Self:
        renumbered = np.cumsum(chosen) - 1
        return replace(
            self,
            view=self.view[used],
            point=renumbered[self.point[used]],
            pixels=self.pixels[used],
            sigma_px=self.sigma_px[used],
            points_m=self.points_m[chosen],
            frame=self.frame[chosen],
            keypoint=self.keypoint[chosen],
        )
