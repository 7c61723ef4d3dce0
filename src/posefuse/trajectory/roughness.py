"""Roughness: motion that no smooth path contains, estimated from deviations beyond noise and prior.

With the information ``I`` of a frame, its own best point deviates from a path of covariance ``P`` by ``3 - tr(I P)`` on
average, squared and in units of ``I``. A larger deviation is attributed to motion around the path, isotropically. One
standard deviation of chance is subtracted.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.trajectory.blocks import empty_blocks, from_blocks, matrices_from_blocks
from posefuse.kernels.trajectory.observation_terms import PathSystem, ViewTerms, add_views
from posefuse.trajectory.observations import PersonObservations

_MIN_USED_WEIGHT = 0.5


@dataclass(frozen=True, eq=False)
class Roughness:
    """Roughness statistics of ranges of frames, which can be added.

    Attributes:
        excess: shape (keypoint,): squared deviations beyond the expected ones, in units of the noise.
        chance: shape (keypoint,): variance of these deviations that is expected by chance.
        information: shape (keypoint,): sum of the traces of the information of the frames, 1/m^2.
    """

    excess: np.ndarray
    chance: np.ndarray
    information: np.ndarray

    def __add__(self, other: Self) -> "Roughness":
        """Return the statistics of both ranges."""
        return Roughness(self.excess + other.excess, self.chance + other.chance, self.information + other.information)

    @property
    def variance_m2(self) -> np.ndarray:
        """Variance of the motion around its path, shape (keypoint,), m^2."""
        return np.maximum(self.excess - np.sqrt(self.chance), 0.0) / np.maximum(self.information, 1e-300)

    @classmethod
    def of(
        cls,
        observed: PersonObservations,
        paths_m: np.ndarray,
        covariance_m2: np.ndarray,
        weights: np.ndarray,
        spread: float,
    ) -> Self:
        """Return the statistics of a range of frames.

        Args:
            observed: observations of the views.
            paths_m: shape (keypoint, frame, 3).
            covariance_m2: shape (keypoint, frame, 3, 3), of the paths.
            weights: shape (keypoint, frame, view).
            spread: factor of the errors relative to the noise model.
        """
        used_weights = np.where(weights > _MIN_USED_WEIGHT, weights, 0.0)
        views = (used_weights > 0.0).sum(axis=-1)
        valid = views > 1
        frame_information, deviation, remaining = _distances(
            observed, paths_m, np.where(valid[..., None], used_weights, 0.0), spread
        )
        # Noise level of these frames, from the agreement of views within each frame, independent of the motion.
        noise = remaining.sum() / max(float((2.0 * views - 3.0)[valid].sum()), 1.0)
        expected = np.where(valid, 3.0 - np.einsum("kfij,kfji->kf", frame_information, covariance_m2), 0.0)
        return cls(
            (deviation - noise * expected).sum(axis=1),
            noise**2 * 6.0 * valid.sum(axis=1),
            np.trace(frame_information, axis1=-2, axis2=-1).sum(axis=1),
        )


def _distances(
    observed: PersonObservations, paths_m: np.ndarray, weights: np.ndarray, spread: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frame information, squared deviation of each frame's own point from the path, and remaining residuals."""
    keypoints, frames, _ = paths_m.shape
    linear = observed.linear_blocks(paths_m)
    system = PathSystem(*(empty_blocks(keypoints, frames, rows) for rows in (6, 0, 3, 6)))
    level = np.full(keypoints, spread)
    views = ViewTerms(linear, observed.sigma_px, np.ones(weights.shape), level, weights)
    add_views(views, system, np.empty((keypoints, frames), dtype=np.bool_))
    factor = views.weights / np.square(spread * observed.sigma_px)
    squares = np.zeros((keypoints, frames))
    for view in range(factor.shape[-1]):
        residuals = np.nan_to_num(from_blocks(linear[:, :, view, : 2 * BLOCK], frames))
        squares += factor[..., view] * (np.square(residuals[..., 0]) + np.square(residuals[..., 1]))
    frame_information = matrices_from_blocks(system.information, frames)
    gradient = from_blocks(system.rhs, frames)
    trace = np.trace(frame_information, axis1=-2, axis2=-1)[..., None, None]
    safe = frame_information + np.where(trace > 0.0, 1e-9 * trace, 1.0) * np.eye(3)
    deviation = (gradient * np.linalg.solve(safe, gradient[..., None])[..., 0]).sum(axis=-1)
    return frame_information, deviation, squares - deviation
