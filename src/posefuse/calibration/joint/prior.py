"""Normal prior of the changes of poses, clocks and lenses."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Prior:
    """Hold a normal prior of the changes from the calibration.

    Equations that take correlated errors for independent ones overstate the observations. The prior then has to count
    as many times more; otherwise, it has no effect on directions that the observations hardly determine.

    Attributes:
        precision: shape (parameter, parameter): inverse of the covariance of the changes of all views.
        mean: shape (parameter,).
        weight: shape (parameter,): number of times that the prior counts in the equations.
    """

    precision: np.ndarray
    mean: np.ndarray
    weight: np.ndarray

    @classmethod
    def of_sds(cls, sd: np.ndarray) -> "Prior":
        """Return the prior of independent changes with standard deviations ``sd``, shape (view, parameter)."""
        return cls(np.diag(sd.ravel() ** -2.0), np.zeros(sd.size), np.ones(sd.size))

    def weighted(self, weight: np.ndarray) -> "Prior":
        """Return the prior with another weight, shape (parameter,)."""
        return replace(self, weight=weight)

    def coupled(self, at: np.ndarray, covariance: np.ndarray, mean: np.ndarray) -> "Prior":
        """Return the prior with another covariance and mean of the parameters with the indices ``at``."""
        precision, means = self.precision.copy(), self.mean.copy()
        precision[np.ix_(at, at)], means[at] = np.linalg.inv(covariance), mean
        return replace(self, precision=precision, mean=means)

    def part(self, kept: np.ndarray) -> "Prior":
        """Return the prior of the parameters with the indices ``kept``, which are independent of the others."""
        return Prior(self.precision[np.ix_(kept, kept)], self.mean[kept], self.weight[kept])

    def pull(self, change: np.ndarray) -> np.ndarray:
        """Return the slope of the prior's cost, shape (parameter,), at a change of the same shape."""
        return self.curvature @ (change - self.mean)

    @property
    def curvature(self) -> np.ndarray:
        """Return the second derivative of the prior's cost, shape (parameter, parameter)."""
        root = np.sqrt(self.weight)
        return root[:, None] * self.precision * root

    @property
    def spread(self) -> np.ndarray:
        """Return what the prior adds to the covariance of the score, shape (parameter, parameter)."""
        return self.weight[:, None] * self.precision * self.weight
