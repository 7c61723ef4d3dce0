"""Bundle adjustment: estimate cameras and points that maximize the likelihood of the observations.

Levenberg-Marquardt steps adjust the cameras with the points eliminated (Schur complement; Triggs et al. 2000);
iterative reweighting models Student-t errors. The noise factor of each view is estimated from its own residuals, so
that a camera whose observations do not fit is assigned high noise and loses its influence.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.normal_equations import NormalEquations, ResidualRows, compute_rows
from posefuse.calibration.parameters import FreeParameters, apply_changes
from posefuse.calibration.point_observations import PointObservations
from posefuse.model.cameras import CameraRig

_MAX_STEPS = 40
_SCALE_ITERATIONS = 2
_COARSE_GAIN, _FINE_GAIN = 1e-3, 1e-6
_MIN_DAMPING, _MAX_DAMPING = 1e-9, 1e6
# The median length of a standard normal error in two dimensions.
_MEDIAN_LENGTH = float(np.sqrt(2.0 * np.log(2.0)))
_MIN_SCALE = 1e-3
_MIN_FACTOR = 0.5


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Result of an adjustment.

    Attributes:
        rig: the cameras.
        points_m: shape (point, 3).
        scale: shape (view,): noise factor of each view, NaN without observations.
        rows: residuals and derivatives.
    """

    rig: CameraRig
    points_m: np.ndarray
    scale: np.ndarray
    rows: ResidualRows


def adjust(rig: CameraRig, observations: PointObservations, free: FreeParameters, start_px: float) -> Adjustment:
    """Estimate cameras and points.

    At first, the assumed noise of all views is as large as their initial errors, so that each has influence. It is then
    reduced stepwise to its estimate.

    Args:
        rig: initial cameras.
        observations: of the points.
        free: free parameters.
        start_px: initial error of the observations.
    """
    points, damping = observations.points_m, 1e-3
    noise = np.median(observations.sigma_px)
    scale = np.ones(len(rig))
    rows = compute_rows(rig, observations, points, scale)
    for scale_px in (start_px, start_px / 3.0, start_px / 10.0):
        scale = np.full(len(rig), max(scale_px / noise, _MIN_SCALE))
        rig, points, rows, damping = _descend(rig, points, observations, free, scale, damping, _COARSE_GAIN)
    for _ in range(_SCALE_ITERATIONS):
        scale = noise_factors(rows, scale, observations)
        rig, points, rows, damping = _descend(rig, points, observations, free, scale, damping, _FINE_GAIN)
    return Adjustment(rig, points, scale, rows)


def noise_factors(rows: ResidualRows, scale: np.ndarray, observations: PointObservations) -> np.ndarray:
    """Estimate the noise factor of each view, shape (view,).

    Points are fitted to the observations, so residuals are smaller than errors, especially for views with a high
    weight; residuals are corrected by the share of an error that remains in them. Factors have a lower bound relative
    to the median, because points would otherwise follow a single view.

    Args:
        rows: residuals in units of the noise.
        scale: shape (view,): factors of that noise relative to the observations' own.
        observations: the observations.
    """
    length = np.sqrt(rows.squared / rows.remaining_shares(observations))
    factors = np.full(len(scale), np.nan)
    for v in range(len(scale)):
        of_view = length[observations.view == v]
        if len(of_view):
            factors[v] = scale[v] * float(np.median(of_view)) / _MEDIAN_LENGTH
    typical = max(float(np.nanmedian(factors)), _MIN_SCALE)
    return np.maximum(np.nan_to_num(factors, nan=typical), _MIN_FACTOR * typical)


def _descend(
    rig: CameraRig,
    points: np.ndarray,
    observations: PointObservations,
    free: FreeParameters,
    scale: np.ndarray,
    damping: float,
    min_gain: float,
) -> tuple[CameraRig, np.ndarray, ResidualRows, float]:
    """Run Levenberg-Marquardt at a fixed noise until a step gains less than a share of the cost."""
    rows = compute_rows(rig, observations, points, scale)
    columns = free.columns
    for _ in range(_MAX_STEPS):
        normal = NormalEquations.of(rows, observations, len(rig), rows.weight)
        gain = 0.0
        while damping < _MAX_DAMPING:
            reduced = normal.reduced(columns, damping)
            step = np.linalg.lstsq(reduced.matrix, -reduced.gradient, rcond=1e-14)[0]
            change = np.zeros(free.free.size)
            change[columns] = step
            change = change.reshape(free.free.shape)
            candidate = apply_changes(rig, change)
            new_points = points + normal.points_step(reduced, change)
            new_rows = compute_rows(candidate, observations, new_points, scale)
            if new_rows.cost < rows.cost:
                gain = rows.cost - new_rows.cost
                rig, points, rows = candidate, new_points, new_rows
                damping = max(damping / 5.0, _MIN_DAMPING)
                break
            damping *= 4.0
        damping = min(damping, 1e3)
        if gain <= min_gain * (1.0 + rows.cost):
            break
    return rig, points, rows, damping
