"""Corners of a board as observations of a bundle adjustment."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from posefuse.model.board import Board
from posefuse.model.detections import Detections

MIN_CORNERS = 6
"""Least number of corners of one view that determine a pose well enough to be used."""


@dataclass(frozen=True, eq=False)
class CornerObservations:
    """Hold corners of a board; a row of the first arrays is one corner in one view. Rows are ordered by pose and view.

    Attributes:
        view: shape (observation,), int64.
        point: shape (observation,), int64, ascending: index of the pose of the board.
        corner: shape (observation,), int64: index of the corner on the board.
        pixels: shape (observation, 2).
        frame: shape (pose,), int64: index of the frame of each pose.
        time_s: shape (pose,): time of the pose.
        delay_s: shape (observation,): time of the view's image minus that of the pose, before time offsets.
    """

    view: np.ndarray
    point: np.ndarray
    corner: np.ndarray
    pixels: np.ndarray
    frame: np.ndarray
    time_s: np.ndarray
    delay_s: np.ndarray

    @property
    def n_points(self) -> int:
        """Return the number of poses."""
        return len(self.frame)

    def select_poses(self, chosen: np.ndarray) -> Self:
        """Return some of the poses; ``chosen`` has shape (pose,), bool."""
        used = chosen[self.point]
        renumbered = np.cumsum(chosen) - 1
        return replace(
            self._rows(used),
            point=renumbered[self.point[used]],
            frame=self.frame[chosen],
            time_s=self.time_s[chosen],
        )

    def of_view(self, view: int) -> Self:
        """Return the corners of one view as those of a single camera, without poses that it does not see."""
        rows = self.view == view
        seen = np.zeros(self.n_points, dtype=bool)
        seen[self.point[rows]] = True
        own = self._rows(rows)
        return replace(own, view=np.zeros(len(own.view), dtype=np.int64)).select_poses(seen)

    def closest(self, offset_s: np.ndarray) -> tuple[Self, np.ndarray]:
        """Assign the corners to the poses closest in time to their images.

        The time of a pose is then the mean of those of its images; poses without images are left out.

        Args:
            offset_s: shape (view,): time offsets of the views.

        Returns:
            The corners, and which poses have images, shape (pose,), bool.
        """
        image_s = self.time_s[self.point] + self.delay_s
        point = self.point
        if np.all(np.diff(self.time_s) > 0.0):
            middle = 0.5 * (self.time_s[1:] + self.time_s[:-1])
            point = np.searchsorted(middle, image_s + offset_s[self.view])
        count = np.bincount(point, minlength=self.n_points)
        used = count > 0
        mean_s = np.bincount(point, image_s + offset_s[self.view], self.n_points) / np.maximum(count, 1)
        own = replace(self, point=point, time_s=mean_s, delay_s=image_s - mean_s[point])
        return own._rows(np.lexsort((self.view, point))).select_poses(used), used

    def _rows(self, used: np.ndarray) -> Self:
        """Return some of the corners."""
        return replace(
            self,
            view=self.view[used],
            point=self.point[used],
            corner=self.corner[used],
            pixels=self.pixels[used],
            delay_s=self.delay_s[used],
        )


def corner_observations(detections: Detections, board: Board) -> CornerObservations:
    """Return the corners of a recording, without views of a frame that show too few of them.

    Args:
        detections: the corners as keypoints of one subject; those of one frame belong together.
        board: the board.
    """
    pixels = detections.dense()[0]
    found = np.isfinite(pixels).all(axis=-1)
    found &= (found.sum(axis=2) >= min(MIN_CORNERS, len(board.points_m)))[:, :, None]
    frame, view, corner = np.nonzero(found)
    frames, point = np.unique(frame, return_inverse=True)
    times = times_s(detections)
    with np.errstate(invalid="ignore"):
        seen = found.any(axis=2)
        total = np.where(seen, np.nan_to_num(times), 0.0).sum(axis=1)
    pose_time = total[frames] / np.maximum(seen.sum(axis=1)[frames], 1)
    return CornerObservations(
        view, point, corner, pixels[frame, view, corner], frames, pose_time, times[frame, view] - pose_time[point]
    )


def times_s(detections: Detections) -> np.ndarray:
    """Return the times of all frames and views, shape (frame, view), from the frame rate where files give none."""
    times = np.asarray(detections.time_s)
    if np.isfinite(times).any():
        return times
    rate_hz = detections.rate_hz or 1.0
    return np.repeat((detections.frame_numbers / rate_hz)[:, None], len(detections.view_names), axis=1)
