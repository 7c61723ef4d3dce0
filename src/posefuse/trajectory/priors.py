"""Priors estimated from a recording: densities of motion, bone lengths, and the correlation of detection errors."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import PickledByFields, frozen
from posefuse.errors import DetectionsError
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.skeleton.skeletons import Skeleton
from posefuse.trajectory.bone_lengths import LengthPrior
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.correlated_errors import ErrorCorrelation
from posefuse.trajectory.observations import MeasuredRange, PersonObservations
from posefuse.trajectory.path_solver import PathSolver
from posefuse.trajectory.paths import Paths, PersonPriors
from posefuse.trajectory.smoothness import ORDERS, Smoothness, density_for_time_constant, time_constant_s

_ROUNDS = 8
"""Each round after the first estimates the density from the paths of the previous one."""

_INITIAL_STEPS, _MAX_CHANGE = 3.0, 30.0
_MIN_LENGTHS = 5
_NONE = np.empty(0)
_MAX_TIME_CONSTANT_S, _MAX_TIME_CONSTANT_STEPS = 0.5, 4.0
"""Upper bound of the time constant of a path."""

_DENSITY_FACTOR = 2.0
"""Motion is less uniform than white noise. This factor on the density costs a hundredth of the accuracy where motion is
uniform, and keeps confidence regions valid where it is not.
"""

_MARGIN = 12.0
"""Number of time constants after which earlier frames affect a point by less than a hundredth of its uncertainty."""

_MIN_MARGIN_S = 0.25

_STANDARD_COUNT = 100.0
"""Number of values by which the variance of errors is pulled toward that of the noise model."""


@dataclass(frozen=True, eq=False)
class RecordingPriors(PickledByFields):
    """Priors of a whole recording.

    Attributes:
        density: shape (person, keypoint): of the white jerk (m^2/s^5) or acceleration (m^2/s^3); NaN where unknown.
        length_m: shape (person, bone): in the order of :class:`Bones`; NaN where unknown.
        length_sd_m: shape (person, bone): standard deviation of each length over time.
        correlation_s: correlation time of detection errors, in which their correlation falls to 1 / e; 0 if white.
        persistent_fraction: fraction of the error variance that persists throughout, like calibration errors.
        innovation_scale: shape (person,): mean square of the innovations of errors, in units of the expected value.
        scale_strength: shape (person,): strength of the prior that error levels are constant, as a sample size.
        size_m: shape (person,): typical distance between the outermost keypoints; NaN if unknown.
        time_constant_s: shape (person, keypoint): time constant of the smoother.
        max_gap_s: longer gaps divide a path.
        roughness_m2: shape (person, keypoint): variance of the motion around its paths; NaN if every range of frames
            estimates it separately, which is valid only if there is a single range.
        inflation: shape (person, keypoint): variance of white errors by which paths weight the views, relative to that
            of the errors; NaN if unknown.
        error_variance: shape (person,): variance of the errors relative to the noise model, its spread and their level.
        variance_m2: shape (person, keypoint): typical variance of a point from a single frame, as paths weight it; NaN
            where unknown.
    """

    density: np.ndarray
    length_m: np.ndarray
    length_sd_m: np.ndarray
    correlation_s: float
    persistent_fraction: float
    innovation_scale: np.ndarray
    scale_strength: np.ndarray
    size_m: np.ndarray
    time_constant_s: np.ndarray
    max_gap_s: float
    roughness_m2: np.ndarray
    inflation: np.ndarray
    error_variance: np.ndarray
    variance_m2: np.ndarray

    def __post_init__(self) -> None:
        names = ("density", "length_m", "length_sd_m", "innovation_scale", "scale_strength", "size_m")
        for name in (*names, "time_constant_s", "roughness_m2", "inflation", "error_variance", "variance_m2"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def of(self, person: int, spread: float) -> PersonPriors:
        """Return the priors of one person."""
        rough = self.roughness_m2[person]
        return PersonPriors(
            self.density[person],
            self.length_m[person],
            self.length_sd_m[person],
            self.correlation_s,
            non_persistent_spread(spread, self.persistent_fraction),
            float(self.innovation_scale[person]),
            float(self.scale_strength[person]),
            persistence_ratio(self.persistent_fraction),
            None if np.isnan(rough).any() else rough,
            np.where(np.isfinite(self.inflation[person]), self.inflation[person], 1.0),
            float(self.error_variance[person]),
            self.variance_m2[person],
        )


def margin_s(recording_priors: RecordingPriors) -> float:
    """Return how many seconds of context a range of frames needs so that adjacent ranges join without seams."""
    determined = recording_priors.time_constant_s[np.isfinite(recording_priors.time_constant_s)]
    longest = float(determined.max()) if determined.size else 0.0
    return recording_priors.max_gap_s + max(_MARGIN * longest, _MIN_MARGIN_S)


def estimate_priors(parts: Iterable[MeasuredRange], skeleton: Skeleton, options: TrajectoryOptions) -> RecordingPriors:
    """Estimate the priors of a recording from ranges of its frames, processed one after the other.

    Densities maximize the marginal likelihood for linear measurements (MacKay, "Bayesian interpolation", 1992); bone
    lengths come from paths solved without bones.

    Args:
        parts: ranges of measured frames; a sample of a long recording is sufficient.
        skeleton: of the keypoints.
        options: of the solve.

    Raises:
        DetectionsError: if there are no ranges.
    """
    bones = Bones.of(skeleton)
    sums: list[_PersonStatistics] = []
    errors = None
    for part in parts:
        people = [PersonObservations.of(part, person) for person in range(part.tracks.detection.shape[1])]
        sums = sums or [_PersonStatistics(len(skeleton), len(bones.ends)) for _ in people]
        errors = errors or ErrorCorrelation(len(part.rig))
        for observed in people:
            errors.add(observed)
        correlation_s, share = errors.estimate(options)
        spread = non_persistent_spread(part.noise.spread, share)
        person_priors = PersonPriors(
            _NONE, _NONE, _NONE, correlation_s, spread, persistent_ratio=persistence_ratio(share)
        )
        for statistics, observed in zip(sums, people, strict=True):
            if observed.has_points:
                statistics.add(observed, bones, options, person_priors)
    if errors is None:
        raise DetectionsError("The trajectory solve needs at least one frame to estimate its parameters.")
    correlation_s, share = errors.estimate(options)
    length_prior = LengthPrior.of(skeleton, bones)
    lengths = [each.lengths(bones.rigid, length_prior, correlation_s, options) for each in sums]
    return RecordingPriors(
        density=np.stack([each.density(options) for each in sums]),
        length_m=np.stack([length for length, _ in lengths]),
        length_sd_m=np.stack([sd for _, sd in lengths]),
        correlation_s=correlation_s,
        persistent_fraction=share,
        innovation_scale=np.array([each.errors[0] for each in sums]),
        scale_strength=np.array([each.errors[1] for each in sums]),
        size_m=np.array([each.size_m for each in sums]),
        time_constant_s=np.stack([each.time_constant_s(options) for each in sums]),
        max_gap_s=options.max_gap_s,
        roughness_m2=np.full((len(sums), len(skeleton)), np.nan),
        inflation=np.stack([each.inflation for each in sums]),
        error_variance=np.array([each.errors[2] for each in sums]),
        variance_m2=np.stack([each.variance_m2 for each in sums]),
    )


def non_persistent_spread(spread: float, persistent_fraction: float) -> float:
    """Return the factor of non-persistent errors: a constant error is not noise that motion is separated from."""
    return spread * float(np.sqrt(1.0 - persistent_fraction))


def persistence_ratio(persistent_fraction: float) -> float:
    """Return the variance of persistent errors over that of the others."""
    return persistent_fraction / (1.0 - persistent_fraction)


class _PersonStatistics:
    """Statistics of one person, accumulated over ranges of frames."""

    def __init__(self, keypoints: int, n_bones: int) -> None:
        self._weighted_density = np.zeros(keypoints)
        self._determined = np.zeros(keypoints)
        self._weighted_time_constant = np.zeros(keypoints)
        self._weighted_inflation = np.zeros(keypoints)
        self._weighted_variance = np.zeros(keypoints)
        self._count = np.zeros(n_bones)
        self._length = np.zeros(n_bones)
        self._square = np.zeros(n_bones)
        self._noise = np.zeros(n_bones)
        self._step_s = 1.0
        self._sizes: list[float] = []
        self._errors: list[tuple[float, float, float]] = []

    def add(
        self, observed: PersonObservations, bones: Bones, options: TrajectoryOptions, person_priors: PersonPriors
    ) -> None:
        """Add a range of frames."""
        self._step_s = observed.step_s
        smoothness = Smoothness.of(options.prior, observed.time_s)
        solver = PathSolver(
            observed, smoothness, Bones.none(observed.sigma_px.shape[0]), replace(options, density_window_s=0.0)
        )
        paths, density, determined, person_priors = fit_density(solver, person_priors)
        of_errors = person_priors.innovation_scale, person_priors.scale_strength, person_priors.error_variance
        self._errors.append(of_errors)
        information = np.where(np.isfinite(density), determined, 0.0)
        self._determined += information
        self._weighted_density += np.where(information > 0.0, information * density, 0.0)
        time_constant = time_constant_s(observed.step_s, paths.variance_m2, density, smoothness.order)
        self._weighted_time_constant += np.where(information > 0.0, information * time_constant, 0.0)
        inflation = person_priors.error_variance * solver.spectrum(person_priors).power(time_constant)
        self._weighted_inflation += np.where(information > 0.0, information * inflation, 0.0)
        self._weighted_variance += np.where(information > 0.0, information * paths.variance_m2, 0.0)
        self._add_lengths(paths, bones)
        self._add_size(paths)

    def _add_lengths(self, paths: Paths, bones: Bones) -> None:
        """Add the lengths of bones."""
        one, other = bones.ends.T
        seen = paths.weights.sum(axis=-1) > 1.5
        measured = seen[one] & seen[other]
        difference = paths.paths_m[one] - paths.paths_m[other]
        length = np.linalg.norm(difference, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            unit = difference / length[..., None]
        product = paths.covariance_m2[one] + paths.covariance_m2[other]
        noise = np.einsum("bfi,bfij,bfj->bf", unit, product, unit)
        across = np.trace(product, axis1=-2, axis2=-1) - noise
        # Noise perpendicular to a bone makes it appear longer.
        length = length - 0.5 * across / length
        measured &= np.isfinite(length)
        self._count += measured.sum(axis=1)
        for total, values in ((self._length, length), (self._square, np.square(length)), (self._noise, noise)):
            total += np.where(measured, values, 0.0).sum(axis=1)

    def _add_size(self, paths: Paths) -> None:
        """Add the size of the person."""
        seen = np.asarray(paths.weights.any(axis=-1))
        points = np.where(seen[..., None], paths.paths_m, np.nan)
        with np.errstate(invalid="ignore"):
            low, high = np.fmin.reduce(points, axis=0), np.fmax.reduce(points, axis=0)
        extent = np.linalg.norm(high - low, axis=-1)
        extent = extent[seen.sum(axis=0) > 0.5 * len(seen)]
        if extent.size and np.median(extent) > 0.0:
            self._sizes.append(float(np.median(extent)))

    @property
    def errors(self) -> tuple[float, float, float]:
        """Mean innovation scale, median scale strength, and mean variance of errors; 1 without data."""
        if not self._errors:
            return 1.0, 1.0, 1.0
        scales, strengths, variances = zip(*self._errors, strict=True)
        return float(np.mean(scales)), float(np.median(strengths)), float(np.mean(variances))

    def density(self, options: TrajectoryOptions) -> np.ndarray:
        """Return densities, shape (keypoint,); keypoints without data get the geometric mean of the others."""
        if options.density is not None:
            return np.full(len(self._determined), options.density)
        return _DENSITY_FACTOR * _filled(self._weighted_density, self._determined)

    def time_constant_s(self, options: TrajectoryOptions) -> np.ndarray:
        """Return time constants, shape (keypoint,)."""
        return _filled(self._weighted_time_constant, self._determined)

    @property
    def inflation(self) -> np.ndarray:
        """Inflation of the variances, shape (keypoint,)."""
        return _filled(self._weighted_inflation, self._determined)

    @property
    def variance_m2(self) -> np.ndarray:
        """Typical variance of a point from a single frame, as paths weight it, shape (keypoint,)."""
        return _filled(self._weighted_variance, self._determined)

    def lengths(
        self, rigid: np.ndarray, prior: LengthPrior, correlation_s: float, options: TrajectoryOptions
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return bone lengths and their standard deviations; NaN and inf with too few frames.

        Standard deviations are those of the length over time. Short recordings determine lengths poorly, because errors
        of successive frames are correlated; there the distribution of bodies contributes.

        Args:
            rigid: shape (bone,), bool: for these bones, variation beyond the given fraction counts as error.
            prior: distribution of the lengths.
            correlation_s: correlation time of detection errors.
            options: of the solve.
        """
        tells = self._count >= _MIN_LENGTHS
        count = np.maximum(self._count, 1.0)
        mean = self._length / count
        independent = np.maximum(count * self._step_s / (self._step_s + 2.0 * self._error_time_s(correlation_s)), 1.0)
        spread = self._square / count - mean**2
        # Variation that errors of so few independent frames may show by chance is not variation of the length.
        variance = spread - self._noise / count - np.sqrt(2.0 / independent) * spread
        most = np.where(rigid, options.max_rigid_bone_variation * mean, np.inf)
        sd = np.clip(np.sqrt(np.maximum(variance, 0.0)), options.min_bone_variation * mean, most)
        tells &= options.bones & (mean > 0.0)
        error_sd = np.sqrt((self._noise / count + np.square(sd)) / independent)
        return prior.posterior_m(np.where(tells, mean, np.nan), error_sd), np.where(tells, sd, np.inf)

    def _error_time_s(self, correlation_s: float) -> float:
        """Return the correlation time of the errors of paths: that of the errors, or the window of the smoother."""
        informed = self._determined > 0.0
        time_constants = self._weighted_time_constant[informed] / self._determined[informed]
        return max(correlation_s, float(np.median(time_constants)) if time_constants.size else 0.0)

    @property
    def size_m(self) -> float:
        """Size of the person, in m; NaN without data."""
        return float(np.median(self._sizes)) if self._sizes else np.nan


