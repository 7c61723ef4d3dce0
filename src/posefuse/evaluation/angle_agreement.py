"""Agreement of two sets of joint angles over time: root mean square error, bias, limits of agreement, correlation.

Bias and limits of agreement follow Bland and Altman 1986, "Statistical methods for assessing agreement between two
methods of clinical measurement".
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError, choices

_MIN_COMMON = 3
_STEPS_PER_FRAME = 4
_MAX_STEPS = 4000
"""Bound of the search for the time shift; a larger range is searched with larger steps."""
_LIMITS_SD = 1.96
_CONSTANT_DEG = 1e-9
TRANSLATIONS = ("_tx", "_ty", "_tz")
"""Endings of coordinates of OpenSim that are lengths, not angles."""


@checked
@dataclass(frozen=True, eq=False)
class AngleSeries:
    """Joint angles of one subject over time.

    Attributes:
        name: name of the subject or of the file.
        time_s: shape (frame,), increasing.
        angles: names of the angles.
        degrees: shape (frame, angle), NaN where unknown.

    Raises:
        ResultError: if the arrays do not match or times do not increase.
    """

    name: str
    time_s: np.ndarray
    angles: tuple[str, ...]
    degrees: np.ndarray

    def __post_init__(self) -> None:
        expected = (len(self.time_s), len(self.angles))
        if self.degrees.shape != expected:
            raise ResultError(f"{self.name}: expected degrees of shape {expected}, got {self.degrees.shape}.")
        if not np.isfinite(self.time_s).all() or (np.diff(self.time_s) <= 0).any():
            raise ResultError(f"{self.name}: times must be finite and increase from row to row.")


@dataclass(frozen=True, eq=False)
class AngleAgreement:
    """Agreement of one angle.

    Attributes:
        angle: name.
        n: number of compared frames.
        rmse_deg: root mean square of result minus reference.
        bias_deg: mean of result minus reference.
        limits_deg: 95 % limits of agreement, bias plus or minus 1.96 standard deviations.
        mae_deg: mean absolute difference.
        correlation: Pearson's r; NaN if one of the two is constant.
        means_deg: shape (n,): means of result and reference.
        differences_deg: shape (n,): result minus reference.
    """

    angle: str
    n: int
    rmse_deg: float
    bias_deg: float
    limits_deg: tuple[float, float]
    mae_deg: float
    correlation: float
    means_deg: np.ndarray
    differences_deg: np.ndarray


@dataclass(frozen=True, eq=False)
class AngleComparison:
    """Agreement of all angles that a result and a reference share.

    Attributes:
        result: name of the result.
        reference: name of the reference.
        time_shift_s: time that was added to the result's times.
        angles: agreement of each common angle, in the order of the result.
        only_in_result: angles that the reference does not have.
        only_in_reference: angles that the result does not have.
    """

    result: str
    reference: str
    time_shift_s: float
    angles: tuple[AngleAgreement, ...]
    only_in_result: tuple[str, ...]
    only_in_reference: tuple[str, ...]


@checked
def compare_angles(result: AngleSeries, reference: AngleSeries, max_time_shift_s: float = 0.0) -> AngleComparison:
    """Compare joint angles with a reference on the result's frames.

    The reference is interpolated linearly between its rows and never extrapolated. Differences of angles are taken
    modulo 360 degrees, so that curves that differ by whole turns agree.

    Args:
        result: angles to evaluate.
        reference: angles to compare them with.
        max_time_shift_s: largest time shift to search; 0 compares times as they are. The shift is the one with the
            smallest standard deviation of the differences, over all common angles.

    Raises:
        ResultError: if no angle is common, or fewer than three frames overlap in time.
    """
    common = tuple(name for name in result.angles if name in reference.angles and not name.endswith(TRANSLATIONS))
    if not common:
        raise ResultError(
            f"{result.name} and {reference.name} share no angle. Angles of the result: {choices(result.angles, 12)}. "
            f"Angles of the reference: {choices(reference.angles, 12)}."
        )
    mine = result.degrees[:, [result.angles.index(name) for name in common]]
    shift = _best_shift(result, reference, common, mine, max_time_shift_s) if max_time_shift_s > 0 else 0.0
    theirs = _at(reference, common, result.time_s + shift)
    differences = _wrapped(mine - theirs)
    if np.isfinite(differences).sum(axis=0).max() < _MIN_COMMON:
        raise ResultError(
            f"{result.name} ({_span(result.time_s)}) and {reference.name} ({_span(reference.time_s)}) have fewer than "
            f"{_MIN_COMMON} common frames in which both know an angle. Both need one time axis, or a larger time shift."
        )
    return AngleComparison(
        result.name,
        reference.name,
        shift,
        tuple(_agreement(name, mine[:, i], differences[:, i]) for i, name in enumerate(common)),
        tuple(name for name in result.angles if name not in reference.angles),
        tuple(name for name in reference.angles if name not in result.angles),
    )


def _best_shift(
    result: AngleSeries, reference: AngleSeries, common: Sequence[str], mine: np.ndarray, limit_s: float
) -> float:
    """Return the shift on a grid with the smallest spread, refined by a parabola through its neighbors."""
    interval = float(np.median(np.diff(result.time_s))) if len(result.time_s) > 1 else limit_s
    step = max(interval / _STEPS_PER_FRAME, 2.0 * limit_s / _MAX_STEPS)
    half = int(np.floor(limit_s / step))
    # From the center outward, so that equal spreads choose the smallest shift.
    shifts = step * np.array(sorted(range(-half, half + 1), key=abs))
    spreads = np.array([_spread(mine - _at(reference, common, result.time_s + shift)) for shift in shifts])
    if not np.isfinite(spreads).any():
        return 0.0
    best = float(shifts[int(np.nanargmin(spreads))])
    around = [_spread(mine - _at(reference, common, result.time_s + best + offset)) for offset in (-step, 0.0, step)]
    bend = around[0] - 2.0 * around[1] + around[2]
    if not np.isfinite(bend) or bend <= 0:
        return best
    return float(np.clip(best + 0.5 * step * (around[0] - around[2]) / bend, -limit_s, limit_s))


def _spread(differences: np.ndarray) -> float:
    """Return the variance of differences about the median of each angle; NaN where less than half can be compared."""
    differences = _wrapped(differences)
    known = np.isfinite(differences)
    if known.any(axis=1).sum() < max(_MIN_COMMON, 0.5 * len(differences)):
        return float("nan")
    used = differences[:, known.any(axis=0)]
    return float(np.nanmean((used - np.nanmedian(used, axis=0)) ** 2))


def _at(series: AngleSeries, names: Sequence[str], time_s: np.ndarray) -> np.ndarray:
    """Return angles at other times by linear interpolation, NaN outside and beside unknown rows."""
    columns = []
    for name in names:
        # Unwrapped, so that a jump from 180 to -180 degrees is not interpolated through 0.
        values = series.degrees[:, series.angles.index(name)]
        known = np.isfinite(values)
        unwrapped = np.full(len(values), np.nan)
        unwrapped[known] = np.unwrap(values[known], period=360.0)
        columns.append(np.interp(time_s, series.time_s, unwrapped, left=np.nan, right=np.nan))
    return np.stack(columns, axis=1)


def _wrapped(differences: np.ndarray) -> np.ndarray:
    """Return angles between -180 and 180 degrees."""
    return (differences + 180.0) % 360.0 - 180.0


def _agreement(name: str, mine: np.ndarray, differences: np.ndarray) -> AngleAgreement:
    known = np.isfinite(differences)
    if known.sum() < _MIN_COMMON:
        nan = float("nan")
        return AngleAgreement(name, int(known.sum()), nan, nan, (nan, nan), nan, nan, np.empty(0), np.empty(0))
    difference, own = differences[known], np.unwrap(mine[known], period=360.0)
    other = own - difference
    bias, sd = float(difference.mean()), float(difference.std(ddof=1))
    varies = own.std() > _CONSTANT_DEG and other.std() > _CONSTANT_DEG
    return AngleAgreement(
        name,
        int(known.sum()),
        float(np.sqrt(np.mean(difference**2))),
        bias,
        (bias - _LIMITS_SD * sd, bias + _LIMITS_SD * sd),
        float(np.abs(difference).mean()),
        float(np.corrcoef(own, other)[0, 1]) if varies else float("nan"),
        (own + other) / 2.0,
        difference,
    )


def _span(time_s: np.ndarray) -> str:
    return f"{time_s[0]:.2f} to {time_s[-1]:.2f} s" if len(time_s) else "empty"
