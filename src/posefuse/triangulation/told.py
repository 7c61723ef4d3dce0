"""Points of a recording whose views check each other: what there is to be learnt about its noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation.linear import LinearPoints
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


def gather(
    rig: CameraRig,
    pieces: Sequence[Detections],
    tracks: Sequence[Tracks],
    layers: Sequence[Layer],
    noise: NoiseModel,
) -> Told:
    """Points enough, spread evenly over the pieces of a recording.

    Args:
        rig: the cameras.
        pieces: of the recording.
        tracks: whose detection is whose, in each piece.
        layers: the pieces as the method ``consensus`` triangulates them.
        noise: they were triangulated with.
    """
    most = min(max(_FREEDOM // (2 * len(rig) - 3), _FEWEST_POINTS), _MOST_POINTS)
    each = most // (2 * len(pieces)) + 1
    parts = [
        _pairs(rig, piece, people.rows(piece), layer, noise, each)
        for layer, piece, people in zip(layers, pieces, tracks, strict=True)
    ]
    return Told(
        LinearPoints.concatenate([part.points for part in parts]),
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("used", "sigma_px", "confidence")),
    )


def _pairs(
    rig: CameraRig, detections: Detections, rows: np.ndarray, layer: Layer, noise: NoiseModel, most: int
) -> Told:
    status = np.asarray(layer.view_status)
    telling = checked(status)
    later = np.zeros_like(telling)
    later[:-1] = telling[1:]
    first = np.flatnonzero(telling)
    first = first[np.unique(np.linspace(0, len(first) - 1, min(most, len(first))).astype(int))]
    chosen = np.stack([first, np.where(later.ravel()[first], first + telling[0].size, first)], axis=-1).ravel()
    status = status.reshape(-1, status.shape[-1])[chosen]
    observations = Observations.gather(rig, detections, rows.reshape(-1, rows.shape[-1]), noise, chosen)
    points = LinearPoints.at(observations, np.asarray(layer.points_m).reshape(-1, 3)[chosen])
    confidence = np.where(np.isfinite(observations.confidence), observations.confidence, 1.0)
    counts = np.isin(status, (ViewStatus.USED, ViewStatus.OUTLIER))
    with np.errstate(divide="ignore"):
        sigma = np.where(counts, noise.scale_px / confidence**noise.exponent, np.inf)
    return Told(points, status == ViewStatus.USED, sigma, confidence)


def checked(view_status: np.ndarray) -> np.ndarray:
    """Which points have views that check each other: two that are left of more were chosen because they agree.

    Args:
        view_status: shape (..., view).
    """
    n = (view_status == ViewStatus.USED).sum(axis=-1)
    return (n > 2) | ((n == 2) & ~(view_status == ViewStatus.OUTLIER).any(axis=-1))
