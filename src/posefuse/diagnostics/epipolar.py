"""How well two views agree, without any point: by how far each is from the other's epipolar lines.

Distances are Sampson's (to first order symmetric in both views), in units of the noise of both, so that 1 is a
standard deviation; losses are bounded, so that a few wrong detections change little.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.points import noise_of_one, usual_noise
from posefuse.diagnostics.state import Sight, State, look_one
from posefuse.kernels.diagnostics.epipolar import sampson

_BOUND = 3.0
_FEWEST = 40


@dataclass(frozen=True, eq=False)
class Look:
    """What one view shows, ready to be compared.

    Attributes:
        at: shape (point, 2): x/z and y/z, NaN where not seen.
        sigma: shape (point,): the noise, as a length at depth 1.
        rotation: shape (point, 3, 3) or (1, 3, 3).
        translation_m: shape (point, 3) or (1, 3).
    """

    at: np.ndarray
    sigma: np.ndarray
    rotation: np.ndarray
    translation_m: np.ndarray


def looks(evidence: Evidence, state: State, sight: Sight, scale: float) -> list[Look]:
    """What each view shows, all points of all samples in one row."""
    noise = usual_noise(evidence, sight) * scale
    return [
        Look(sight.at[:, :, v].reshape(-1, 2), noise[:, :, v].ravel(), *poses(state, v, sight.at.shape[1]))
        for v in range(evidence.n_views)
    ]


def look_of(evidence: Evidence, state: State, view: int, scale: float) -> Look:
    """What one view shows."""
    sight = look_one(evidence, state, view)
    noise = scale * noise_of_one(evidence, sight, evidence.rig.cameras[state.cameras[view]])
    return Look(sight.at.reshape(-1, 2), noise.ravel(), *poses(state, view, sight.at.shape[1]))


def poses(state: State, view: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of a view for each point, or once where they stay the same."""
    rotation, translation = state.rotation[:, view], state.translation_m[:, view]
    if (rotation == rotation[0]).all() and (translation == translation[0]).all():
        return rotation[:1], translation[:1]
    return np.repeat(rotation, columns, axis=0), np.repeat(translation, columns, axis=0)


def disagreement(a: Look, b: Look) -> float:
    """The mean bounded squared distance of two views, 0 to 1; NaN where they have too little in common."""
    squared = distances2(a, b)
    squared = squared[np.isfinite(squared)]
    return float(np.minimum(squared, _BOUND**2).mean()) / _BOUND**2 if len(squared) >= _FEWEST else np.nan


def distances2(a: Look, b: Look) -> np.ndarray:
    """Shape (point,): squared Sampson distances in units of the noise, NaN where a point is not in both views."""
    turn = b.rotation @ np.swapaxes(a.rotation, -1, -2)
    shift = b.translation_m - (turn @ a.translation_m[..., None])[..., 0]
    x, y, z = np.moveaxis(shift, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=-2)
    essential = cross @ turn
    return sampson(a.at, a.sigma, b.at, b.sigma, np.ascontiguousarray(essential))


def table(looked: list[Look]) -> np.ndarray:
    """Shape (view, view): disagreement of every pair; NaN on the diagonal."""
    out = np.full((len(looked), len(looked)), np.nan)
    for a, b in combinations(range(len(looked)), 2):
        out[a, b] = out[b, a] = disagreement(looked[a], looked[b])
    return out
