"""Left and right of bodies at sampled moments: which views exchange them."""

from itertools import combinations

import numpy as np

from posefuse.calibration.people.bodies import BodySamples
from posefuse.kernels.calibration.relative_pose import (
    COLUMNS,
    RAY_A,
    RAY_B,
    STUDENT_T_DOF,
    VARIANCE_A,
    VARIANCE_B,
    VELOCITY,
    epipolar_residuals,
)

_PRIOR_COST = 1.0
_SWEEPS = 5


def _exchanged_views(samples: BodySamples, rotations: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return which views exchange left and right, shape (sample, view), bool, by the epipolar errors of all pairs.

    Only relations between views are observable, so that most views of a sample are taken as correct.

    Args:
        samples: observations.
        rotations: shape (view, 3, 3).
        centers: shape (view, 3).
    """
    n_samples, n_views = samples.observed.shape[:2]
    labels = np.zeros((n_samples, n_views), dtype=bool)
    if (samples.mirror == np.arange(len(samples.mirror))).all():
        return labels
    gain = relation_gains(samples, rotations, centers)
    for _ in range(_SWEEPS):
        before = labels.copy()
        for v in range(n_views):
            # Positive where the other label agrees better with the other views as they are labeled now.
            same = np.where(labels, -1.0, 1.0)
            labels[:, v] = (gain[:, v] * same).sum(axis=1) > _PRIOR_COST
        if (labels == before).all():
            break
    mostly = labels.sum(axis=1) > 0.5 * np.isfinite(samples.observed[..., 0]).any(axis=2).sum(axis=1)
    labels[mostly] = ~labels[mostly]
    return labels


def with_corrected_sides(
    samples: BodySamples, rotations: np.ndarray, centers: np.ndarray
) -> tuple[BodySamples, np.ndarray]:
    """Return the samples with corrected sides, and where views were exchanged, shape (sample, view), bool.

    Args:
        samples: observations.
        rotations: shape (view, 3, 3).
        centers: shape (view, 3).
    """
    exchanged = _exchanged_views(samples, rotations, centers)
    return samples.swapped(np.broadcast_to(exchanged[..., None], samples.observed.shape[:3])), exchanged


def relation_gains(
    samples: BodySamples, rotations: np.ndarray, centers: np.ndarray, reference: int | None = None
) -> np.ndarray:
    """Return by how much exchanging one of two views improves their agreement, shape (sample, view, view).

    Args:
        samples: observations.
        rotations: shape (view, 3, 3).
        centers: shape (view, 3).
        reference: only compare with this view, and return shape (sample, view).
    """
    n_samples, n_views = samples.observed.shape[:2]
    if reference is not None:
        out = np.zeros((n_samples, n_views))
        for v in range(n_views):
            if v != reference:
                out[:, v] = _gain(samples, rotations, centers, reference, v)
        return out
    out = np.zeros((n_samples, n_views, n_views))
    for a, b in combinations(range(n_views), 2):
        out[:, a, b] = out[:, b, a] = _gain(samples, rotations, centers, a, b)
    return out


def _gain(samples: BodySamples, rotations: np.ndarray, centers: np.ndarray, a: int, b: int) -> np.ndarray:
    """Return by how much exchanging the sides of one of two views improves their agreement, shape (sample,)."""
    n_samples, _, n_keypoints = samples.observed.shape[:3]
    baseline = rotations[b] @ (centers[a] - centers[b])
    length = float(np.linalg.norm(baseline))
    if not length > 0.0:
        return np.zeros(n_samples)
    costs = []
    for mirrored in (False, True):
        second = samples.observed[:, b, samples.mirror] if mirrored else samples.observed[:, b]
        table = np.zeros((n_samples, n_keypoints, COLUMNS))
        table[..., RAY_A:RAY_B], table[..., RAY_B:VELOCITY] = samples.observed[:, a, :, :3], second[..., :3]
        table[..., VARIANCE_A], table[..., VARIANCE_B] = samples.observed[:, a, :, 9] ** 2, second[..., 9] ** 2
        residuals = np.empty(n_samples * n_keypoints)
        epipolar_residuals(rotations[b] @ rotations[a].T, baseline / length, table.reshape(-1, COLUMNS), residuals)
        costs.append(np.log1p(residuals.reshape(n_samples, -1) ** 2 / STUDENT_T_DOF))
    difference = costs[0] - costs[1]
    return np.where(np.isfinite(difference), difference, 0.0).sum(axis=1)
