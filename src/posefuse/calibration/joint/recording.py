"""Tracked keypoints in normalized image planes, interpolated in time at given clock corrections."""

from dataclasses import dataclass

import numpy as np

_FRAME_TOLERANCE = 0.02
"""Times closer to a frame than this share of the frame interval use that frame where its neighbor is missing."""
_DIGITS = 9
_MAX_GAP = 2.5


@dataclass(frozen=True, eq=False)
class JointRecording:
    """Hold the tracked keypoints of a recording, with lens and image transforms undone, and the calibrated poses.

    A column is one keypoint of one person.

    Attributes:
        names: names of the cameras.
        xy: shape (frame, view, column, 2): x/z and y/z, NaN where not detected.
        sigma: shape (frame, view, column): expected noise in that plane, up to a factor for each view.
        time_s: shape (frame, view): timestamp of each frame, NaN after the last frame of a view. Frames of the same
            index need not be simultaneous if ``common_s`` is given.
        runs: shape (frame,), int: contiguous piece of the recording that holds the frame.
        period_s: time between frames.
        rotation: shape (view, 3, 3): calibrated, camera_from_world.
        center_m: shape (view, 3): calibrated camera centers.
        common_s: shape (frame,): times at which points are estimated; None if they are the mean timestamps.
        people: shape (column,), int: person of each column, where errors of close keypoints may be similar; None if
            errors of different columns count as independent.
    """

    names: tuple[str, ...]
    xy: np.ndarray
    sigma: np.ndarray
    time_s: np.ndarray
    runs: np.ndarray
    period_s: float
    rotation: np.ndarray
    center_m: np.ndarray
    common_s: np.ndarray | None = None
    people: np.ndarray | None = None

    @property
    def moments_s(self) -> np.ndarray:
        """Return the times at which points are estimated, shape (frame,)."""
        return self.time_s.mean(axis=1) if self.common_s is None else self.common_s

    @property
    def n_views(self) -> int:
        """Return the number of views."""
        return self.xy.shape[1]

    def at(self, frames: np.ndarray, offset_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the observations of all views at the times of some frames.

        Args:
            frames: shape (sample,): indices of frames.
            offset_s: shape (sample, view): true time minus timestamp.

        Returns:
            Normalized coordinates, shape (sample, column, view, 2), and their noise, shape (sample, column, view); NaN
            where a view has no detection at that time.
        """
        middle_s, run = self.moments_s[frames], self.runs[frames]
        xy = np.empty((len(frames), self.xy.shape[2], self.n_views, 2))
        sigma = np.empty(xy.shape[:3])
        for v in range(self.n_views):
            before, after, share = self._neighbors(middle_s - offset_s[:, v], run, v)
            sigma[:, :, v] = _between(self.sigma[before, v], self.sigma[after, v], share[:, None])
            xy[:, :, v] = _between(self.xy[before, v], self.xy[after, v], share[:, None, None])
        unknown = ~(np.isfinite(sigma) & np.isfinite(xy).all(axis=-1))
        xy[unknown], sigma[unknown] = np.nan, np.nan
        return xy, sigma

    def _neighbors(self, taken_s: np.ndarray, run: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the frames before and after some times of a view's clock, and the share of the latter (or NaN)."""
        times = self.time_s[:, view]
        after = np.clip(np.searchsorted(times, taken_s), min(1, len(times) - 1), len(times) - 1)
        before = np.maximum(after - 1, 0)
        step = np.maximum(times[after] - times[before], 1e-9)
        share = (taken_s - times[before]) / step
        fits = (share > -_FRAME_TOLERANCE) & (share < 1.0 + _FRAME_TOLERANCE)
        share = np.round(np.clip(share, 0.0, 1.0), _DIGITS)
        first, last = self.runs[before] == run, self.runs[after] == run
        # Never interpolate across a gap of frames or between pieces of the recording.
        between = first & last & (step < _MAX_GAP * self.period_s)
        at_first, at_last = first & (share < _FRAME_TOLERANCE), last & (share > 1.0 - _FRAME_TOLERANCE)
        fits &= between | at_first | at_last
        share = np.where(between, share, np.where(at_first, 0.0, 1.0))
        return before, after, np.where(fits, share, np.nan)


def _between(first: np.ndarray, last: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return values interpolated between two frames.

    A frame that is missing is not used if the time is that of the other one, within the tolerance. Otherwise there is
    no tolerance: clocks are found to less than a thirtieth of a frame, and the values must not jump there.
    """
    mixed = np.where(share == 0.0, first, np.where(share == 1.0, last, (1.0 - share) * first + share * last))
    mixed = np.where((share < _FRAME_TOLERANCE) & np.isnan(last), first, mixed)
    return np.where((share > 1.0 - _FRAME_TOLERANCE) & np.isnan(first), last, mixed)
