"""Paths of one person's keypoints: alternating rounds of view weighting, linearization and solution.

Every round is one Gauss-Newton step on all paths together. The first rounds keep the views that the measured points
use, so that the density adapts to the motion before any view is rejected for lack of smoothness.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import binary_opening, uniform_filter1d

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.trajectory.band import REACH
from posefuse.kernels.trajectory.blocks import empty_blocks, matrices_from_blocks, n_blocks
from posefuse.kernels.trajectory.contact_terms import add_contact
from posefuse.kernels.trajectory.observation_terms import PathSystem, ViewTerms, add_views, weigh_observations
from posefuse.kernels.trajectory.path_steps import frame_leverages, take_steps
from posefuse.kernels.trajectory.smoothness_terms import (
    SCRATCH_ROWS,
    SmoothnessTerms,
    add_smoothness,
    padded_coefficients,
    squared_differences,
)
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.trajectory.bone_system import bone_prior, solve_system
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.error_level import ErrorLevel
from posefuse.trajectory.error_spectrum import ErrorSpectrum
from posefuse.trajectory.ground_contact import GroundContact
from posefuse.trajectory.observations import PersonObservations
from posefuse.trajectory.paths import Paths, PersonPriors
from posefuse.trajectory.roughness import Roughness
from posefuse.trajectory.smoothness import Smoothness, alive_frames

_RIDGE = 1e-5
"""Regularization as a fraction of the information of a frame; it fixes otherwise undetermined points."""

_FIXED_WEIGHT_ROUNDS = 2
"""Number of initial rounds with the view weights of the measured points."""

_MIN_AGREEING, _MIN_CONSECUTIVE = 3, 3
"""This many views that agree on a point, for this many consecutive frames, force the path to follow."""


_CONTACT_ROUNDS = 2
"""Number of rounds with ground contact, each with the contact that the paths before it show."""


_MIN_REWEIGHTED_ROUNDS = 3
"""Number of rounds with new weights after which paths change by a few hundredths of their standard deviations."""


_PERSISTENT_LIMIT_FACTOR = 0.65
"""Factor for the rejection limits if errors are persistent, because errors of successive frames do not cancel."""


@dataclass(frozen=True, eq=False)
class PathSolver:
    """Solver of the paths of one person.

    Attributes:
        observed: observations of the views.
        smoothness: smoothness prior.
        bones: of the skeleton.
        options: of the solve.
        contact: keypoints on the ground, or None.
        longest_step_m: limit of the steps of a round; None for half the measured size of the subject.
    """

    observed: PersonObservations
    smoothness: Smoothness
    bones: Bones
    options: TrajectoryOptions
    contact: GroundContact | None = None
    longest_step_m: float | None = None

    def solve(
        self, person_priors: PersonPriors, find_contact: Callable[[Paths], GroundContact | None] | None = None
    ) -> Paths:
        """Run all rounds and add the roughness of the motion to the covariance.

        Args:
            person_priors: of the person.
            find_contact: returns the keypoints on the ground, given the paths that are solved without contact.
        """
        paths = self.smooth(person_priors)
        if find_contact is not None:
            paths = self._with_contact(paths, person_priors, find_contact)
        if not self.can_estimate_roughness(person_priors):
            return paths
        rough = (
            self.roughness(paths, person_priors).variance_m2
            if person_priors.roughness_m2 is None
            else person_priors.roughness_m2
        )
        return replace(paths, covariance_m2=paths.covariance_m2 + rough[:, None, None, None] * np.eye(3))

    def can_estimate_roughness(self, person_priors: PersonPriors) -> bool:
        """Return whether deviations from a path can be motion: persistent or correlated errors look the same."""
        return person_priors.correlation_s == 0.0 and person_priors.persistent_ratio == 0.0

    def roughness(self, paths: Paths, person_priors: PersonPriors) -> Roughness:
        """Return the roughness of the motion around its paths, estimated from these frames."""
        return Roughness.of(self.observed, paths.paths_m, paths.covariance_m2, paths.weights, person_priors.spread)

    def smooth(self, person_priors: PersonPriors) -> Paths:
        """Run all rounds, for each batch of connected keypoints until its paths settle."""
        initial, batches = Paths.initial(self.observed, self.smoothness, self.options), self.bones.batches
        scale = self.error_level.scale(person_priors)
        if len(batches) < 2:
            return self._settle(initial, person_priors, scale)
        found = []
        for keypoints in batches:
            solver, priors = self._of_keypoints(keypoints, person_priors)
            found.append((keypoints, solver._settle(initial.of_keypoints(keypoints), priors, scale[keypoints])))
        return Paths.joined(found)

    def _settle(self, paths: Paths, person_priors: PersonPriors, scale: np.ndarray) -> Paths:
        """Perform rounds until all paths settle, at most as many as the options say.

        Args:
            paths: initial paths.
            person_priors: of the person.
            scale: shape (keypoint, frame, view): error level of each view relative to its usual one.
        """
        min_agreeing = self._min_agreeing_views(person_priors)
        for number in range(_FIXED_WEIGHT_ROUNDS + self.options.iterations):
            before, keep = paths, number < _FIXED_WEIGHT_ROUNDS
            paths = self.perform_round(paths, person_priors, scale, keep_weights=keep, min_agreeing=min_agreeing)
            if number + 1 >= _FIXED_WEIGHT_ROUNDS + _MIN_REWEIGHTED_ROUNDS and paths.has_settled_since(
                before, self.observed.step_s
            ):
                break
        return paths

    def _of_keypoints(self, keypoints: np.ndarray, person_priors: PersonPriors) -> tuple["PathSolver", PersonPriors]:
        """Return the solver and the priors of whole groups of connected keypoints, sorted indices."""
        bones, kept = self.bones.of_keypoints(keypoints)
        contact = None if self.contact is None else self.contact.of_keypoints(keypoints)
        solver = replace(
            self, observed=self.observed.of_keypoints(keypoints), bones=bones, contact=contact,
            longest_step_m=self.max_step_m,
        )  # fmt: skip
        return solver, person_priors.of_keypoints(keypoints, kept)

    def _with_contact(
        self, paths: Paths, person_priors: PersonPriors, find_contact: Callable[[Paths], GroundContact | None]
    ) -> Paths:
        """Run the rounds with ground contact, which change the keypoints that are connected with those in contact."""
        scale, min_agreeing = self.error_level.scale(person_priors), self._min_agreeing_views(person_priors)
        for _ in range(_CONTACT_ROUNDS):
            contact = find_contact(paths)
            if contact is None:
                break
            own = np.sort(
                np.concatenate([each for each in self.bones.batches if np.isin(contact.keypoints, each).any()])
            )
            solver, priors = replace(self, contact=contact)._of_keypoints(own, person_priors)
            touched = solver.perform_round(
                paths.of_keypoints(own), priors, scale[own], keep_weights=False, min_agreeing=min_agreeing
            )
            paths = paths.with_keypoints(own, touched)
        return paths

    def first_variance(self, paths: Paths, person_priors: PersonPriors) -> np.ndarray:
        """Return the typical variance of a point from a single frame at the initial paths, shape (keypoint,), m^2."""
        linear = self.observed.linear_blocks(paths.paths_m)
        level = np.full(len(paths.weights), person_priors.spread)
        system, _, seen = self._add_views(linear, level, self.error_level.unit_scale, paths.weights)
        return typical_variance(system.information, seen)

    def perform_round(
        self,
        paths: Paths,
        person_priors: PersonPriors,
        scale: np.ndarray,
        *,
        keep_weights: bool,
        min_agreeing: int = sys.maxsize,
    ) -> Paths:
        """Perform one round.

        Args:
            paths: current paths.
            person_priors: of the person.
            scale: shape (keypoint, frame, view): error level of each view relative to its usual one.
            keep_weights: whether views keep their weights.
            min_agreeing: this many views that measured a point together are not rejected together.
        """
        observed, smoothness = self.observed, self.smoothness
        linear = observed.linear_blocks(paths.paths_m)
        weights = paths.weights
        if not keep_weights:
            weights = self._weights(linear, paths.covariance_m2, person_priors, min_agreeing)
        inflation = np.ones(len(weights)) if person_priors.inflation is None else person_priors.inflation
        system, weights, seen = self._add_views(linear, person_priors.spread * np.sqrt(inflation), scale, weights)
        alive = alive_frames(seen, observed.time_s, self.options.max_gap_s)
        density = person_priors.density[:, None] * paths.density_factor
        if self.contact is not None:
            density = self.contact.density(density, smoothness, observed.time_s)
        stiffness = smoothness.stiffness(density, alive)
        ridge = _RIDGE / np.where(np.isfinite(paths.variance_m2), paths.variance_m2, np.inf) + 1e-12
        coefficients = self._coefficients
        terms = SmoothnessTerms(coefficients, stiffness, np.zeros((SCRATCH_ROWS, coefficients.shape[1])))
        add_smoothness(terms, ridge, paths.paths_m, system)
        if self.contact is not None:
            add_contact(self.contact.terms(observed.time_s), paths.paths_m, system)
        variance = typical_variance(system.information, seen)
        if person_priors.variance_m2 is not None:
            # That of the recording: consecutive ranges of frames join without kinks.
            variance = np.where(np.isfinite(person_priors.variance_m2), person_priors.variance_m2, variance)
        prior = bone_prior(self.bones, person_priors, variance, observed.step_s)
        steps, covariance, traces = solve_system(self.bones, prior, alive, paths.paths_m, system)
        moved = np.empty(paths.paths_m.shape)
        take_steps(paths.paths_m, steps, self.max_step_m, moved)
        squares, determined = np.empty(stiffness.shape), np.empty(stiffness.shape)
        squared_differences(terms, moved, traces, squares, determined)
        squares *= paths.density_factor
        factor = self._covariance_factor(density, variance, inflation, covariance, system, person_priors)
        if factor is not None:
            covariance *= factor
        persistent = np.zeros_like(covariance)
        if person_priors.persistent_ratio > 0.0:
            information = matrices_from_blocks(system.information, covariance.shape[1])
            persistent = self._persistent_covariance(
                covariance, information * inflation[:, None, None, None], person_priors
            )
        return Paths(
            moved,
            covariance,
            persistent,
            weights,
            alive,
            variance,
            self._local_density_factor(squares, determined),
            squares,
            determined,
        )

    def _add_views(
        self, linear: np.ndarray, level: np.ndarray, scale: np.ndarray, weights: np.ndarray
    ) -> tuple[PathSystem, np.ndarray, np.ndarray]:
        """Return the system of the views, the weights of defined observations, and which points are seen.

        Args:
            linear: linearized observations, in blocks.
            level: shape (keypoint,): factor of the standard deviations of observations.
            scale: shape (keypoint, frame, view): likewise.
            weights: shape (keypoint, frame, view).
        """
        keypoints, frames, _ = weights.shape
        system = PathSystem(*(empty_blocks(keypoints, frames, rows) for rows in (6, REACH, 3, 6)))
        weights, seen = weights.copy(), np.empty((keypoints, frames), dtype=np.bool_)
        add_views(ViewTerms(linear, self.observed.sigma_px, scale, level, weights), system, seen)
        return system, weights, seen

    def spectrum(self, person_priors: PersonPriors) -> ErrorSpectrum:
        """Return the spectrum of the errors."""
        order, step_s = self.smoothness.order, self.observed.step_s
        return ErrorSpectrum(person_priors.correlation_s, step_s, order, person_priors.error_variance)

    def _covariance_factor(
        self,
        density: np.ndarray,
        variance_m2: np.ndarray,
        inflation: np.ndarray,
        covariance_m2: np.ndarray,
        system: PathSystem,
        person_priors: PersonPriors,
    ) -> np.ndarray | None:
        """Return the factor of the covariances for the correlation of errors, (keypoint, frame, 1, 1); None for 1."""
        rows = density.shape[1]
        if not rows or (person_priors.correlation_s <= 0.0 and self.contact is None):
            return None
        frames = len(self.observed.time_s)
        leverage = np.empty((len(density), frames))
        frame_leverages(covariance_m2, system.information, leverage)
        with np.errstate(divide="ignore", invalid="ignore"):
            log_gain = np.log(density * self.observed.step_s ** (2 * self.smoothness.order - 1) / variance_m2[:, None])
        # An even number of frames has no middle one: the two nearest rows count, so that time may run backward.
        order = self.smoothness.order
        before, after = (np.clip(np.arange(frames) - each, 0, rows - 1) for each in ((order + 1) // 2, order // 2))
        log_gain = np.nan_to_num(log_gain)
        log_gain = 0.5 * (log_gain[:, before] + log_gain[:, after])
        spectrum = self.spectrum(person_priors)
        factor = spectrum.covariance_factor(inflation, log_gain, leverage)
        if self.contact is not None:
            own = list(self.contact.keypoints)
            resting = spectrum.mean_factor(inflation[own, None], leverage[own])
            factor[own] += self.contact.resting * np.maximum(resting - factor[own], 0.0)
        return factor[..., None, None]

    def _persistent_covariance(
        self, covariance_m2: np.ndarray, information: np.ndarray, person_priors: PersonPriors
    ) -> np.ndarray:
        """Return the covariance of the points due to persistent errors, shape (keypoint, frame, 3, 3).

        With the information ``I`` of one frame and the covariance ``P`` of the path as if from ``n`` such frames, an
        error that is equal in all of them moves the point by ``n P J^T e``; ``n`` is chosen such that ``n I`` does not
        exceed the inverse of ``P`` in any direction. Directions determined by time or bones rather than views do not
        move.
        """
        window = 2 * round(0.5 * self.options.max_gap_s / self.observed.step_s) + 1
        typical = uniform_filter1d(information, window, axis=1, mode="nearest")
        gain = covariance_m2 @ typical
        # The mean square of the eigenvalues approximates that of the largest one. Rounding leaves no positive one where
        # nothing determines a point.
        squared = np.einsum("kfij,kfji->kf", gain, gain)[..., None, None] / 3.0
        return person_priors.persistent_ratio * (gain @ covariance_m2) / np.where(squared > 0.0, squared, np.nan)

    def _min_agreeing_views(self, person_priors: PersonPriors) -> int:
        """Return the number of agreeing views that overrule the path."""
        return 2 if person_priors.persistent_ratio > 0.0 else _MIN_AGREEING

    def _weights(
        self, linear: np.ndarray, covariance_m2: np.ndarray, person_priors: PersonPriors, min_agreeing: int
    ) -> np.ndarray:
        """Return the weights of observations by their distance from the path, given its uncertainty.

        Where the path is too smooth to keep two views, they are those of the measured point.
        """
        observed, options = self.observed, self.options
        strict = _PERSISTENT_LIMIT_FACTOR if person_priors.persistent_ratio > 0.0 else 1.0
        weights, counts = np.empty(observed.sigma_px.shape), np.empty(observed.sigma_px.shape[:2], dtype=np.int64)
        weigh_observations(
            linear,
            observed.sigma_px,
            covariance_m2,
            strict * options.full_weight_sigma,
            strict * options.zero_weight_sigma,
            weights,
            counts,
        )
        agreed, n_agreed = self._agreed_views
        too_few = (counts < 2) & (n_agreed >= min_agreeing)
        if too_few.any():
            # Require consecutive frames: in a single frame, three views may err alike by chance.
            too_few = np.asarray(binary_opening(too_few, np.ones((1, _MIN_CONSECUTIVE), dtype=bool)), dtype=np.bool_)
            weights[too_few] = agreed[too_few]
        return weights

    @cached_property
    def _coefficients(self) -> np.ndarray:
        """Coefficients of the smoothness prior, as the kernels take them."""
        return padded_coefficients(self.smoothness.differences, n_blocks(len(self.observed.time_s)))

    @cached_property
    def _agreed_views(self) -> tuple[np.ndarray, np.ndarray]:
        """Observations that the measured points use, shape (keypoint, frame, view), bool, and their number."""
        agreed = self.observed.agreed & np.isfinite(self.observed.sigma_px)
        return agreed, agreed.sum(axis=-1)

    @cached_property
    def error_level(self) -> ErrorLevel:
        """Estimator of the error level of each view."""
        return ErrorLevel(self.observed)

    @cached_property
    def max_step_m(self) -> float:
        """Maximum step length; inf if the size of the subject is unknown."""
        if self.longest_step_m is not None:
            return self.longest_step_m
        points = self.observed.points_m
        with np.errstate(invalid="ignore"):
            extent = np.linalg.norm(np.fmax.reduce(points, axis=0) - np.fmin.reduce(points, axis=0), axis=-1)
        extent = extent[extent > 0.0]
        return 0.5 * float(np.median(extent)) if extent.size else np.inf

    def _local_density_factor(self, squares: np.ndarray, determined: np.ndarray) -> np.ndarray:
        """Return the local density factors."""
        if self.options.density_window_s <= 0.0 or not squares.shape[1]:
            return np.ones_like(squares)
        step_s = self.observed.step_s
        window = 2 * round(0.5 * self.options.density_window_s / step_s) + 1
        return self.smoothness.local_density_factor(squares, determined, window, self.options.density_prior_s / step_s)


def typical_variance(information: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the median variance of a point from a single frame, shape (keypoint,), m^2; NaN if never observed.

    Args:
        information: shape (keypoint, block, 6 * BLOCK): see :mod:`posefuse.kernels.trajectory.blocks`.
        seen: shape (keypoint, frame), bool.
    """
    keypoints, frames = seen.shape
    own = information.reshape(keypoints, -1, 6, BLOCK)
    trace = ((own[:, :, 0] + own[:, :, 3] + own[:, :, 5]) / 3.0).reshape(keypoints, -1)[:, :frames]
    trace = np.where(seen, trace, np.inf)
    trace.sort(axis=1)
    count = seen.sum(axis=1)
    low, high = (
        np.take_along_axis(trace, np.maximum(n, 0)[:, None], axis=1)[:, 0] for n in ((count - 1) // 2, count // 2)
    )
    with np.errstate(divide="ignore"):
        return np.where(count > 0, 1.0 / (0.5 * (low + high)), np.nan)
