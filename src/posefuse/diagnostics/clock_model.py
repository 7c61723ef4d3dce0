"""In which way a view's clock is wrong: what each second measures of its offset, and the simplest line through that."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.hypotheses import Hypothesis, hypotheses
from posefuse.diagnostics.linear_system import System
from posefuse.diagnostics.state import N_COLUMNS, Column


@dataclass(frozen=True, eq=False)
class Line:
    """A way in which a clock may be wrong, as it fits best.

    Attributes:
        hypothesis: which way.
        values: shape (unknown,): of its numbers.
        sds: shape (unknown,): their standard deviations.
        late_s: shape (block,): how late the view is by it.
        cost: what it leaves, in units of the noise, and its penalty.
    """

    hypothesis: Hypothesis
    values: np.ndarray
    sds: np.ndarray
    late_s: np.ndarray
    cost: float


def likeliest(system: System, view: int, granted_s: np.ndarray, period_s: float, effect: float) -> Line | None:
    """The way in which a view's clock is most likely wrong; None where nothing was measured.

    Args:
        system: linearised with what is granted.
        view: whose clock.
        granted_s: shape (block,): how late it is believed to be.
        period_s: between frames: they are dropped whole.
        effect: how many observations count as one.
    """
    index = view * N_COLUMNS + Column.LATE
    weight = system.blocks.normal[:, index, index] / effect
    told = weight > 1e-6 * weight.max(initial=0.0)
    if told.sum() < 2:
        return None
    measured = granted_s + np.where(told, system.blocks.right[:, index] / effect, 0.0) / np.where(told, weight, 1.0)
    weight = np.where(told, weight, 0.0)
    lines = (_through(one, measured, weight, period_s) for one in hypotheses(system, view, ("late",)))
    return min((line for line in lines if line is not None), key=lambda line: line.cost, default=None)


def _through(one: Hypothesis, measured: np.ndarray, weight: np.ndarray, period_s: float) -> Line | None:
    """The line of a kind that fits best, None where none of its kind is to be had."""
    profiles = np.stack([unknown.profile for unknown in one.unknowns], axis=1)
    if not (weight @ np.square(profiles)).all():
        # Nothing was measured of it.
        return None
    values, inverse = _fitted(profiles, measured, weight)
    if one.kind == "dropped":
        step = period_s * np.round(values[-1] / period_s)
        if step == 0.0:
            return None
        rest = _fitted(profiles[:, :-1], measured - step * profiles[:, -1], weight)[0] if len(values) > 1 else ()
        values = np.array([*rest, step])
    late_s = profiles @ values
    cost = float((weight * np.square(measured - late_s)).sum()) + one.penalty
    return Line(one, values, np.sqrt(np.maximum(np.diag(inverse), 0.0)), late_s, cost)


def _fitted(profiles: np.ndarray, measured: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    normal = profiles.T @ (profiles * weight[:, None])
    inverse = np.linalg.inv(normal + 1e-12 * np.trace(normal) * np.eye(len(normal)))
    return inverse @ (profiles.T @ (weight * measured)), inverse


def same_line(a: Hypothesis, b: Hypothesis) -> bool:
    """Whether two hypotheses about one clock are the same."""
    return (a.kind, a.since, len(a.unknowns)) == (b.kind, b.since, len(b.unknowns))


def late_by(hypothesis: Hypothesis, values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Shape (block,): how late a view is, s."""
    return np.stack([unknown.profile for unknown in hypothesis.unknowns], axis=1) @ np.asarray(values)