def _filled(weighted: np.ndarray, determined: np.ndarray) -> np.ndarray:
    """Return weighted means; keypoints without data get the geometric mean of the others."""
    information = determined > 0.0
    if not information.any():
        return np.full(len(determined), np.nan)
    mean = weighted / np.maximum(determined, 1e-300)
    return np.where(information, mean, np.exp(np.log(mean[information]).mean()))


def fit_density(solver: PathSolver, person_priors: PersonPriors) -> tuple[Paths, np.ndarray, np.ndarray, PersonPriors]:
    """Return paths without bones, the density and number of determined components per keypoint, and the priors used.

    Args:
        solver: of a range of frames, without bones.
        person_priors: error parameters; the other fields are not used.
    """
    observed, order = solver.observed, ORDERS[solver.options.prior]
    step_s = observed.step_s
    paths = Paths.initial(observed, solver.smoothness, solver.options)
    first_m2 = solver.first_variance(paths, person_priors)
    density = density_for_time_constant(step_s, first_m2, _INITIAL_STEPS * step_s, order)
    determined = np.zeros(len(density))
    innovation_scale, scale_strength = solver.error_level.estimate(person_priors)
    person_priors = replace(person_priors, innovation_scale=innovation_scale, scale_strength=scale_strength)
    scale = solver.error_level.scale(person_priors)
    if person_priors.correlation_s > 0.0:
        squares, count = solver.error_level.squares(paths.weights, person_priors)
        # Pulled toward the noise model by a few values.
        error_variance = (_STANDARD_COUNT + squares) / (_STANDARD_COUNT + count)
        person_priors = replace(person_priors, error_variance=error_variance)
    spectrum = solver.spectrum(person_priors)
    max_time_constant_s = max(_MAX_TIME_CONSTANT_S, _MAX_TIME_CONSTANT_STEPS * step_s)
    variance_m2 = first_m2
    for number in range(_ROUNDS):
        density = np.where(np.isfinite(density), density, 1.0)
        power = spectrum.power(np.nan_to_num(time_constant_s(step_s, variance_m2, density, order)))
        inflation = person_priors.error_variance * power
        person_priors = replace(person_priors, density=density, inflation=inflation)
        paths = solver.perform_round(paths, person_priors, scale, keep_weights=number < _ROUNDS // 2)
        variance_m2 = paths.variance_m2
        determined = paths.determined.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            change = paths.squares.sum(axis=1) / determined
        density = density * np.clip(np.where(determined > 0.0, change, 1.0), 1.0 / _MAX_CHANGE, _MAX_CHANGE)
        density = np.maximum(density, density_for_time_constant(step_s, variance_m2, max_time_constant_s, order))
    return paths, density, determined, person_priors
