"""Compare explanations of a joint estimate: which of the poses and clocks are wrong.

What the keypoints alone tell about the changes of poses and clocks is the data. An explanation is a set of changes with
a normal prior; its evidence is the probability density of the data under it. Explanations are added one by one, the
best first, and each is compared with all that could replace it.

A calibration is never exact, a detector never unbiased, and cameras without a common trigger never expose at the same
time. How large these errors are differs between recordings by a factor of 10 to 50. Every set of explanations is
therefore combined with several levels of such errors of all cameras, equally probable beforehand (a hierarchical
prior): one camera is wrong only if it stands out from the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from posefuse.calibration.joint.estimate import JointEstimate
from posefuse.calibration.joint.extent import PoseUnits
from posefuse.kernels.calibration.joint import VIEW_PARAMETERS

Kind = Literal["offset", "drift", "rate", "rotation", "shift", "pose"]

POSE_KINDS: tuple[Kind, ...] = ("rotation", "shift", "pose")
CLOCK_KINDS: tuple[Kind, ...] = ("offset", "drift", "rate")
RATE_ERRORS = (1000.0 / 1001.0 - 1.0, 1001.0 / 1000.0 - 1.0)
"""Relative errors of a frame rate of 30 instead of 29.97 Hz, or 60 instead of 59.94 Hz, and the reverse."""
DRIFT_SD = 5e-5
"""Standard deviation of the drift of a camera's clock: crystals are accurate to some 50 parts per million."""
POSE_LEVELS = (0.02, 0.05, 0.15, 0.5, 1.0)
"""Usual errors of all poses, in units of :class:`PoseUnits`: from a calibration with a board to one in which the
detector's joints are not those of the lab's."""
OFFSET_LEVELS_S = (1e-3, 3e-3, 1e-2)
"""Usual errors of all clocks: from a common trigger to none, with frames up to half a period of 30 Hz apart."""
_DRIFT_ACCURACY = 1e-6
_SIZES: dict[Kind, tuple[float, ...]] = {
    "offset": (0.02, 0.1, 0.5),
    "drift": (1.0, 4.0),
    "rate": (1.0,),
    "rotation": (0.3, 1.0, 4.0),
    "shift": (0.3, 1.0),
    "pose": (0.3, 1.0, 4.0),
}
_DOF = 30.0
_TWO = 2
_RANK = 1e-12
DECISIVE = 3.0
"""Log of the odds that an explanation needs: of 21 reported ones, 1 may be wrong if the priors are right."""
_WORTH_A_PAIR, _MAX_FIRSTS = -2.5, 4
"""Log odds from which on an explanation may be one of two that hide each other, and how many are tried as the first."""
EQUAL = 3.0
"""Explanations whose log likelihood differs by less fit equally well."""
_PROBABILITY: dict[Kind, float] = {
    "offset": 0.05,
    "drift": 0.007,
    "rate": 0.007,
    "rotation": 0.05,
    "shift": 0.03,
    "pose": 0.02,
}
"""Share of all views of all recordings that have each fault, assumed before any data."""


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

    def columns(self, n_views: int, units: PoseUnits) -> np.ndarray:
        """Return the prior of the changes as a matrix whose square is their covariance, shape (parameter, k)."""
        sd = np.zeros((n_views, VIEW_PARAMETERS))
        if self.kind == "offset":
            sd[self.view, 6] = self.size
        elif self.kind == "drift":
            sd[self.view, 7] = DRIFT_SD * self.size
        if self.kind in ("rotation", "pose"):
            sd[self.view, :3] = units.rotation * self.size
        if self.kind in ("shift", "pose"):
            sd[self.view, 3:6] = units.center_m * self.size
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

    def __init__(self, estimate: JointEstimate, offset_levels_s: tuple[float, ...] = OFFSET_LEVELS_S) -> None:
        """Write the data as ``measured = root @ change + error`` with errors of unit variance.

        Args:
            estimate: of all views.
            offset_levels_s: usual errors of all clocks.
        """
        self.n_views = self._n = len(estimate.names)
        self._units = units = PoseUnits.of(estimate.rows)
        values, vectors = np.linalg.eigh(estimate.information)
        known = values > _RANK * max(float(values[-1]), 1e-300)
        roots, vectors = np.sqrt(values[known]), vectors[:, known]
        self._measured = (vectors.T @ estimate.evidence_score) / roots
        self._root = (roots[:, None] * vectors.T) @ (estimate.basis.T @ estimate.projection)
        self._usual = []
        for pose, offset_s in product(POSE_LEVELS, offset_levels_s):
            sd = [pose * units.rotation] * 3 + [pose * units.center_m] * 3 + [offset_s, _DRIFT_ACCURACY]
            columns = self._root * np.tile(sd, self._n)
            self._usual.append(columns @ columns.T)

    def log_evidence_of_each(
        self, explanations: tuple[Explanation, ...], others: Sequence[Explanation | None]
    ) -> np.ndarray:
        """Return the evidence of some explanations and one more each, shape (other,); None adds none."""
        each = self._at_levels(explanations, others)
        highest = each.max(axis=0)
        return highest + np.log(np.exp(each - highest).mean(axis=0))

    def misfit(self, explanations: tuple[Explanation, ...]) -> float:
        """Return the squared distance of the data from the best changes of some explanations."""
        change, _ = self.posterior(explanations)
        remainder = self._measured - self._root @ change.ravel()
        return float(remainder @ np.linalg.solve(self._usual_spread(explanations), remainder))

    def posterior(self, explanations: tuple[Explanation, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return the changes under some explanations, shape (view, parameter), and their covariance."""
        free, mean = self._prior(explanations)
        whole = self._usual_spread(explanations)
        inside = self._root @ free
        precision = inside.T @ np.linalg.solve(whole, inside) + np.eye(free.shape[1])
        inverse = np.linalg.inv(precision)
        remainder = self._measured - self._root @ mean
        change = mean + free @ (inverse @ (inside.T @ np.linalg.solve(whole, remainder)))
        return change.reshape(self._n, VIEW_PARAMETERS), free @ inverse @ free.T

    def _usual_spread(self, explanations: tuple[Explanation, ...]) -> np.ndarray:
        """Return the covariance of the data under the usual errors of the most likely level."""
        level = int(np.argmax(self._at_levels(explanations, (None,))[:, 0]))
        return np.eye(len(self._measured)) + self._usual[level]

    def _prior(self, explanations: Sequence[Explanation]) -> tuple[np.ndarray, np.ndarray]:
        """Return the prior of the changes: a matrix whose square is the covariance, and the mean."""
        size = self._n * VIEW_PARAMETERS
        columns = [e.columns(self._n, self._units) for e in explanations]
        mean = sum((e.mean(self._n) for e in explanations), np.zeros(size))
        return np.concatenate([np.zeros((size, 0)), *columns], axis=1), mean

    def _at_levels(self, explanations: tuple[Explanation, ...], others: Sequence[Explanation | None]) -> np.ndarray:
        """Return the evidence of some explanations and one more each at every level, shape (level, other)."""
        free, mean = self._prior(explanations)
        inside = self._root @ free
        more = [self._prior(() if other is None else (other,)) for other in others]
        out = np.empty((len(self._usual), len(others)))
        for row, usual in zip(out, self._usual, strict=True):
            lower = np.linalg.cholesky(np.eye(len(usual)) + usual + inside @ inside.T)
            whitened = np.linalg.solve(lower, np.column_stack([self._measured - self._root @ mean, self._root]))
            remainder, root = whitened[:, 0], whitened[:, 1:]
            density = -float(np.log(np.diag(lower)).sum())
            for k, (columns, shift) in enumerate(more):
                row[k] = density + _log_density(remainder - root @ shift, root @ columns)
        return out


def _log_density(remainder: np.ndarray, columns: np.ndarray) -> float:
    """Return the logarithm of Student's t density with the covariance ``1 + columns @ columns.T``, up to a constant.

    It is not the normal one, since the variances are estimates themselves.
    """
    lower = np.linalg.cholesky(np.eye(columns.shape[1]) + columns.T @ columns)
    explained = np.linalg.solve(lower, columns.T @ remainder)
    squared = max(float(remainder @ remainder - explained @ explained), 0.0)
    return -float(np.log(np.diag(lower)).sum()) - 0.5 * (_DOF + len(remainder)) * float(np.log1p(squared / _DOF))


def candidates(n_views: int) -> tuple[Explanation, ...]:
    """Return all explanations of one view each."""
    kinds: tuple[Kind, ...] = ("offset", "drift", "rotation", "shift", "pose")
    out = [Explanation(kind, view, size) for view, kind in product(range(n_views), kinds) for size in _SIZES[kind]]
    out += [Explanation("rate", view, 1.0, error) for view, error in product(range(n_views), RATE_ERRORS)]
    return tuple(out)


def choose(estimate: JointEstimate, given_poses: Sequence[int] = ()) -> tuple[Choice, ...]:
    """Return the accepted explanations, the first accepted first.

    Args:
        estimate: of all views.
        given_poses: views whose pose is not in question.
    """
    comparison = Comparison(estimate)
    every = [e for e in candidates(comparison.n_views) if e.kind not in POSE_KINDS or e.view not in given_poses]
    accepted: list[Choice] = []
    while len(accepted) < 2 * comparison.n_views:
        chosen = tuple(choice.explanation for choice in accepted)
        scored = _scored(comparison, chosen, every)
        if not scored or scored[0][0] < _WORTH_A_PAIR:
            break
        if scored[0][0] >= DECISIVE:
            gain, best = scored[0]
            accepted.append(Choice(best, gain, _rivals(comparison, chosen, best, scored)))
            continue
        pair = _best_pair(comparison, chosen, scored, every)
        if not pair:
            break
        accepted += pair
    return tuple(accepted)


def _scored(
    comparison: Comparison, chosen: tuple[Explanation, ...], every: Sequence[Explanation]
) -> list[tuple[float, Explanation]]:
    """Return the log odds of every further explanation, the best first."""
    others = [e for e in every if not any(e.same_as(c) for c in chosen)]
    gains = comparison.log_evidence_of_each(chosen, (None, *others))
    scored = [(float(g - gains[0] + np.log(_PROBABILITY[e.kind])), e) for g, e in zip(gains[1:], others, strict=True)]
    return sorted(scored, key=lambda pair: -pair[0])


def _best_pair(
    comparison: Comparison,
    chosen: tuple[Explanation, ...],
    scored: Sequence[tuple[float, Explanation]],
    every: Sequence[Explanation],
) -> list[Choice]:
    """Return the best two explanations together if they are decisive; each of two wrong cameras hides the other."""
    best: tuple[float, Explanation, list[tuple[float, Explanation]]] | None = None
    firsts: list[Explanation] = []
    for gain, first in scored:
        if gain < _WORTH_A_PAIR or len(firsts) == _MAX_FIRSTS:
            break
        if any(first.same_as(other) for other in firsts):
            continue
        firsts.append(first)
        seconds = _scored(comparison, (*chosen, first), every)
        if seconds and (best is None or gain + seconds[0][0] > best[0]):
            best = gain + seconds[0][0], first, seconds
    if best is None or best[0] < DECISIVE:
        return []
    _, first, seconds = best
    gain, second = seconds[0]
    others = _scored(comparison, (*chosen, second), every)
    gain_of_first = next(g for g, e in others if e == first)
    return [
        Choice(first, gain_of_first, _rivals(comparison, (*chosen, second), first, others)),
        Choice(second, gain, _rivals(comparison, (*chosen, first), second, seconds)),
    ]


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
