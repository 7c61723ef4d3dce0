"""Error levels of views: how the size of detection errors varies over time, from the innovations of errors."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d

from posefuse.kernels.trajectory.observation_terms import scale_residuals, whiten_errors
from posefuse.trajectory.observations import PersonObservations
from posefuse.trajectory.paths import CONSTANT_LEVEL_STRENGTH, PersonPriors

_ERROR_LEVEL_S = 0.3
"""Time scale on which the error level of a view changes, in seconds."""

_PERSISTENT_S = 1.2
"""Averaging time that separates persistent errors from others, in seconds."""

_MIN_SCALE, _MAX_SCALE = 0.5, 4.0


def error_correlation(time_s: np.ndarray, correlation_s: float) -> np.ndarray:
    """Return the correlation of an error with that of the previous frame, shape (frame,)."""
    correlation = np.zeros(len(time_s))
    if correlation_s > 0.0:
        correlation[1:] = np.exp(-np.diff(time_s) / correlation_s)
    return correlation


@dataclass(frozen=True, eq=False)
class ErrorLevel:
    """Estimator of the error level of each view.

    Attributes:
        observed: observations of the views.
    """

    observed: PersonObservations

    @cached_property
    def view_residuals(self) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of the views at the measured points, and the fraction of the variance they retain.

        The residuals (keypoint, frame, view, 2), in sigmas, are scaled up for the part that the point absorbs. The
        retained fraction, (keypoint, frame, view), is 0 where the point does not use a view. Both are independent of
        time, so fast motion that a path smooths away does not appear as an error of a view.
        """
        observed = self.observed
        there = np.asarray(np.isfinite(observed.points_m).all(axis=-1))
        scaled = observed.residuals_px(np.where(there[..., None], observed.points_m, 0.0))
        left = np.empty(observed.sigma_px.shape)
        scale_residuals(observed.sigma_px, observed.agreed & there[..., None], scaled, left)
        return scaled, left

    @cached_property
    def unit_scale(self) -> np.ndarray:
        """An array of ones, shape (keypoint, frame, view)."""
        return np.ones(self.observed.sigma_px.shape)

    def scale(self, person_priors: PersonPriors) -> np.ndarray:
        """Return the relative error level of each view around each frame, shape (keypoint, frame, view).

        It is estimated from the innovations of errors, because a correlated part may also belong to the point.
        """
        if person_priors.scale_strength >= CONSTANT_LEVEL_STRENGTH:
            return self.unit_scale
        total, count = self._new_errors(person_priors)
        scale = np.sqrt(
            (person_priors.scale_strength + total / min(person_priors.innovation_scale, 1.0))
            / (person_priors.scale_strength + count)
        )
        # About a third of the variance of the error level, 2 / scale_strength, changes too fast to be tracked.
        return np.clip(scale, _MIN_SCALE, _MAX_SCALE) * np.sqrt(1.0 + 0.7 / person_priors.scale_strength)

    def _new_errors(self, person_priors: PersonPriors) -> tuple[np.ndarray, np.ndarray]:
        """Return the sums of squared innovations around each frame, and the numbers of values in them."""
        key = person_priors.correlation_s, person_priors.spread, person_priors.persistent_ratio > 0.0
        if key not in self._sums:
            self._sums.clear()
            self._sums[key] = self._sum_innovations(person_priors)
        return self._sums[key]

    @cached_property
    def _sums(self) -> dict[tuple[float, float, bool], tuple[np.ndarray, np.ndarray]]:
        """The last sums of :meth:`_new_errors`, by what they depend on: every stage of a solve needs them."""
        return {}

    def _sum_innovations(self, person_priors: PersonPriors) -> tuple[np.ndarray, np.ndarray]:
        """Return what :meth:`_new_errors` does, from the residuals."""
        residuals, left = self.view_residuals
        if person_priors.persistent_ratio > 0.0:
            residuals = self._subtract_local_mean(residuals, left > 0.0)
        correlations = np.append(error_correlation(self.observed.time_s, person_priors.correlation_s), 0.0)
        squares = np.empty(left.shape)
        whiten_errors(residuals, left, correlations, person_priors.spread**2, squares)
        window = 2 * round(0.5 * _ERROR_LEVEL_S / self.observed.step_s) + 1
        # Each error has two coordinates.
        total = uniform_filter1d(squares, window, axis=1, mode="nearest") * window
        return total, uniform_filter1d(2.0 * left, window, axis=1, mode="nearest") * window

    def _subtract_local_mean(self, residuals: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Return residuals minus their local mean, which is a persistent error and not an innovation."""
        window = 2 * round(0.5 * _PERSISTENT_S / self.observed.step_s) + 1
        total = uniform_filter1d(residuals, window, axis=1, mode="constant")
        share = uniform_filter1d(used.astype(np.float64), window, axis=1, mode="constant")
        mean = total / np.maximum(share, 0.5 / window)[..., None]
        return np.where(used[..., None], residuals - mean, 0.0)

    def estimate(self, person_priors: PersonPriors) -> tuple[float, float]:
        """Return ``innovation_scale`` and ``scale_strength`` from the variation of the error level beyond chance."""
        total, count = self._new_errors(person_priors)
        observed_enough = count > 0.5
        if not observed_enough.any():
            return 1.0, CONSTANT_LEVEL_STRENGTH
        # Cap extreme levels: a period with a wrong limb would otherwise make all frames uncertain.
        count = count[observed_enough]
        size = np.minimum(total[observed_enough] / count, _MAX_SCALE**2)
        innovation_scale = float((count * size).sum() / count.sum())
        varies = float((count * np.square(size / innovation_scale - 1.0)).sum() / count.sum())
        chance = 2.0 * len(count) / float(count.sum())
        return innovation_scale, min(2.0 / max(varies - chance, 2.0 / CONSTANT_LEVEL_STRENGTH), CONSTANT_LEVEL_STRENGTH)

    def squares(self, weights: np.ndarray, person_priors: PersonPriors) -> tuple[float, float]:
        """Return the sum of squared errors in units of their variance, and the number of independent values in it.

        Args:
            weights: shape (keypoint, frame, view): of the observations that a path uses.
            person_priors: of the person.
        """
        residuals, left = self.view_residuals
        # Scaled residuals have the variance of the errors; weighted by what they retain, their number is 2 views - 3.
        used = left * weights / np.square(person_priors.spread * self.scale(person_priors))
        total = float((used * np.square(residuals).sum(axis=-1)).sum())
        return total / (1.0 + person_priors.persistent_ratio), 2.0 * float((left * weights).sum())
