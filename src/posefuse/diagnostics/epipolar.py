"""Measure how well two views agree without triangulation, by the distances to each other's epipolar lines.

Distances are Sampson distances (symmetric in both views to first order) divided by the noise of both views, so that 1
is one standard deviation. The loss is bounded, so that a few outliers change it little.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from posefuse.diagnostics.normalized_views import NormalizedViews, normalize_view
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.diagnostics.sample_points import expected_noise, expected_noise_of_view
from posefuse.kernels.diagnostics.epipolar import sampson

_BOUND = 3.0
_MIN_POINTS = 40


@dataclass(frozen=True, eq=False)
class PosedView:
    """Hold the normalized observations and the pose of one view.

    Attributes:
        xy: shape (point, 2): x/z and y/z, NaN where not observed.
        sigma: shape (point,): standard deviation of the noise in the normalized image plane.
        rotation: shape (point, 3, 3) or (1, 3, 3), camera from world.
        translation_m: shape (point, 3) or (1, 3).
    """

    xy: np.ndarray
    sigma: np.ndarray
    rotation: np.ndarray
    translation_m: np.ndarray


def posed_views(
    observations: TrackedObservations, model: RecordingModel, normalized: NormalizedViews, scale: float
) -> list[PosedView]:
    """Return every view with its pose, with the points of all samples in one axis."""
    noise = expected_noise(observations, normalized) * scale
    return [
        PosedView(
            normalized.xy[:, :, v].reshape(-1, 2), noise[:, :, v].ravel(), *_poses(model, v, normalized.xy.shape[1])
        )
        for v in range(observations.n_views)
    ]


def posed_view(observations: TrackedObservations, model: RecordingModel, view: int, scale: float) -> PosedView:
    """Return one view with its pose."""
    normalized = normalize_view(observations, model, view)
    noise = scale * expected_noise_of_view(observations, normalized, observations.rig.cameras[model.cameras[view]])
    return PosedView(normalized.xy.reshape(-1, 2), noise.ravel(), *_poses(model, view, normalized.xy.shape[1]))


def _poses(model: RecordingModel, view: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and translation of a view for each point, or once where they are constant."""
    rotation, translation = model.rotation[:, view], model.translation_m[:, view]
    if (rotation == rotation[0]).all() and (translation == translation[0]).all():
        return rotation[:1], translation[:1]
    return np.repeat(rotation, columns, axis=0), np.repeat(translation, columns, axis=0)


def disagreement(a: PosedView, b: PosedView) -> float:
    """Return the mean bounded squared distance between two views, 0 to 1; NaN if they share too few points."""
    squared = squared_distances(a, b)
    squared = squared[np.isfinite(squared)]
    return float(np.minimum(squared, _BOUND**2).mean()) / _BOUND**2 if len(squared) >= _MIN_POINTS else np.nan


def squared_distances(a: PosedView, b: PosedView) -> np.ndarray:
    """Return squared Sampson distances in units of the noise, shape (point,), NaN where a view lacks the point."""
    rotation = b.rotation @ np.swapaxes(a.rotation, -1, -2)
    translation = b.translation_m - (rotation @ a.translation_m[..., None])[..., 0]
    x, y, z = np.moveaxis(translation, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=-2)
    essential = cross @ rotation
    arrays = (np.ascontiguousarray(each) for each in (a.xy, a.sigma, b.xy, b.sigma, essential))
    return sampson(*arrays)


def disagreement_table(views: list[PosedView]) -> np.ndarray:
    """Return the disagreement of every pair of views, shape (view, view), NaN on the diagonal."""
    out = np.full((len(views), len(views)), np.nan)
    for a, b in combinations(range(len(views)), 2):
        out[a, b] = out[b, a] = disagreement(views[a], views[b])
    return out
