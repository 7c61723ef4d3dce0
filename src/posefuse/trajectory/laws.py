"""What the solve learns of a recording first: how lively keypoints are, how stiff bones, how lasting errors."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import Rebuilt, frozen
from posefuse.errors import DetectionsError
from posefuse.model.skeletons import Skeleton
from posefuse.model.status import ViewStatus
from posefuse.model.trajectory_options import TrajectoryOptions
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.observed import Measured, Observed
from posefuse.trajectory.paths import Law, Paths, Solver
from posefuse.trajectory.smoothness import ORDERS, Smoothness, density_lasting, lasting_s

_ROUNDS = 8
"""Each round but the first finds the density from the paths it was solved with."""

_SHORT_STEPS, _MOST_CHANGE = 3.0, 30.0
_FEWEST_LENGTHS = 20
_LEAST_CORRELATION = 0.1
_MARGIN = 12.0
"""Time constants after which what came before has been forgotten, to less than a hundredth of the uncertainty."""

_SHORTEST_MARGIN_S = 0.25


@dataclass(frozen=True, eq=False)
class Laws(Rebuilt):
    """What holds for a whole recording.

    Attributes:
        density: shape (person, keypoint): of the white jerk (m^2/s^5) or acceleration (m^2/s^3); NaN where unknown.
        length_m: shape (person, bone): bones as :class:`Bones` has them; NaN where unknown.
        length_sd_m: shape (person, bone): how much each differs from its length over time.
        correlation_s: how long detection errors last, the time in which their correlation falls to 1 / e; 0 if white.
        size_m: shape (person,): the distance between the keypoints farthest apart, as it usually is; NaN if unknown.
        lasting_s: shape (person, keypoint): the smoother's time constant.
        max_gap_s: longer ones divide a path.
    """

    density: np.ndarray
    length_m: np.ndarray
    length_sd_m: np.ndarray
    correlation_s: float
    size_m: np.ndarray
    lasting_s: np.ndarray
    max_gap_s: float

    def __post_init__(self) -> None:
        for name in ("density", "length_m", "length_sd_m", "size_m", "lasting_s"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def of(self, person: int, spread: float) -> Law:
        """One person's."""
        return Law(self.density[person], self.length_m[person], self.length_sd_m[person], self.correlation_s, spread)


def margin_s(laws: Laws) -> float:
    """How many seconds beyond the wanted frames a caller must add for nothing to show where ranges meet."""
    known = laws.lasting_s[np.isfinite(laws.lasting_s)]
    longest = float(known.max()) if known.size else 0.0
    return laws.max_gap_s + max(_MARGIN * longest, _SHORTEST_MARGIN_S)


def learn(parts: Iterable[Measured], skeleton: Skeleton, options: TrajectoryOptions) -> Laws:
    """What holds for a recording, from ranges of its frames, one after the other.

    Densities are those of maximum marginal likelihood for linear measurements (MacKay, "Bayesian interpolation", 1992);
    bones' lengths are those of paths solved without bones.

    Args:
        parts: ranges of frames as measured; a sample of a long recording is enough.
        skeleton: of the keypoints.
        options: of the solve.

    Raises:
        DetectionsError: if there is no part.
    """
    bones, errors, sums = Bones.of(skeleton), _Errors(), None
    for part in parts:
        errors.add(part)
        people = part.tracks.detection.shape[1]
        sums = sums or [_Sums(len(skeleton), len(bones.ends)) for _ in range(people)]
        correlation_s = errors.correlation_s() if options.correlation_s is None else options.correlation_s
        for person in range(people):
            sums[person].add(Observed.of(part, person), bones, options, correlation_s, part.noise.spread)
    if sums is None:
        raise DetectionsError("The trajectory solve was given no frames to learn from.")
    lengths = [each.lengths(options) for each in sums]
    return Laws(
        density=np.stack([each.density(options) for each in sums]),
        length_m=np.stack([length for length, _ in lengths]),
        length_sd_m=np.stack([sd for _, sd in lengths]),
        correlation_s=errors.correlation_s() if options.correlation_s is None else options.correlation_s,
        size_m=np.array([each.size_m for each in sums]),
        lasting_s=np.stack([each.lasting_s(options) for each in sums]),
        max_gap_s=options.max_gap_s,
    )


class _Errors:
    """How alike a view's errors are from one frame to the next, summed over parts.

    Residuals of measured points, in units of their noise, leave out what the point took up; where the same views see a
    point twice in about the same place, both leave out the same, and the ratio of their products to their squares is
    the correlation of the errors.
    """

    def __init__(self) -> None:
        self._products = 0.0
        self._squares = 0.0
        self._step_s = 0.0

    def add(self, part: Measured) -> None:
        """A part more."""
        for person in range(part.tracks.detection.shape[1]):
            observed = Observed.of(part, person)
            used = observed.agreed & np.isfinite(observed.sigma_px)
            residuals, _ = observed.linear(np.where(np.isfinite(observed.points_m), observed.points_m, 0.0))
            off = np.where(used[..., None], residuals / observed.sigma_px[..., None], 0.0)
            # Two views leave one number of four, three leave three of six: alike only if the same views are used.
            same = (used[:, 1:] == used[:, :-1]).all(axis=-1) & (used[:, 1:].sum(axis=-1) > 1)
            now, before = off[:, 1:][same], off[:, :-1][same]
            self._products += float((now * before).sum())
            self._squares += 0.5 * float(np.square(now).sum() + np.square(before).sum())
            self._step_s = observed.step_s

    def correlation_s(self) -> float:
        """The time in which the correlation falls to 1 / e, by that of neighbouring frames."""
        if not self._squares > 0.0:
            return 0.0
        kept = min(self._products / self._squares, 0.999)
        return -self._step_s / float(np.log(kept)) if kept > _LEAST_CORRELATION else 0.0


