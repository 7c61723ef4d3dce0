"""Select the model of a view's clock error (offset, drift or dropped frames) from the offsets measured per block."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.hypotheses import Hypothesis, enumerate_hypotheses
from posefuse.diagnostics.linear_system import LinearSystem
from posefuse.diagnostics.recording_model import N_PARAMETERS, Parameter


@dataclass(frozen=True, eq=False)
class ClockFit:
    """Hold one fitted model of a clock error.

    Attributes:
        hypothesis: kind of clock error.
        values: shape (unknown,): fitted values.
        sds: shape (unknown,): standard deviations of the values.
        offset_s: shape (block,): fitted time offset.
        cost: remaining squared error in units of the noise, plus the penalty.
    """

    hypothesis: Hypothesis
    values: np.ndarray
    sds: np.ndarray
    offset_s: np.ndarray
    cost: float


def fit_clock(
    system: LinearSystem, view: int, current_offset_s: np.ndarray, period_s: float, design_effect: float
) -> ClockFit | None:
    """Return the best model of a view's clock error, or None if nothing was measured.

    Args:
        system: linearized problem at the current model.
        view: index of the view.
        current_offset_s: shape (block,): time offset of the current model.
        period_s: time between frames; only whole frames are dropped.
        design_effect: number of correlated observations that carry the information of one.
    """
    index = view * N_PARAMETERS + Parameter.OFFSET
    weight = system.blocks.normal[:, index, index] / design_effect
    known = weight > 1e-6 * weight.max(initial=0.0)
    if known.sum() < 2:
        return None
    measured = current_offset_s + np.where(known, system.blocks.right[:, index] / design_effect, 0.0) / np.where(
        known, weight, 1.0
    )
    weight = np.where(known, weight, 0.0)
    fits = (
        _fit_kind(hypothesis, measured, weight, period_s)
        for hypothesis in enumerate_hypotheses(system, view, ("clock",))
    )
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.cost, default=None)


def _fit_kind(hypothesis: Hypothesis, measured: np.ndarray, weight: np.ndarray, period_s: float) -> ClockFit | None:
    """Return the best fit of one kind of clock error, or None if it cannot be fitted."""
    profiles = np.stack([unknown.profile for unknown in hypothesis.unknowns], axis=1)
    if not (weight @ np.square(profiles)).all():
        # No block determines one of the unknowns.
        return None
    values, inverse = _weighted_fit(profiles, measured, weight)
    if hypothesis.kind == "dropped":
        step = period_s * np.round(values[-1] / period_s)
        if step == 0.0:
            return None
        rest = _weighted_fit(profiles[:, :-1], measured - step * profiles[:, -1], weight)[0] if len(values) > 1 else ()
        values = np.array([*rest, step])
    offset_s = profiles @ values
    cost = float((weight * np.square(measured - offset_s)).sum()) + hypothesis.penalty
    return ClockFit(hypothesis, values, np.sqrt(np.maximum(np.diag(inverse), 0.0)), offset_s, cost)


def _weighted_fit(profiles: np.ndarray, measured: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the values and the inverse normal matrix of a weighted linear fit."""
    normal = profiles.T @ (profiles * weight[:, None])
    inverse = np.linalg.inv(normal + 1e-12 * np.trace(normal) * np.eye(len(normal)))
    return inverse @ (profiles.T @ (weight * measured)), inverse


def same_clock_model(a: Hypothesis, b: Hypothesis) -> bool:
    """Return whether two hypotheses describe the same kind of clock error with the same change point."""
    return (a.kind, a.since_block, len(a.unknowns)) == (b.kind, b.since_block, len(b.unknowns))


def clock_offset_s(hypothesis: Hypothesis, values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the time offset of a hypothesis in each block, shape (block,), in seconds."""
    return np.stack([unknown.profile for unknown in hypothesis.unknowns], axis=1) @ np.asarray(values)
