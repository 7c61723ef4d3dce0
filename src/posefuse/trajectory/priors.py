"""What the solve learns of a recording first: how lively keypoints are, how stiff bones, how lasting errors."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln, hyp2f1

from posefuse.arrays import PickledByFields, frozen
from posefuse.errors import DetectionsError
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.skeleton.skeletons import Skeleton
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.observed import Measured, Observed
from posefuse.trajectory.paths import Law, Paths, Solver
from posefuse.trajectory.smoothness import ORDERS, Smoothness, density_lasting, lasting_s

_ROUNDS = 8
"""Each round but the first finds the density from the paths it was solved with."""

_SHORT_STEPS, _MOST_CHANGE = 3.0, 30.0
_FEWEST_LENGTHS = 20
_LAGS = (1, 2, 4, 8, 16, 32, 64)
_LONGEST_S, _FAR_S = 2.0, 0.6
_MOST_LASTING = 0.95
_MUCH_LASTING = 0.2
"""Where more than this share of the errors lasts throughout, what correlations the rest has cannot be told."""

_LONGEST_MEMORY_S = 0.3
"""Errors that last longer cannot be told from slow motion: they do not make paths smoother, only less certain."""

_NONE = np.empty(0)
_SLOWEST_S, _SLOWEST_STEPS = 0.5, 4.0
"""No path is taken for so even that it remembers for longer."""

_LEAST_CORRELATION, _MOST_CORRELATION = 0.1, 0.999
_WHOLE = 0.9
"""Errors of changing size look no more correlated than this at no distance, although all of each of them lasts."""

_GENEROUS = 2.0
"""Motion is less even than white noise. So much more of it costs a hundredth of the accuracy where it is, and regions
hold what they say where it is not."""

_CORRELATIONS = np.linspace(-1.0, 1.0, 401)
_MARGIN = 12.0
"""Time constants after which what came before has been forgotten, to less than a hundredth of the uncertainty."""

_SHORTEST_MARGIN_S = 0.25


@dataclass(frozen=True, eq=False)
class Laws(PickledByFields):
    """What holds for a whole recording.

    Attributes:
        density: shape (person, keypoint): of the white jerk (m^2/s^5) or acceleration (m^2/s^3); NaN where unknown.
        length_m: shape (person, bone): bones as :class:`Bones` has them; NaN where unknown.
        length_sd_m: shape (person, bone): how much each differs from its length over time.
        correlation_s: how long detection errors last, the time in which their correlation falls to 1 / e; 0 if white.
        lasting_share: share of the errors' variance that lasts throughout, as errors of the calibration do.
        fresh: shape (person,): mean square of what is new in errors from frame to frame, over what is expected.
        steady: shape (person,): how steadily views err: as if so many numbers had shown that they err as usual.
        size_m: shape (person,): the distance between the keypoints farthest apart, as it usually is; NaN if unknown.
        lasting_s: shape (person, keypoint): the smoother's time constant.
        max_gap_s: longer ones divide a path.
        roughness_m2: shape (person, keypoint): variance of what the motion is beside its paths; NaN where every range
            of frames that is solved tells it of itself, as it may where there is but one.
    """

    density: np.ndarray
    length_m: np.ndarray
    length_sd_m: np.ndarray
    correlation_s: float
    lasting_share: float
    fresh: np.ndarray
    steady: np.ndarray
    size_m: np.ndarray
    lasting_s: np.ndarray
    max_gap_s: float
    roughness_m2: np.ndarray

    def __post_init__(self) -> None:
        for name in ("density", "length_m", "length_sd_m", "fresh", "steady", "size_m", "lasting_s", "roughness_m2"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def of(self, person: int, spread: float) -> Law:
        """One person's."""
        rough = self.roughness_m2[person]
        return Law(
            self.density[person],
            self.length_m[person],
            self.length_sd_m[person],
            self.correlation_s,
            passing_spread(spread, self.lasting_share),
            float(self.fresh[person]),
            float(self.steady[person]),
            lasting_ratio(self.lasting_share),
            None if np.isnan(rough).any() else rough,
        )


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
    bones = Bones.of(skeleton)
    sums: list[_Sums] = []
    errors = None
    for part in parts:
        people = [Observed.of(part, person) for person in range(part.tracks.detection.shape[1])]
        sums = sums or [_Sums(len(skeleton), len(bones.ends)) for _ in people]
        errors = errors or _Errors(len(part.rig))
        for observed in people:
            errors.add(observed)
        correlation_s, share = errors.law(options)
        spread = passing_spread(part.noise.spread, share)
        law = Law(_NONE, _NONE, _NONE, correlation_s, spread, lasting=lasting_ratio(share))
        for own, observed in zip(sums, people, strict=True):
            own.add(observed, bones, options, law)
    if errors is None:
        raise DetectionsError("The trajectory solve was given no frames to learn from.")
    lengths = [each.lengths(bones.rigid, options) for each in sums]
    correlation_s, share = errors.law(options)
    return Laws(
        density=np.stack([each.density(options) for each in sums]),
        length_m=np.stack([length for length, _ in lengths]),
        length_sd_m=np.stack([sd for _, sd in lengths]),
        correlation_s=correlation_s,
        lasting_share=share,
        fresh=np.array([each.errors[0] for each in sums]),
        steady=np.array([each.errors[1] for each in sums]),
        size_m=np.array([each.size_m for each in sums]),
        lasting_s=np.stack([each.lasting_s(options) for each in sums]),
        max_gap_s=options.max_gap_s,
        roughness_m2=np.full((len(sums), len(skeleton)), np.nan),
    )


