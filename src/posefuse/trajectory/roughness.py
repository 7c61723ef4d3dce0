"""Motion that no smooth path has: how much farther the data lie from paths than noise and prior foretell.

With the information ``I`` of a frame, its own best point lies ``3 - tr(I P)`` from a path of covariance ``P``, squared
and in units of ``I``, in the mean. What is more than that is taken for motion the path misses, the same in all
directions; one standard deviation is left off, for it may be chance.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.trajectory.observed import Observed

_COUNTS = 0.5


@dataclass(frozen=True, eq=False)
class Roughness:
    """What ranges of frames tell of it, to be added up.

    Attributes:
        excess: shape (keypoint,): squared distances beyond what is foretold, in units of the noise.
        chance: shape (keypoint,): the variance that chance gives them.
        told: shape (keypoint,): traces of the information they are measured with, 1/m^2.
    """

    excess: np.ndarray
    chance: np.ndarray
    told: np.ndarray

    def __add__(self, other: Self) -> "Roughness":
        return Roughness(self.excess + other.excess, self.chance + other.chance, self.told + other.told)

    @property
    def variance_m2(self) -> np.ndarray:
        """Shape (keypoint,): variance of what the motion is beside its path, as real bodies' is."""
        return np.maximum(self.excess - np.sqrt(self.chance), 0.0) / np.maximum(self.told, 1e-300)

    @classmethod
    def of(
        cls, observed: Observed, paths_m: np.ndarray, covariance_m2: np.ndarray, weights: np.ndarray, spread: float
    ) -> Self:
        """Of a range of frames.

        Args:
            observed: what views saw.
            paths_m: shape (keypoint, frame, 3).
            covariance_m2: shape (keypoint, frame, 3, 3), of the paths.
            weights: shape (keypoint, frame, view).
            spread: of the errors, in units of the noise.
        """
        counted = np.where(weights > _COUNTS, weights, 0.0)
        views = (counted > 0.0).sum(axis=-1)
        there = views > 1
        told = np.where(there[..., None], counted, 0.0) / np.square(spread * observed.sigma_px)
        seen, off, rest = _distances(observed, paths_m, told)
        # Noise as it is in these very frames: by what views of one frame say of each other, whatever the motion.
        noise = rest.sum() / max(float((2.0 * views - 3.0)[there].sum()), 1.0)
        foretold = np.where(there, 3.0 - np.einsum("kfij,kfji->kf", seen, covariance_m2), 0.0)
        return cls(
            (off - noise * foretold).sum(axis=1),
            noise**2 * 6.0 * there.sum(axis=1),
            np.trace(seen, axis1=-2, axis2=-1).sum(axis=1),
        )


def _distances(observed: Observed, paths_m: np.ndarray, told: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information of each frame, squared distance of its own best point from the path, and what views lie from that."""
    residuals, jacobians = (np.nan_to_num(each) for each in observed.linear(paths_m))
    seen = np.einsum("kfv,kfvai,kfvaj->kfij", told, jacobians, jacobians)
    pull = np.einsum("kfv,kfvai,kfva->kfi", told, jacobians, residuals)
    trace = np.trace(seen, axis1=-2, axis2=-1)[..., None, None]
    safe = seen + np.where(trace > 0.0, 1e-9 * trace, 1.0) * np.eye(3)
    off = (pull * np.linalg.solve(safe, pull[..., None])[..., 0]).sum(axis=-1)
    return seen, off, np.einsum("kfv,kfva,kfva->kf", told, residuals, residuals) - off
