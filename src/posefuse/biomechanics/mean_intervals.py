"""95 % intervals of means of few values, which contain only possible values.

A t interval of positive numbers may contain negative ones, and one of shares more than 100 %. Intervals of both are
symmetric on a scale without bounds, the logarithm or the logit, with the standard error there by the delta method
(Oehlert 1992, American Statistician 46(1)).
"""

from typing import Literal

import numpy as np
from scipy.special import expit, logit, stdtrit

Scale = Literal["linear", "log", "percent"]
MIN_VALUES = 4
"""Number of values from which on a mean has an interval. Its half width is 9 standard deviations with two values, 2.5
with three, and 1.6 with four: with fewer, it says more about the quantile of the t distribution than about the mean."""
NO_INTERVAL = (float("nan"), float("nan"))


def scale_of(name: str, values: np.ndarray) -> Scale:
    """Return the scale on which the interval of a mean is symmetric.

    Args:
        name: name of the quantity with its unit as suffix.
        values: shape (value,).
    """
    if name.endswith("_percent") and ((values >= 0.0) & (values <= 100.0)).all():
        return "percent"
    return "log" if (values > 0.0).all() else "linear"


def mean_interval(mean: float, error: float, freedom: float, scale: Scale) -> tuple[float, float]:
    """Return the lower and the upper end of the 95 % interval of a mean by Student's t distribution.

    Args:
        mean: the mean; positive for ``log``, between 0 and 100 for ``percent``.
        error: standard error of the mean.
        freedom: degrees of freedom.
        scale: scale on which the interval is symmetric.

    Returns:
        The ends; the mean itself without a standard error, and NaN if it is not finite.
    """
    if not np.isfinite(error) or not np.isfinite(mean):
        return NO_INTERVAL
    if error == 0.0:
        return mean, mean
    half = float(stdtrit(freedom, 0.975)) * error
    if scale == "log":
        factor = float(np.exp(half / mean))
        return mean / factor, mean * factor
    if scale == "percent":
        share = mean / 100.0
        middle, spread = logit(share), half / 100.0 / (share * (1.0 - share))
        return 100.0 * float(expit(middle - spread)), 100.0 * float(expit(middle + spread))
    return mean - half, mean + half


def half_width_of_one(sd: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Return half of the width of the interval around a mean that contains one further value in 95 % of cases.

    Args:
        sd: shape (...): standard deviation of the values that the mean rests on.
        n: shape (...): their number.

    Returns:
        Half widths, shape (...), NaN for fewer than four values.
    """
    enough = n >= MIN_VALUES
    count = np.where(enough, n, MIN_VALUES)
    return np.where(enough, stdtrit(count - 1, 0.975) * np.sqrt(1.0 + 1.0 / count) * sd, np.nan)


def difference_interval(left: np.ndarray, right: np.ndarray) -> tuple[float, float, float, float]:
    """Return the difference of two means of positive values, right minus left, relative to their mean.

    It is 2 tanh(x / 2) for the logarithm x of their ratio, whose interval follows from Welch's test; both ends are
    between -200 and 200 %.

    Args:
        left: shape (value,).
        right: shape (value,).

    Returns:
        The difference, its standard error and the ends of its 95 % interval, in percent; NaN for the ends with fewer
        than four values of a side, and for all if a mean is not positive.
    """
    means = float(left.mean()), float(right.mean())
    if min(means) <= 0.0:
        return float("nan"), float("nan"), *NO_INTERVAL
    value = 200.0 * (means[1] - means[0]) / (means[0] + means[1])
    sizes = np.array([len(left), len(right)])
    parts = np.array([each.var(ddof=1) / len(each) / mean**2 for each, mean in zip((left, right), means, strict=True)])
    error = float(np.sqrt(parts.sum()))
    # The slope of 200 tanh(x / 2).
    slope = 100.0 - value**2 / 400.0
    if sizes.min() < MIN_VALUES:
        return value, slope * error, *NO_INTERVAL
    spread = float((np.square(parts) / (sizes - 1)).sum())
    freedom = error**4 / spread if spread > 0.0 else 1.0
    low, high = mean_interval(float(np.log(means[1] / means[0])), error, freedom, "linear")
    return value, slope * error, 200.0 * float(np.tanh(0.5 * low)), 200.0 * float(np.tanh(0.5 * high))