def passing_spread(spread: float, lasting_share: float) -> float:
    """Of errors that pass: what does not move is no noise that motion must be told from."""
    return spread * float(np.sqrt(1.0 - lasting_share))


def lasting_ratio(lasting_share: float) -> float:
    """The variance of errors that last throughout over that of errors that pass."""
    return lasting_share / (1.0 - lasting_share)


class _Errors:
    """How alike errors are some frames apart, summed over parts.

    Told by the angle between the residuals of a measured point, over all its views, and those of the same keypoint some
    frames later: of which size errors are, and whether that lasts, does not matter. Residuals leave out what the point
    took up; where the same views see it twice in about the same place, both leave out the same.
    """

    def __init__(self, views: int) -> None:
        self._cosines = np.zeros((len(_LAGS), 2 * views))
        self._counts = np.zeros((len(_LAGS), 2 * views))
        self._step_s = 1.0

    def add(self, observed: Observed) -> None:
        """A person's part more."""
        self._step_s = observed.step_s
        used = observed.agreed & np.isfinite(observed.sigma_px)
        residuals, _ = observed.linear(np.where(np.isfinite(observed.points_m), observed.points_m, 0.0))
        off = np.where(used[..., None], residuals / observed.sigma_px[..., None], 0.0)
        size = np.sqrt(np.square(off).sum(axis=(2, 3)))
        freedom = np.maximum(2 * used.sum(axis=-1) - 3, 0)
        for n, lag in enumerate(_LAGS):
            if lag * self._step_s > _LONGEST_S or lag >= used.shape[1] // 2:
                break
            same = (used[:, lag:] == used[:, :-lag]).all(axis=-1) & (freedom[:, lag:] > 0)
            both = size[:, lag:] * size[:, :-lag]
            same &= both > 0.0
            cosine = (off[:, lag:] * off[:, :-lag]).sum(axis=(2, 3))[same] / both[same]
            self._cosines[n] += np.bincount(freedom[:, lag:][same], cosine, self._cosines.shape[1])
            self._counts[n] += np.bincount(freedom[:, lag:][same], minlength=self._counts.shape[1])

    def correlations(self) -> np.ndarray:
        """Shape (lag,): the correlation of errors so many frames apart; NaN where nothing tells."""
        found = np.zeros(len(_LAGS))
        for freedom in np.flatnonzero(self._counts.any(axis=0)):
            count = self._counts[:, freedom]
            mean = np.divide(self._cosines[:, freedom], count, out=np.zeros(len(_LAGS)), where=count > 0.0)
            found += count * np.interp(mean, mean_cosine(_CORRELATIONS, int(freedom)), _CORRELATIONS)
        total = self._counts.sum(axis=1)
        return np.divide(found, total, out=np.full(len(_LAGS), np.nan), where=total > 0.0)

    def law(self, options: TrajectoryOptions) -> tuple[float, float]:
        """How long errors last, s, and the share of their variance that lasts throughout."""
        found = self.correlations()
        far = found[np.array(_LAGS) * self._step_s > _FAR_S]
        far = far[np.isfinite(far)]
        share = float(np.clip(far.mean(), 0.0, _MOST_LASTING)) if far.size else 0.0
        share = share if share > _LEAST_CORRELATION else 0.0
        if options.correlation_s is not None:
            return options.correlation_s, share
        if share > _MUCH_LASTING:
            return 0.0, share
        return min(self._correlation_s((found - share) / (1.0 - share)), _LONGEST_MEMORY_S), share

    def _correlation_s(self, found: np.ndarray) -> float:
        """The time in which correlations fall to 1 / e, if errors were an autoregression of the first order.

        A share of them that falls exponentially is fitted to the correlations; the autoregression is the one that is as
        strong at low frequencies, where it tells from motion.
        """
        told = int(np.argmin(np.append(found > _LEAST_CORRELATION, False)))
        if told == 0:
            return 0.0
        lags, logs = np.array(_LAGS[:told], dtype=np.float64), np.log(np.minimum(found[:told], _MOST_CORRELATION))
        slope, level = np.polyfit(lags, logs, 1) if told > 1 else (logs[0], 0.0)
        kept, share = float(np.exp(min(slope, np.log(_MOST_CORRELATION)))), float(min(np.exp(level) / _WHOLE, 1.0))
        both_ways = 1.0 + 2.0 * share * kept / (1.0 - kept)
        return -self._step_s / float(np.log((both_ways - 1.0) / (both_ways + 1.0)))


