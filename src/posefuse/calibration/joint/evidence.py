"""Compare explanations of a joint estimate: which of the poses and clocks are wrong.

The estimate and its covariance are the data. An explanation is a set of changes with a normal prior; its evidence is
the probability density of the estimate under it. Explanations are added one by one, the best first, and each is
compared with all that could replace it. A calibration is never exact and a detector never unbiased, so every
explanation allows small changes of all poses.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from posefuse.calibration.joint.estimate import JointEstimate
from posefuse.kernels.calibration.joint import VIEW_PARAMETERS

Kind = Literal["offset", "drift", "rate", "rotation", "pose"]

POSE_KINDS: tuple[Kind, ...] = ("rotation", "pose")
CLOCK_KINDS: tuple[Kind, ...] = ("offset", "drift", "rate")
RATE_ERRORS = (1000.0 / 1001.0 - 1.0, 1001.0 / 1000.0 - 1.0)
"""Relative errors of a frame rate of 30 instead of 29.97 Hz, or 60 instead of 59.94 Hz, and the reverse."""
DRIFT_SD = 5e-5
"""Standard deviation of the drift of a camera's clock: crystals are accurate to some 50 parts per million."""
_ACCURACY = np.array([np.radians(0.05)] * 3 + [0.003] * 3 + [3e-3, 1e-6])
_SIZES: dict[Kind, tuple[float, ...]] = {
    "offset": (0.02, 0.1, 0.5),
    "drift": (1.0, 4.0),
    "rate": (1.0,),
    "rotation": (1.0, 4.0),
    "pose": (1.0, 4.0),
}
_ROTATION_SD, _CENTER_SD = np.radians(1.0), 0.04
_DOF = 30.0
_TWO = 2
DECISIVE = 3.0
"""Gain in log evidence that an explanation needs, beside the prior odds against it."""
EQUAL = 3.0
"""Explanations whose log likelihood differs by less fit equally well."""
_PRIOR_ODDS = {"offset": 3.0, "drift": 5.0, "rate": 5.0, "rotation": 3.0, "pose": 4.0}


@dataclass(frozen=True)
class Explanation:
    """One wrong pose or clock.

    Attributes:
        kind: what is wrong.
        view: index of the view.
        size: typical size, as a multiple of the unit of the kind.
        rate_error: relative error of the frame rate; 0 for other kinds.
    """

    kind: Kind
    view: int
    size: float
    rate_error: float = 0.0

    def columns(self, n_views: int) -> np.ndarray:
        """Return the prior of the changes as a matrix whose square is their covariance, shape (parameter, k)."""
        sd = np.zeros((n_views, VIEW_PARAMETERS))
        if self.kind == "offset":
            sd[self.view, 6] = self.size
        elif self.kind == "drift":
            sd[self.view, 7] = DRIFT_SD * self.size
        elif self.kind in POSE_KINDS:
            sd[self.view, :3] = _ROTATION_SD * self.size
            if self.kind == "pose":
                sd[self.view, 3:6] = _CENTER_SD * self.size
        columns = np.diag(sd.ravel())
        return columns[:, columns.any(axis=0)]

    def mean(self, n_views: int) -> np.ndarray:
        """Return the expected changes, shape (parameter,)."""
        out = np.zeros((n_views, VIEW_PARAMETERS))
        out[self.view, 7] = self.rate_error
        return out.ravel()

    def same_as(self, other: "Explanation") -> bool:
        """Return whether two explanations name the same fault of the same view."""
        poses = self.kind in POSE_KINDS and other.kind in POSE_KINDS
        clocks = self.kind in ("drift", "rate") and other.kind in ("drift", "rate")
        return self.view == other.view and (self.kind == other.kind or poses or clocks)


@dataclass(frozen=True, eq=False)
class Choice:
    """An accepted explanation.

    Attributes:
        explanation: the best one.
        gain: gain in log evidence over the others that are accepted, less the prior odds.
        rivals: different explanations that fit equally well in its place.
    """

    explanation: Explanation
    gain: float
    rivals: tuple[Explanation, ...]


