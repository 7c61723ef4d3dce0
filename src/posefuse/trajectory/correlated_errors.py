"""Correlation of detection errors over time, estimated from residuals."""

import numpy as np
from scipy.special import gammaln, hyp2f1

from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.trajectory.observations import PersonObservations

_LAGS = (1, 2, 4, 8, 16, 32, 64)
_MAX_LAG_S, _MIN_PERSISTENT_LAG_S = 2.0, 0.6
_MAX_PERSISTENT = 0.95
_DOMINANT_PERSISTENT = 0.2
"""If persistent errors exceed this fraction, the correlation of the remaining errors cannot be estimated."""

_MAX_CORRELATION_S = 0.3
"""Errors with a longer correlation time cannot be separated from slow motion; they only make paths less certain."""

_MIN_CORRELATION, _MAX_CORRELATION = 0.1, 0.999
_FULL_CORRELATION = 0.9
"""Correlation at distance zero of fully correlated errors, reduced because their level changes."""

_CORRELATIONS = np.linspace(-1.0, 1.0, 401)


class ErrorCorrelation:
    """Correlation of errors at several distances in time, summed over ranges of frames.

    It is estimated from the angle between the residuals of a measured point, over all its views, and those of the same
    keypoint some frames later, which is independent of the level of the errors. Residuals lack the part that the point
    absorbs; if the same views observe it at about the same position, both lack the same part.
    """

    def __init__(self, views: int) -> None:
        self._cosines = np.zeros((len(_LAGS), 2 * views))
        self._counts = np.zeros((len(_LAGS), 2 * views))
        self._step_s = 1.0

    def add(self, observed: PersonObservations) -> None:
        """Add the frames of one person."""
        self._step_s = observed.step_s
        used = observed.agreed & np.isfinite(observed.sigma_px)
        residuals = observed.residuals_px(np.where(np.isfinite(observed.points_m), observed.points_m, 0.0))
        residual = np.where(used[..., None], residuals / observed.sigma_px[..., None], 0.0)
        residual = residual.reshape(*used.shape[:2], -1)
        size = np.sqrt(np.einsum("kfi,kfi->kf", residual, residual))
        freedom = np.maximum(2 * used.sum(axis=-1) - 3, 0)
        # NumPy takes long to reduce axes as short as that of the views.
        views = np.packbits(used, axis=-1)
        for n, lag in enumerate(_LAGS):
            if lag * self._step_s > _MAX_LAG_S or lag >= used.shape[1] // 2:
                break
            comparable = (views[:, lag:] == views[:, :-lag]).all(axis=-1) & (freedom[:, lag:] > 0)
            product = size[:, lag:] * size[:, :-lag]
            comparable &= product > 0.0
            own = freedom[:, lag:][comparable]
            cosine = np.einsum("kfi,kfi->kf", residual[:, lag:], residual[:, :-lag])[comparable] / product[comparable]
            self._cosines[n] += np.bincount(own, cosine, self._cosines.shape[1])
            self._counts[n] += np.bincount(own, minlength=self._counts.shape[1])

    def correlations(self) -> np.ndarray:
        """Return the correlation of errors at each distance, shape (lag,); NaN without data."""
        lag_correlations = np.zeros(len(_LAGS))
        for freedom in np.flatnonzero(self._counts.any(axis=0)):
            count = self._counts[:, freedom]
            mean = np.divide(self._cosines[:, freedom], count, out=np.zeros(len(_LAGS)), where=count > 0.0)
            lag_correlations += count * np.interp(mean, mean_cosine(_CORRELATIONS, int(freedom)), _CORRELATIONS)
        total = self._counts.sum(axis=1)
        return np.divide(lag_correlations, total, out=np.full(len(_LAGS), np.nan), where=total > 0.0)

    def estimate(self, options: TrajectoryOptions) -> tuple[float, float]:
        """Return the correlation time of errors, s, and the fraction of their variance that persists."""
        lag_correlations = self.correlations()
        distant = lag_correlations[np.array(_LAGS) * self._step_s > _MIN_PERSISTENT_LAG_S]
        distant = distant[np.isfinite(distant)]
        share = float(np.clip(distant.mean(), 0.0, _MAX_PERSISTENT)) if distant.size else 0.0
        share = share if share > _MIN_CORRELATION else 0.0
        if options.correlation_s is not None:
            return options.correlation_s, share
        if share > _DOMINANT_PERSISTENT:
            return 0.0, share
        return min(self._correlation_s((lag_correlations - share) / (1.0 - share)), _MAX_CORRELATION_S), share

    def _correlation_s(self, lag_correlations: np.ndarray) -> float:
        """Return the time in which correlations fall to 1 / e, for an equivalent first-order autoregressive process.

        A fraction of the errors with exponentially decaying correlation is fitted. The autoregressive process has the
        same power at low frequencies, which is what separates errors from motion.
        """
        information = int(np.argmin(np.append(lag_correlations > _MIN_CORRELATION, False)))
        if information == 0:
            return 0.0
        lags, logs = (
            np.array(_LAGS[:information], dtype=np.float64),
            np.log(np.minimum(lag_correlations[:information], _MAX_CORRELATION)),
        )
        slope, level = np.polyfit(lags, logs, 1) if information > 1 else (logs[0], 0.0)
        correlation, share = (
            float(np.exp(min(slope, np.log(_MAX_CORRELATION)))),
            float(min(np.exp(level) / _FULL_CORRELATION, 1.0)),
        )
        total_correlation = 1.0 + 2.0 * share * correlation / (1.0 - correlation)
        return -self._step_s / float(np.log((total_correlation - 1.0) / (total_correlation + 1.0)))


def mean_cosine(correlation: np.ndarray, freedom: int) -> np.ndarray:
    """Return the mean cosine between two normal vectors with ``freedom`` components and the given correlation."""
    half = 0.5 * freedom
    level = np.exp(2.0 * gammaln(half + 0.5) - gammaln(half) - gammaln(half + 1.0))
    return correlation * level * hyp2f1(0.5, 0.5, half + 1.0, np.square(correlation))
