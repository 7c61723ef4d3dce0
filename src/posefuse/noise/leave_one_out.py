"""Points of a recording whose views check each other: what there is to be learnt about its noise."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation.linearized import LinearPoints
from posefuse.triangulation.observations import Observations

_FREEDOM = 14_000
"""So many degrees of freedom tell a scale to half a per cent."""

_FEWEST_POINTS, _MOST_POINTS = 600, 2400


@dataclass(frozen=True)
class Told:
    """Pairs of points: each followed by itself one frame later or, where that is lost, by itself at once.

    Attributes:
        points: linear where they were triangulated.
        used: shape (point, view), bool: the observations they rest on.
        sigma_px: shape (point, view): the standard deviation of each observation, as assumed; inf where none is.
        confidence: shape (point, view): of each observation, 1 where the detector gives none.
    """

    points: LinearPoints
    used: np.ndarray
    sigma_px: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True)
class Sample:
    """Frames that represent a recording.

    Attributes:
        detections: of pieces of the recording, one after the other, in memory.
        tracks: whose detection is whose, of the same frames.
        starts: the first frame of each piece, counted in the sample.
    """

    detections: Detections
    tracks: Tracks
    starts: tuple[int, ...]


def gather(rig: CameraRig, sample: Sample, layer: Layer, noise: NoiseModel) -> Told:
    """Points enough, spread evenly over the pieces of a recording.

    Args:
        rig: the cameras.
        sample: of the recording.
        layer: the sample as the method ``consensus`` triangulates it.
        noise: it was triangulated with.
    """
    most = min(max(_FREEDOM // (2 * len(rig) - 3), _FEWEST_POINTS), _MOST_POINTS)
    status = np.asarray(layer.view_status)
    chosen = telling_pairs(checked(status), sample.starts, most // (2 * len(sample.starts)) + 1)
    status = status.reshape(-1, status.shape[-1])[chosen]
    rows = sample.tracks.rows(sample.detections)
    observations = Observations.gather(rig, sample.detections, rows.reshape(-1, rows.shape[-1]), noise, chosen)
    points = LinearPoints.at(observations, np.asarray(layer.points_m).reshape(-1, 3)[chosen])
    confidence = np.where(np.isfinite(observations.confidence), observations.confidence, 1.0)
    used = status == ViewStatus.USED
    with np.errstate(divide="ignore"):
        sigma = np.where(used | (status == ViewStatus.OUTLIER), noise.scale_px / confidence**noise.exponent, np.inf)
    return Told(points, used, sigma, confidence)


def telling_pairs(telling: np.ndarray, starts: tuple[int, ...], most: int) -> np.ndarray:
    """Pairs of points that tell, at most so many from each piece, as one row of places.

    Args:
        telling: shape (frame, person, keypoint), bool.
        starts: the first frame of each piece.
        most: pairs of a piece.
    """
    later = np.zeros_like(telling)
    later[:-1] = telling[1:]
    # What follows the last frame of a piece is not the next frame.
    later[np.array(starts[1:], dtype=int) - 1] = False
    found = np.flatnonzero(telling)
    bounds = np.searchsorted(found, [*(start * telling[0].size for start in starts), telling.size])
    first = np.concatenate([found[_evenly(begin, end, most)] for begin, end in pairwise(bounds)])
    return np.stack([first, np.where(later.ravel()[first], first + telling[0].size, first)], axis=-1).ravel()


def _evenly(begin: int, end: int, most: int) -> np.ndarray:
    """At most so many numbers from ``begin`` to before ``end``, evenly spread."""
    return begin + np.unique(np.linspace(0, end - begin - 1, min(most, end - begin)).astype(int))


def checked(view_status: np.ndarray) -> np.ndarray:
    """Which points have views that check each other: two that are left of more were chosen because they agree.

    Args:
        view_status: shape (..., view).
    """
    n = (view_status == ViewStatus.USED).sum(axis=-1)
    return (n > 2) | ((n == 2) & ~(view_status == ViewStatus.OUTLIER).any(axis=-1))