class _Sums:
    """What parts tell of one person."""

    def __init__(self, keypoints: int, n_bones: int) -> None:
        self._weighted = np.zeros(keypoints)
        self._known = np.zeros(keypoints)
        self._lasting = np.zeros(keypoints)
        self._count = np.zeros(n_bones)
        self._length = np.zeros(n_bones)
        self._square = np.zeros(n_bones)
        self._noise = np.zeros(n_bones)
        self._sizes: list[float] = []

    def add(
        self, observed: Observed, bones: Bones, options: TrajectoryOptions, correlation_s: float, spread: float
    ) -> None:
        """A part more."""
        smoothness = Smoothness.of(options.prior, observed.time_s)
        alone = Bones(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2), dtype=np.int64))
        solver = Solver(observed, smoothness, alone, replace(options, burst_s=0.0))
        paths, density, known = fit_density(solver, correlation_s, spread)
        told = np.where(np.isfinite(density), known, 0.0)
        self._known += told
        self._weighted += np.where(told > 0.0, told * density, 0.0)
        lasting = lasting_s(observed.step_s, paths.variance_m2, density, smoothness.order)
        self._lasting += np.where(told > 0.0, told * lasting, 0.0)
        self._add_lengths(paths, bones)
        self._add_size(paths)

    def _add_lengths(self, paths: Paths, bones: Bones) -> None:
        one, other = bones.ends.T
        seen = paths.weights.sum(axis=-1) > 1.5
        there = seen[one] & seen[other]
        along = paths.paths_m[one] - paths.paths_m[other]
        length = np.linalg.norm(along, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            unit = along / length[..., None]
        both = paths.covariance_m2[one] + paths.covariance_m2[other]
        noise = np.einsum("bfi,bfij,bfj->bf", unit, both, unit)
        across = np.trace(both, axis1=-2, axis2=-1) - noise
        # Noise across a bone makes it look longer.
        length = length - 0.5 * across / length
        there &= np.isfinite(length)
        self._count += there.sum(axis=1)
        for total, values in ((self._length, length), (self._square, np.square(length)), (self._noise, noise)):
            total += np.where(there, values, 0.0).sum(axis=1)

    def _add_size(self, paths: Paths) -> None:
        seen = paths.weights.any(axis=-1)
        points = np.where(seen[..., None], paths.paths_m, np.nan)
        with np.errstate(invalid="ignore"):
            low, high = np.fmin.reduce(points, axis=0), np.fmax.reduce(points, axis=0)
        extent = np.linalg.norm(high - low, axis=-1)
        extent = extent[seen.sum(axis=0) > 0.5 * len(seen)]
        if extent.size:
            self._sizes.append(float(np.median(extent)))

    def density(self, options: TrajectoryOptions) -> np.ndarray:
        """Shape (keypoint,); of keypoints that told nothing, that of the others."""
        if options.density is not None:
            return np.full(len(self._known), options.density)
        return _filled(self._weighted, self._known)

    def lasting_s(self, options: TrajectoryOptions) -> np.ndarray:
        """Shape (keypoint,)."""
        return _filled(self._lasting, self._known)

    def lengths(self, options: TrajectoryOptions) -> tuple[np.ndarray, np.ndarray]:
        """Lengths, and how much they differ from themselves; NaN and inf where too few frames tell."""
        tells = self._count >= _FEWEST_LENGTHS
        count = np.maximum(self._count, 1.0)
        mean = self._length / count
        variance = self._square / count - mean**2 - self._noise / count
        sd = np.sqrt(np.maximum(variance, (options.least_bone_share * mean) ** 2))
        tells &= options.bones & (mean > 0.0)
        return np.where(tells, mean, np.nan), np.where(tells, sd, np.inf)

    @property
    def size_m(self) -> float:
        """NaN where no part told."""
        return float(np.median(self._sizes)) if self._sizes else np.nan


def _filled(weighted: np.ndarray, known: np.ndarray) -> np.ndarray:
    told = known > 0.0
    if not told.any():
        return np.full(len(known), np.nan)
    mean = weighted / np.maximum(known, 1e-300)
    return np.where(told, mean, np.exp(np.log(mean[told]).mean()))


def fit_density(solver: Solver, correlation_s: float, spread: float) -> tuple[Paths, np.ndarray, np.ndarray]:
    """Paths solved without bones, the density of each keypoint, and how many numbers told of it."""
    observed, order = solver.observed, ORDERS[solver.options.prior]
    paths = Paths.begin(observed, solver.smoothness, solver.options)
    keypoints = len(paths.paths_m)
    nothing = np.empty(0)
    variance = solver.first_variance(paths, spread)
    density = density_lasting(observed.step_s, variance, _SHORT_STEPS * observed.step_s, order)
    known = np.zeros(keypoints)
    for number in range(_ROUNDS):
        law = Law(np.where(np.isfinite(density), density, 1.0), nothing, nothing, correlation_s, spread)
        paths = solver.round(paths, law, trusting=number < _ROUNDS // 2)
        known = paths.known.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            change = paths.squares.sum(axis=1) / known
        density = density * np.clip(np.where(known > 0.0, change, 1.0), 1.0 / _MOST_CHANGE, _MOST_CHANGE)
    return paths, density, known