class Comparison:
    """Compute the evidence of sets of explanations for one estimate."""

    def __init__(self, estimate: JointEstimate) -> None:
        """Prepare the covariance of the estimate in the directions that the data determine."""
        self.n_views = self._n = len(estimate.names)
        self._basis = estimate.basis
        self._projection = estimate.basis.T @ estimate.projection
        self._measured = self._basis.T @ estimate.change.ravel()
        accuracy = np.tile(_ACCURACY**2, self._n)
        base = estimate.projection @ (accuracy[:, None] * estimate.projection.T)
        self._covariance = self._basis.T @ (estimate.covariance + base) @ self._basis

    def log_evidence(self, explanations: tuple[Explanation, ...]) -> float:
        """Return the logarithm of the density of the estimate under some explanations."""
        covariance, expected = self._prior(explanations)
        whole = self._covariance + covariance
        remainder = self._measured - expected
        lower = np.linalg.cholesky(whole)
        squared = float(np.square(np.linalg.solve(lower, remainder)).sum())
        # The variances are estimates: Student's t distribution instead of the normal one.
        size = len(remainder)
        return -float(np.log(np.diag(lower)).sum()) - 0.5 * (_DOF + size) * float(np.log1p(squared / _DOF))

    def misfit(self, explanations: tuple[Explanation, ...]) -> float:
        """Return the squared distance of the estimate from the best changes of some explanations."""
        change, _ = self.posterior(explanations)
        remainder = self._measured - self._projection @ change.ravel()
        return float(remainder @ np.linalg.solve(self._covariance, remainder))

    def posterior(self, explanations: tuple[Explanation, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return the changes under some explanations, shape (view, parameter), and their covariance."""
        columns = [e.columns(self._n) for e in explanations]
        free = np.concatenate(columns, axis=1) if columns else np.zeros((self._n * VIEW_PARAMETERS, 0))
        mean = sum((e.mean(self._n) for e in explanations), np.zeros(self._n * VIEW_PARAMETERS))
        inside = self._projection @ free
        precision = inside.T @ np.linalg.solve(self._covariance, inside) + np.eye(free.shape[1])
        remainder = self._measured - self._projection @ mean
        inverse = np.linalg.inv(precision)
        change = mean + free @ (inverse @ (inside.T @ np.linalg.solve(self._covariance, remainder)))
        return change.reshape(self._n, VIEW_PARAMETERS), free @ inverse @ free.T

    def _prior(self, explanations: tuple[Explanation, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return covariance and mean of the estimate that explanations predict."""
        size = len(self._measured)
        covariance, mean = np.zeros((size, size)), np.zeros(size)
        for explanation in explanations:
            inside = self._projection @ explanation.columns(self._n)
            covariance += inside @ inside.T
            mean += self._projection @ explanation.mean(self._n)
        return covariance, mean


def candidates(pose_views: Collection[int], clock_views: Collection[int]) -> tuple[Explanation, ...]:
    """Return all explanations of one view each, of the poses and clocks of some views."""
    out = [
        Explanation(kind, view, size)
        for view, kind in product(sorted({*pose_views, *clock_views}), ("offset", "drift", "rotation", "pose"))
        for size in _SIZES[kind]
        if view in (pose_views if kind in POSE_KINDS else clock_views)
    ]
    out += [Explanation("rate", view, 1.0, error) for view, error in product(sorted(clock_views), RATE_ERRORS)]
    return tuple(out)


def choose(
    estimate: JointEstimate, pose_views: Collection[int], clock_views: Collection[int] | None = None
) -> tuple[Choice, ...]:
    """Return the accepted explanations, the first accepted first.

    Args:
        estimate: of all views.
        pose_views: views whose pose may be wrong.
        clock_views: views whose clock may be wrong; by default all.
    """
    comparison = Comparison(estimate)
    n = len(estimate.names)
    every = candidates(pose_views, range(n) if clock_views is None else clock_views)
    accepted: list[Choice] = []
    current = comparison.log_evidence(())
    for _ in range(2 * n):
        chosen = tuple(choice.explanation for choice in accepted)
        open_ = [e for e in every if not any(e.same_as(c) for c in chosen)]
        scored = [(comparison.log_evidence((*chosen, e)) - current - _PRIOR_ODDS[e.kind], e) for e in open_]
        if not scored:
            break
        gain, best = max(scored, key=lambda pair: pair[0])
        if gain < DECISIVE:
            break
        accepted.append(Choice(best, gain, _rivals(comparison, chosen, best, scored)))
        current = comparison.log_evidence((*chosen, best))
    return tuple(accepted)


def _rivals(
    comparison: Comparison,
    chosen: tuple[Explanation, ...],
    best: Explanation,
    scored: Sequence[tuple[float, Explanation]],
) -> tuple[Explanation, ...]:
    """Return other explanations that fit as well as the best and are better than none, the most plausible first."""
    limit = comparison.misfit((*chosen, best)) + 2.0 * EQUAL
    rivals: dict[tuple[int, bool, str], Explanation] = {}
    for gain, other in sorted(scored, key=lambda pair: -pair[0]):
        is_pose = other.kind in POSE_KINDS
        # Which of two clocks is wrong is a matter of the reference.
        mirrored = comparison.n_views == _TWO and other.kind == best.kind
        if gain > 0.0 and not other.same_as(best) and not mirrored and comparison.misfit((*chosen, other)) < limit:
            rivals.setdefault((other.view, is_pose, "" if is_pose else other.kind), other)
    return tuple(rivals.values())
