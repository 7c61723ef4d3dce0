"""Bundle adjustment: estimate cameras and points that maximize the likelihood of the observations.

Levenberg-Marquardt steps adjust the cameras with the points eliminated (Schur complement; Triggs et al. 2000);
iterative reweighting models Student-t errors. The noise factor of each view is estimated from its own residuals, so
that a camera whose observations do not fit is assigned high noise and loses its influence.
"""

from dataclasses import dataclass
from typing import Protocol, Self, TypeVar

import numpy as np

from posefuse.calibration.normal_equations import (
    NormalEquations,
    Observations,
    ResidualRows,
    compute_rows,
    shared_columns,
)
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

M = TypeVar("M", bound="Model")


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


class Model(Protocol):
    """Cameras, and the points or poses of a board that they observe."""

    @property
    def observations(self) -> Observations:
        """The observations."""
        ...

    @property
    def n_views(self) -> int:
        """Number of cameras."""
        ...

    def rows(self, scale: np.ndarray) -> ResidualRows:
        """Return residuals and derivatives at noise factors of shape (view,)."""
        ...

    def moved(self, change: np.ndarray, step: np.ndarray) -> Self:
        """Return the model after changes of the cameras (view, P) and of the points or poses (point, D)."""
        ...


@dataclass(frozen=True, eq=False)
class PointModel:
    """Cameras and points.

    Attributes:
        rig: the cameras.
        points_m: shape (point, 3).
        observations: of the points.
    """

    rig: CameraRig
    points_m: np.ndarray
    observations: PointObservations

    @property
    def n_views(self) -> int:
        """Number of cameras."""
        return len(self.rig)

    def rows(self, scale: np.ndarray) -> ResidualRows:
        """Return residuals and derivatives."""
        return compute_rows(self.rig, self.observations, self.points_m, scale)

    def moved(self, change: np.ndarray, step: np.ndarray) -> "PointModel":
        """Return the model after a step."""
        return PointModel(apply_changes(self.rig, change), self.points_m + step, self.observations)


def adjust(rig: CameraRig, observations: PointObservations, free: FreeParameters, start_px: float) -> Adjustment:
    """Estimate cameras and points.

    Args:
        rig: initial cameras.
        observations: of the points.
        free: free parameters.
        start_px: initial error of the observations.
    """
    initial = PointModel(rig, observations.points_m, observations)
    model, scale, rows = estimate(initial, free.free, start_px / float(np.median(observations.sigma_px)))
    return Adjustment(model.rig, model.points_m, scale, rows)


def estimate(model: M, free: np.ndarray, start: float) -> tuple[M, np.ndarray, ResidualRows]:
    """Estimate the parameters of a model and the noise of its views.

    At first, the assumed noise of all views is as large as their initial errors, so that each has influence. It is then
    reduced stepwise to its estimate.

    Args:
        model: initial parameters.
        free: shape (view, P), bool: free parameters of the cameras.
        start: initial error of the observations as a multiple of their noise.

    Returns:
        The model, the noise factors of the views (view,), NaN without observations, and its residuals.
    """
    damping, n_views = 1e-3, model.n_views
    scale = np.ones(n_views)
    rows = model.rows(scale)
    for factor in (start, start / 3.0, start / 10.0):
        scale = np.full(n_views, max(factor, _MIN_SCALE))
        model, rows, damping = descend(model, free, scale, damping, _COARSE_GAIN)
    for _ in range(_SCALE_ITERATIONS):
        scale = noise_factors(rows, scale, model.observations)
        model, rows, damping = descend(model, free, scale, damping, _FINE_GAIN)
    return model, scale, rows


def noise_factors(rows: ResidualRows, scale: np.ndarray, observations: Observations) -> np.ndarray:
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


def descend(
    model: M, free: np.ndarray, scale: np.ndarray, damping: float, min_gain: float
) -> tuple[M, ResidualRows, float]:
    """Run Levenberg-Marquardt at a fixed noise until a step gains less than a share of the cost.

    Args:
        model: initial parameters.
        free: shape (view, P), bool: free parameters of the cameras.
        scale: shape (view,): noise factor of each view.
        damping: initial relative increase of the diagonals.
        min_gain: share of the cost.

    Returns:
        The model, its residuals and the damping.
    """
    rows = model.rows(scale)
    columns, shared = np.flatnonzero(free.ravel()), shared_columns(free, rows.n_shared)
    for _ in range(_MAX_STEPS):
        normal = NormalEquations.of(rows, model.observations, model.n_views, rows.weight)
        gain = 0.0
        while damping < _MAX_DAMPING:
            reduced = normal.reduced(columns, damping)
            change = np.zeros(free.size)
            if len(columns):
                matrix, gradient = shared.T @ reduced.matrix @ shared, shared.T @ reduced.gradient
                change[columns] = shared @ np.linalg.lstsq(matrix, -gradient, rcond=1e-14)[0]
            change = change.reshape(free.shape)
            candidate = model.moved(change, normal.points_step(reduced, change))
            new_rows = candidate.rows(scale)
            if new_rows.cost < rows.cost:
                gain = rows.cost - new_rows.cost
                model, rows = candidate, new_rows
                damping = max(damping / 5.0, _MIN_DAMPING)
                break
            damping *= 4.0
        damping = min(damping, 1e3)
        if gain <= min_gain * (1.0 + rows.cost):
            break
    return model, rows, damping