def mean_cosine(correlation: np.ndarray, freedom: int) -> np.ndarray:
    """Of the angle between two normal vectors of so many independent numbers, each number correlated so much."""
    half = 0.5 * freedom
    level = np.exp(2.0 * gammaln(half + 0.5) - gammaln(half) - gammaln(half + 1.0))
    return correlation * level * hyp2f1(0.5, 0.5, half + 1.0, np.square(correlation))


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
        self._errors: list[tuple[float, float]] = []

    def add(self, observed: Observed, bones: Bones, options: TrajectoryOptions, law: Law) -> None:
        """A part more."""
        smoothness = Smoothness.of(options.prior, observed.time_s)
        solver = Solver(observed, smoothness, Bones.none(), replace(options, density_window_s=0.0))
        paths, density, known, errors = fit_density(solver, law)
        if law.correlation_s > 0.0:
            # What lasts may be motion or error. Taken for motion it costs little, taken for error the motion is gone.
            density = np.fmax(density, fit_density(solver, replace(law, correlation_s=0.0))[1])
        self._errors.append(errors)
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
        seen = np.asarray(paths.weights.any(axis=-1))
        points = np.where(seen[..., None], paths.paths_m, np.nan)
        with np.errstate(invalid="ignore"):
            low, high = np.fmin.reduce(points, axis=0), np.fmax.reduce(points, axis=0)
        extent = np.linalg.norm(high - low, axis=-1)
        extent = extent[seen.sum(axis=0) > 0.5 * len(seen)]
        if extent.size and np.median(extent) > 0.0:
            self._sizes.append(float(np.median(extent)))

    @property
    def errors(self) -> tuple[float, float]:
        """How large new errors are, and how steadily."""
        return float(np.mean([fresh for fresh, _ in self._errors])), float(
            np.median([each for _, each in self._errors])
        )

    def density(self, options: TrajectoryOptions) -> np.ndarray:
        """Shape (keypoint,); of keypoints that told nothing, that of the others."""
        if options.density is not None:
            return np.full(len(self._known), options.density)
        return _GENEROUS * _filled(self._weighted, self._known)

    def lasting_s(self, options: TrajectoryOptions) -> np.ndarray:
        """Shape (keypoint,)."""
        return _filled(self._lasting, self._known)

    def lengths(self, rigid: np.ndarray, options: TrajectoryOptions) -> tuple[np.ndarray, np.ndarray]:
        """Lengths, and how much they differ from themselves; NaN and inf where too few frames tell.

        Args:
            rigid: shape (bone,), bool: what such a bone seems to vary by beyond reason is error.
            options: of the solve.
        """
        tells = self._count >= _FEWEST_LENGTHS
        count = np.maximum(self._count, 1.0)
        mean = self._length / count
        variance = self._square / count - mean**2 - self._noise / count
        most = np.where(rigid, options.max_rigid_bone_variation * mean, np.inf)
        sd = np.clip(np.sqrt(np.maximum(variance, 0.0)), options.min_bone_variation * mean, most)
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


def fit_density(solver: Solver, law: Law) -> tuple[Paths, np.ndarray, np.ndarray, tuple[float, float]]:
    """Paths solved without bones, the density of each keypoint, how many numbers told of it, and how errors vary.

    Args:
        solver: of a part, without bones.
        law: of its errors; the rest of it does not count.
    """
    observed, order = solver.observed, ORDERS[solver.options.prior]
    step_s = observed.step_s
    paths = Paths.begin(observed, solver.smoothness, solver.options)
    density = density_lasting(step_s, solver.first_variance(paths, law), _SHORT_STEPS * step_s, order)
    known = np.zeros(len(density))
    fresh, steady = solver.steadiness(law)
    law = replace(law, fresh=fresh, steady=steady)
    scale = solver.scale(law)
    slowest = max(_SLOWEST_S, _SLOWEST_STEPS * step_s)
    for number in range(_ROUNDS):
        law = replace(law, density=np.where(np.isfinite(density), density, 1.0))
        paths = solver.round(paths, law, scale, trusting=number < _ROUNDS // 2)
        known = paths.known.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            change = paths.squares.sum(axis=1) / known
        density = density * np.clip(np.where(known > 0.0, change, 1.0), 1.0 / _MOST_CHANGE, _MOST_CHANGE)
        density = np.maximum(density, density_lasting(step_s, paths.variance_m2, slowest, order))
    return paths, density, known, (fresh, steady)
