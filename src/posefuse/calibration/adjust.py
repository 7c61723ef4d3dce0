"""Bundle adjustment: cameras and points moved together until what the cameras saw is most likely.

Levenberg-Marquardt on the cameras, points eliminated (Schur complement; Triggs et al. 2000), errors Student t by
reweighting. The factor of each view's noise is found along the way from its own residuals: a camera that fits nothing
becomes noisy, and then pulls nothing.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.normal import Normal, Rows, rows_of
from posefuse.calibration.parameters import Freedom, changed
from posefuse.calibration.sightings import Sightings
from posefuse.model.cameras import CameraRig

_MOST_STEPS = 40
_SCALE_ROUNDS = 2
_COARSE_GAIN, _FINE_GAIN = 1e-3, 1e-6
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e6
# The median length of a standard normal error in two dimensions.
_MEDIAN_LENGTH = float(np.sqrt(2.0 * np.log(2.0)))
_LEAST_SCALE = 1e-3
_LEAST_FACTOR = 0.5


@dataclass(frozen=True, eq=False)
class Adjusted:
    """Where an adjustment came to.

    Attributes:
        rig: the cameras.
        points_m: shape (point, 3).
        scale: shape (view,): factor of each view's noise, NaN where it saw nothing.
        rows: residuals and derivatives there.
    """

    rig: CameraRig
    points_m: np.ndarray
    scale: np.ndarray
    rows: Rows


def adjust(rig: CameraRig, sightings: Sightings, freedom: Freedom, start_px: float) -> Adjusted:
    """Move cameras and points until the observations are most likely.

    At first all views are taken to be as noisy as they seem, so that each pulls; then, by and by, as noisy as they are.

    Args:
        rig: where the cameras seem to be.
        sightings: what they saw.
        freedom: what may change.
        start_px: how far off the observations seem to be.
    """
    points, damping = sightings.points_m, 1e-3
    noise = np.median(sightings.sigma_px)
    scale = np.ones(len(rig))
    rows = rows_of(rig, sightings, points, scale)
    for scale_px in (start_px, start_px / 3.0, start_px / 10.0):
        scale = np.full(len(rig), max(scale_px / noise, _LEAST_SCALE))
        rig, points, rows, damping = _descend(rig, points, sightings, freedom, scale, damping, _COARSE_GAIN)
    for _ in range(_SCALE_ROUNDS):
        scale = noise_factors(rows, scale, sightings)
        rig, points, rows, damping = _descend(rig, points, sightings, freedom, scale, damping, _FINE_GAIN)
    return Adjusted(rig, points, scale, rows)


def noise_factors(rows: Rows, scale: np.ndarray, sightings: Sightings) -> np.ndarray:
    """Shape (view,): factors by which views are noisier than was thought, or less.

    Points were fitted to the observations, which makes residuals smaller than errors, the more so the more a view is
    believed: residuals count by the share of an error that is left in them. No view is taken to be much better than
    most: points would follow it alone.

    Args:
        rows: residuals in units of a noise.
        scale: shape (view,): factors by which that noise is larger than the observations' own.
        sightings: the observations.
    """
    length = np.sqrt(rows.squared / rows.freedom(sightings))
    factors = np.full(len(scale), np.nan)
    for v in range(len(scale)):
        of_view = length[sightings.view == v]
        if len(of_view):
            factors[v] = scale[v] * float(np.median(of_view)) / _MEDIAN_LENGTH
    usual = max(float(np.nanmedian(factors)), _LEAST_SCALE)
    return np.maximum(np.nan_to_num(factors, nan=usual), _LEAST_FACTOR * usual)


def _descend(
    rig: CameraRig,
    points: np.ndarray,
    sightings: Sightings,
    freedom: Freedom,
    scale: np.ndarray,
    damping: float,
    least_gain: float,
) -> tuple[CameraRig, np.ndarray, Rows, float]:
    """Levenberg-Marquardt at a fixed noise, until a step gains no more than a share of the cost."""
    rows = rows_of(rig, sightings, points, scale)
    columns = freedom.columns
    for _ in range(_MOST_STEPS):
        normal = Normal.of(rows, sightings, len(rig), rows.weight)
        gain = 0.0
        while damping < _MOST_DAMPING:
            reduced = normal.reduced(columns, damping)
            step = np.linalg.lstsq(reduced.matrix, -reduced.gradient, rcond=1e-14)[0]
            change = np.zeros(freedom.free.size)
            change[columns] = step
            change = change.reshape(freedom.free.shape)
            tried = changed(rig, change)
            moved = points + normal.points_step(reduced, change)
            new = rows_of(tried, sightings, moved, scale)
            if new.cost < rows.cost:
                gain = rows.cost - new.cost
                rig, points, rows = tried, moved, new
                damping = max(damping / 5.0, _LEAST_DAMPING)
                break
            damping *= 4.0
        damping = min(damping, 1e3)
        if gain <= least_gain * (1.0 + rows.cost):
            break
    return rig, points, rows, damping
