"""Points of a recording with redundant views, from which its noise is estimated by leaving views out."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.noise.samples import Sample
from posefuse.triangulation.linearized import LinearPoints
from posefuse.triangulation.observations import Observations

_DEGREES_OF_FREEDOM = 14_000
"""About 14,000 degrees of freedom determine a scale to half a percent."""

_MIN_POINTS, _MAX_POINTS = 600, 2400


@dataclass(frozen=True)
class LeaveOneOutPoints:
    """Pairs of a point and the same point one frame later, or the point itself where the later one is missing.

    Attributes:
        points: observations, linearized at the triangulated points.
        used: shape (point, view), bool: observations that determine the points.
        sigma_px: shape (point, view): assumed standard deviation of each observation; inf where there is none.
        confidence: shape (point, view): confidence of each observation, 1 where the detector gives none.
        frame: shape (point,): index of each point's frame in the sample.
        column: shape (point,): index of each point among the keypoints of all people.
    """

    points: LinearPoints
    used: np.ndarray
    sigma_px: np.ndarray
    confidence: np.ndarray
    frame: np.ndarray
    column: np.ndarray

    def take(self, most: int) -> Self:
        """Return at most this many of the points: of any keypoints and frames, the same ones whatever else is there."""
        columns = int(self.column.max(initial=0)) + 1
        order = np.random.default_rng(0).permutation((int(self.frame.max(initial=0)) + 1) * columns)
        rows = np.sort(np.argsort(order[self.frame * columns + self.column], kind="stable")[:most])
        points = LinearPoints(self.points.residuals_px[rows], self.points.jacobians[rows])
        fields = (self.used, self.sigma_px, self.confidence, self.frame, self.column)
        return type(self)(points, *(field[rows] for field in fields))


def has_redundant_views(view_status: np.ndarray) -> np.ndarray:
    """Return which points have views that check each other.

    Two views that remain after others were rejected do not count: they were selected because they agree.

    Args:
        view_status: shape (..., view).
    """
    n = (view_status == ViewStatus.USED).sum(axis=-1)
    return (n > 2) | ((n == 2) & ~(view_status == ViewStatus.OUTLIER).any(axis=-1))


def has_three_views(view_status: np.ndarray) -> np.ndarray:
    """Return which points have coordinates and detections in three views, whether accepted or rejected.

    Args:
        view_status: shape (..., view).
    """
    used, rejected = view_status == ViewStatus.USED, view_status == ViewStatus.OUTLIER
    return used.any(axis=-1) & ((used | rejected).sum(axis=-1) > 2)


def leave_one_out_points(
    rig: CameraRig,
    sample: Sample,
    layer: Layer,
    noise: NoiseModel,
    choose: Callable[[np.ndarray], np.ndarray] = has_redundant_views,
) -> LeaveOneOutPoints:
    """Return enough points, evenly spread over the pieces of a sample.

    Args:
        rig: calibrated cameras.
        sample: sample of the recording.
        layer: the sample as the method ``consensus`` triangulates it.
        noise: the noise it was triangulated with.
        choose: returns which points may be chosen, from the statuses of their views.
    """
    most = min(max(_DEGREES_OF_FREEDOM // (2 * len(rig) - 3), _MIN_POINTS), _MAX_POINTS)
    status = np.asarray(layer.view_status)
    chosen = choose_pairs(choose(status), sample.starts, most // (2 * len(sample.starts)) + 1)
    frame, column = np.divmod(chosen, status[0, ..., 0].size)
    status = status.reshape(-1, status.shape[-1])[chosen]
    rows = sample.tracks.rows(sample.detections)
    observations = Observations.gather(rig, sample.detections, rows.reshape(-1, rows.shape[-1]), noise, chosen)
    points = LinearPoints.at(observations, np.asarray(layer.points_m).reshape(-1, 3)[chosen])
    confidence = np.where(np.isfinite(observations.confidence), observations.confidence, 1.0)
    used = status == ViewStatus.USED
    with np.errstate(divide="ignore"):
        sigma = np.where(used | (status == ViewStatus.OUTLIER), noise.scale_px / confidence**noise.exponent, np.inf)
    return LeaveOneOutPoints(points, used, sigma, confidence, frame, column)


def choose_pairs(redundant: np.ndarray, starts: tuple[int, ...], most: int) -> np.ndarray:
    """Choose pairs of points, a point and the same point one frame later, evenly spread over each piece.

    Args:
        redundant: shape (frame, person, keypoint), bool: points with redundant views.
        starts: first frame of each piece.
        most: maximum number of pairs per piece.

    Returns:
        Shape (2 * pair,): flat indices of the points, one pair after the other.
    """
    later = np.zeros_like(redundant)
    later[:-1] = redundant[1:]
    # The frame after the last one of a piece belongs to another piece.
    later[np.array(starts[1:], dtype=int) - 1] = False
    found = np.flatnonzero(redundant)
    bounds = np.searchsorted(found, [*(start * redundant[0].size for start in starts), redundant.size])
    first = np.concatenate([found[_evenly(begin, end, most)] for begin, end in pairwise(bounds)])
    return np.stack([first, np.where(later.ravel()[first], first + redundant[0].size, first)], axis=-1).ravel()


def _evenly(begin: int, end: int, most: int) -> np.ndarray:
    """Return at most ``most`` different integers from ``begin`` to ``end - 1``, evenly spread."""
    return begin + np.linspace(0, end - begin - 1, min(most, end - begin)).astype(int)
