"""Power of detection errors by frequency: how it weights the views, and what it adds to the covariance of a path.

A path follows motion up to a cutoff frequency and averages errors above it. Errors with the correlation time ``tau``
have more power below than white errors of the same variance, and less above ``1 / tau``. Views are weighted as if their
errors were white with the power at the cutoff, where motion and errors compete; whitening the errors of each view
instead would take every change of their size for information. The covariance of the estimate is then that of the
actual errors, the sandwich ``A^-1 B A^-1`` (P. J. Huber, "The behavior of maximum likelihood estimates under
nonstandard conditions", 1967), computed by frequency for a path with constant parameters.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from posefuse.kernels.trajectory.path_steps import limited_factors

_FREQUENCIES = 1500
_LOG_GAINS = np.linspace(-60.0, 25.0, 341)
"""Logarithms of the density of a path in units of the variance of a frame and the time between frames."""

_UNEVEN_MOTION = 4.0
"""Power of the motion that paths with correlated errors lose, relative to the white noise of the prior. Such paths have
cutoffs of 1 to 2 Hz, where motion is far from white. Real and simulated people, mice and flies have ratios of 2 to 6.
"""


@dataclass(frozen=True)
class ErrorSpectrum:
    """Spectrum of the errors of a first-order autoregressive process, relative to white errors of equal variance.

    Attributes:
        correlation_s: correlation time of the errors; 0 if they are white.
        step_s: time between frames.
        order: order of the derivative of the path that is white noise.
        level: variance of the errors relative to the assumed one.
    """

    correlation_s: float
    step_s: float
    order: int
    level: float = 1.0

    def power(self, time_constant_s: np.ndarray) -> np.ndarray:
        """Return the power at the cutoff of paths with these time constants, at least that of white errors."""
        if self.correlation_s <= 0.0:
            return np.ones_like(time_constant_s)
        angle = np.minimum(self.step_s / np.maximum(time_constant_s, 1e-300), np.pi)
        return np.maximum(_power(np.exp(-self.step_s / self.correlation_s), angle), 1.0)

    def covariance_factor(self, inflation: np.ndarray, log_gain: np.ndarray, leverage: np.ndarray) -> np.ndarray:
        """Return the factor of the covariance that follows from white errors with inflated variances.

        At the ends of a path and in short ones, fewer frames than usual determine a point. The inflated variance, meant
        for the mean of many frames, would exceed that of the point of a single frame; the part of the errors is limited
        to the latter.

        Args:
            inflation: shape (keypoint,): variance of the white errors that the path assumes, relative to the actual
                ones.
            log_gain: shape (keypoint, frame): logarithm of ``density step_s^(2 order - 1) / variance``, where
                ``variance`` is the inflated variance of a point from a single frame.
            leverage: shape (keypoint, frame): covariance of the path relative to that of a point from the frame alone,
                both with the inflated variances; 0 where the frame shows nothing.
        """
        factor = np.ones(log_gain.shape)
        if self.correlation_s > 0.0:
            usual, errors, motion = _shares(float(np.exp(-self.step_s / self.correlation_s)), self.order)
            shares = np.stack([usual, errors, _UNEVEN_MOTION * motion])
            limited_factors(shares, _LOG_GAINS, self.level / inflation, log_gain, leverage, factor)
        return factor

    def mean_factor(self, inflation: np.ndarray, leverage: np.ndarray) -> np.ndarray:
        """Return the factor of the covariance of a point that is the mean of several frames, as that of a resting one.

        Args:
            inflation: variance of the white errors that the mean assumes, relative to the actual ones.
            leverage: covariance of the mean relative to that of a point from one frame, both with inflated variances.
        """
        frames = 1.0 / np.clip(leverage, 1e-6, 1.0)
        if self.correlation_s <= 0.0:
            return np.broadcast_to(self.level / inflation, np.shape(frames)).copy()
        decay = self.step_s / self.correlation_s
        correlation, apart = np.exp(-decay), max(-np.expm1(-decay), 1e-15)
        lost = -2.0 * correlation * np.expm1(-decay * frames) / (frames * apart**2)
        # Errors that never change leave the variance of one frame, whatever the number of frames.
        return self.level / inflation * np.clip((1.0 + correlation) / apart - lost, 1.0, frames)


def _power(correlation: float, angle: np.ndarray) -> np.ndarray:
    """Return the power of an autoregressive process of unit variance at frequencies in radians per frame."""
    # The sine keeps low frequencies apart when the correlation is almost one.
    apart = np.square(1.0 - correlation) + 4.0 * correlation * np.square(np.sin(0.5 * angle))
    return (1.0 - correlation) * (1.0 + correlation) / apart


@lru_cache(maxsize=64)
def _shares(correlation: float, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the assumed variance of a path, and what errors and motion contribute to the actual one, relative to it.

    With the power ``S`` of the errors and ``D`` of the finite difference, a path of gain ``g`` that assumes white
    errors of unit variance has the assumed variance ``int 1 / (1 + D / g)``, the variance ``int S / (1 + D / g)^2``
    from errors and ``int (D / g) / (1 + D / g)^2`` from motion.
    """
    # Dense at low frequencies, where slow paths have their cutoff.
    edges = np.pi * np.linspace(0.0, 1.0, _FREQUENCIES + 1) ** 4
    angle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    relative = np.square(2.0 * np.sin(0.5 * angle)) ** order / np.exp(_LOG_GAINS)[:, None]
    gain = 1.0 / (1.0 + relative)
    assumed = gain @ width
    errors = np.square(gain) @ (width * _power(correlation, angle))
    motion = (relative * np.square(gain)) @ width
    return assumed / np.pi, errors / assumed, motion / assumed
