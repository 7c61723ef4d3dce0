"""Law of detection errors: Student-t tails, and a correlation over time with a fast and a slow part.

Errors of detectors are similar from frame to frame (0.85 at one frame of 25 fps), and a part of them persists as long
as a person shows the camera the same side (0.4 after a second). The shares of both parts are estimated from the
residuals of the recording.
"""

from dataclasses import dataclass, field

import numpy as np

STUDENT_T_DOF = 2.7
"""Degrees of freedom of the Student-t distribution of detection errors."""
FAST_S, SLOW_S = 0.13, 8.0
_USUAL_SLOW, _USUAL_STREAMS = 0.4, 100.0
_MIN_SLOW, _MAX_SLOW = 0.0, 0.95
_MAX_LAG_S = 1.0


@dataclass(frozen=True)
class NoiseLaw:
    """Correlation of the errors of the keypoints in one view.

    Attributes:
        slow: share of the variance that decays within ``SLOW_S``; the remainder decays within ``FAST_S``.
        mixing: shape (column, column): root of the correlation of the errors of different columns at one time; None if
            these are independent.
    """

    slow: float = _USUAL_SLOW
    mixing: np.ndarray | None = field(default=None, compare=False)

    def correlation(self, lag_s: np.ndarray | float) -> np.ndarray:
        """Return the correlation of errors some time apart."""
        lag_s = np.abs(lag_s)
        return (1.0 - self.slow) * np.exp(-lag_s / FAST_S) + self.slow * np.exp(-lag_s / SLOW_S)


def estimate_law(scores: np.ndarray, time_s: np.ndarray, absorbed: float) -> NoiseLaw:
    """Estimate the share of slow errors from the correlation of scores over time.

    Args:
        scores: shape (sample, stream): residuals times weights, NaN where missing; a stream is one coordinate of one
            keypoint in one view.
        time_s: shape (sample,): ascending.
        absorbed: number of estimated constants that a constant error of the streams can be mistaken for.
    """
    known = np.isfinite(scores)
    value = np.where(known, scores, 0.0)
    variance = float(np.square(value).sum() / max(known.sum(), 1))
    span_s = float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 0.0
    if variance <= 0.0 or span_s <= 0.0:
        return NoiseLaw()
    lag_s = min(_MAX_LAG_S, 0.5 * span_s)
    later = np.minimum(np.searchsorted(time_s, time_s + lag_s), len(time_s) - 1)
    apart = time_s[later] - time_s
    pairs = np.abs(apart - lag_s) < 0.25 * lag_s
    both = (known[later] & known)[pairs]
    if not both.any():
        return NoiseLaw()
    product = float((value[later] * value)[pairs].sum() / both.sum()) / variance
    apart_s = float(np.median(apart[pairs]))
    fast, slow = np.exp(-apart_s / FAST_S), np.exp(-apart_s / SLOW_S)
    measured = (product - fast) / max(slow - fast, 1e-9)
    streams = float((known.sum(axis=0) > 0.2 * len(scores)).sum())
    # Constants of the cameras absorb a part of the constant errors.
    periods = 1.0 + span_s / SLOW_S
    left = max(1.0 - absorbed / max(streams * periods, 1.0), 0.3)
    ratio = measured / left / max(1.0 - measured + measured / left, 1e-9)
    weight = streams * periods / (streams * periods + _USUAL_STREAMS)
    return NoiseLaw(float(np.clip(weight * ratio + (1.0 - weight) * _USUAL_SLOW, _MIN_SLOW, _MAX_SLOW)))
