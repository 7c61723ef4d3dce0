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

from posefuse.kernels.trajectory.band import REACH
from posefuse.kernels.trajectory.contact_terms import add_contact
from posefuse.kernels.trajectory.observation_terms import (
    PathSystem,
    SmoothnessTerms,
    ViewTerms,
    assemble_system,
    squared_differences,
    weigh_observations,
)
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.trajectory.bone_system import bone_stiffness, solve_system
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


_SETTLED_SIGMA, _SETTLED_S = 1.0, 0.5
"""Further rounds follow while one moves a path by this many standard deviations, RMS over this time, as where a single
view sees a point for long. Rounds that windows of a recording did not have in common would show at their borders."""


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
        initial = Paths.initial(self.observed, self.smoothness, self.options)
        batches = self.bones.batches
        if len(batches) < 2:
            return self._settle(initial, person_priors)
        found = []
        for keypoints in batches:
            solver, priors = self._of_keypoints(keypoints, person_priors)
            found.append((keypoints, solver._settle(initial.of_keypoints(keypoints), priors)))
        return Paths.joined(found)

    def _settle(self, paths: Paths, person_priors: PersonPriors) -> Paths:
        """Perform rounds until all paths settle, at most as many as the options say."""
        scale, min_agreeing = self.error_level.scale(person_priors), self._min_agreeing_views(person_priors)
        for number in range(_FIXED_WEIGHT_ROUNDS + self.options.iterations):
            before, keep = paths, number < _FIXED_WEIGHT_ROUNDS
            paths = self.perform_round(paths, person_priors, scale, keep_weights=keep, min_agreeing=min_agreeing)
            if number + 1 >= _FIXED_WEIGHT_ROUNDS + _MIN_REWEIGHTED_ROUNDS and self._has_settled(before, paths):
                break
        return paths

    def _has_settled(self, before: Paths, after: Paths) -> bool:
        """Return whether a round moved no path by more than its standard deviation over a while."""
        with np.errstate(invalid="ignore", divide="ignore"):
            moved = np.square(after.paths_m - before.paths_m).sum(axis=-1)
            moved /= np.trace(after.covariance_m2, axis1=-2, axis2=-1) / 3.0
        window = 2 * round(0.5 * _SETTLED_S / self.observed.step_s) + 1
        moved = np.where(after.alive & np.isfinite(moved), moved, 0.0)
        return not (uniform_filter1d(moved, window, axis=1, mode="nearest") > _SETTLED_SIGMA**2).any()

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
        residuals, jacobians = self.observed.linear(paths.paths_m)
        rows = np.zeros(paths.density_factor.shape)
        sigma = person_priors.spread * self.observed.sigma_px
        _, _, information = self._terms(residuals, jacobians, sigma, paths.weights, rows, paths)
        return typical_variance(information, paths.weights)

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
        observed, options = self.observed, self.options
        residuals, jacobians = observed.linear(paths.paths_m)
        weights = paths.weights
        if not keep_weights:
            weights = self._restore_agreed_views(
                self._weights(residuals, jacobians, paths.covariance_m2, person_priors), min_agreeing
            )
        weights = np.where(np.isfinite(residuals[..., 0]), weights, 0.0)
        alive = alive_frames(np.asarray(weights.any(axis=-1)), observed.time_s, options.max_gap_s)
        density = person_priors.density[:, None] * paths.density_factor
        if self.contact is not None:
            density = self.contact.density(density, self.smoothness, observed.time_s)
        stiffness = self.smoothness.stiffness(density, alive)
        inflation = np.ones(len(weights)) if person_priors.inflation is None else person_priors.inflation
        sigma = person_priors.spread * np.sqrt(inflation)[:, None, None] * observed.sigma_px * scale
        band, rhs, information = self._terms(residuals, jacobians, sigma, weights, stiffness, paths)
        if self.contact is not None:
            add_contact(self.contact.terms(observed.time_s), paths.paths_m, band, rhs)
        variance = typical_variance(information, weights)
        stiffness_m2 = bone_stiffness(self.bones, paths.paths_m, person_priors, alive, variance, observed.step_s)
        steps, covariance = solve_system(
            self.bones, paths.paths_m, PathSystem(band, rhs, information), stiffness_m2, person_priors.length_m
        )
        moved = paths.paths_m + self._limit_steps(steps)
        squares, determined = np.empty(stiffness.shape), np.empty(stiffness.shape)
        squared_differences(self.smoothness.differences, stiffness, moved, covariance, squares, determined)
        density_factor = self._local_density_factor(squares * paths.density_factor, determined)
        leverage = np.einsum("kfij,kfji->kf", covariance[:, :, 0], information) / 3.0
        factor = self._covariance_factor(density, variance, inflation, leverage, person_priors)
        own_covariance = covariance[:, :, 0] * factor
        persistent_ratio = self._persistent_covariance(
            own_covariance, information * inflation[:, None, None, None], person_priors
        )
        return Paths(
            moved,
            own_covariance,
            persistent_ratio,
            weights,
            alive,
            variance,
            density_factor,
            squares * paths.density_factor,
            determined,
        )

    def spectrum(self, person_priors: PersonPriors) -> ErrorSpectrum:
        """Return the spectrum of the errors."""
        order, step_s = self.smoothness.order, self.observed.step_s
        return ErrorSpectrum(person_priors.correlation_s, step_s, order, person_priors.error_variance)

    def _covariance_factor(
        self,
        density: np.ndarray,
        variance_m2: np.ndarray,
        inflation: np.ndarray,
        leverage: np.ndarray,
        person_priors: PersonPriors,
    ) -> np.ndarray:
        """Return the factor of the covariances for the correlation of errors, shape (keypoint, frame, 1, 1)."""
        keypoints, rows = density.shape
        frames = len(self.observed.time_s)
        if not rows:
            return np.ones((keypoints, frames, 1, 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            log_gain = np.log(density * self.observed.step_s ** (2 * self.smoothness.order - 1) / variance_m2[:, None])
        # An even number of frames has no middle one: the two nearest rows count, so that time may run backward.
        order = self.smoothness.order
        before, after = (np.clip(np.arange(frames) - each, 0, rows - 1) for each in ((order + 1) // 2, order // 2))
        log_gain = np.nan_to_num(log_gain)
        log_gain = 0.5 * (log_gain[:, before] + log_gain[:, after])
        spectrum = self.spectrum(person_priors)
        factor = spectrum.covariance_factor(inflation[:, None], log_gain, leverage)
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
        if person_priors.persistent_ratio == 0.0:
            return np.zeros_like(covariance_m2)
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

    def _restore_agreed_views(self, weights: np.ndarray, min_agreeing: int) -> np.ndarray:
        """Return the weights, or those of the measured point where the path is too smooth to keep two views."""
        agreed = self.observed.agreed & np.isfinite(self.observed.sigma_px)
        too_few = ((weights > 0.5).sum(axis=-1) < 2) & (agreed.sum(axis=-1) >= min_agreeing)
        # Require consecutive frames: in a single frame, three views may err alike by chance.
        too_few = binary_opening(too_few, np.ones((1, _MIN_CONSECUTIVE), dtype=bool))
        return np.where(too_few[..., None], agreed, weights)

    def _weights(
        self, residuals: np.ndarray, jacobians: np.ndarray, covariance_m2: np.ndarray, person_priors: PersonPriors
    ) -> np.ndarray:
        """Return the weights of observations by their distance from the path, given its uncertainty."""
        observed, options = self.observed, self.options
        strict = _PERSISTENT_LIMIT_FACTOR if person_priors.persistent_ratio > 0.0 else 1.0
        weights = np.empty(observed.sigma_px.shape)
        keypoints, frames, views = observed.sigma_px.shape
        n = keypoints * frames
        weigh_observations(
            residuals.reshape(n, views, 2),
            jacobians.reshape(n, views, 2, 3),
            observed.sigma_px.reshape(n, views),
            covariance_m2.reshape(n, 3, 3),
            strict * options.full_weight_sigma,
            strict * options.zero_weight_sigma,
            weights.reshape(n, views),
        )
        return weights

    def _terms(
        self,
        residuals: np.ndarray,
        jacobians: np.ndarray,
        sigma_px: np.ndarray,
        weights: np.ndarray,
        stiffness: np.ndarray,
        paths: Paths,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the band, the right-hand side, and the information of single frames."""
        keypoints, frames, _ = paths.paths_m.shape
        band, rhs = np.empty((keypoints, frames, REACH + 1, 3, 3)), np.empty((keypoints, frames, 3))
        information = np.empty((keypoints, frames, 3, 3))
        variance_m2 = np.where(np.isfinite(paths.variance_m2), paths.variance_m2, np.inf)
        ridge = _RIDGE / variance_m2 + 1e-12
        assemble_system(
            ViewTerms(residuals, jacobians, sigma_px, weights),
            SmoothnessTerms(self.smoothness.differences, stiffness, ridge),
            paths.paths_m,
            PathSystem(band, rhs, information),
        )
        return band, rhs, information

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

    def _limit_steps(self, steps_m: np.ndarray) -> np.ndarray:
        """Return steps limited to the linear range, because a diverging point would corrupt the following rounds."""
        length = np.linalg.norm(steps_m, axis=-1, keepdims=True)
        return steps_m * np.minimum(1.0, self.max_step_m / np.maximum(length, 1e-300))

    def _local_density_factor(self, squares: np.ndarray, determined: np.ndarray) -> np.ndarray:
        """Return the local density factors."""
        if self.options.density_window_s <= 0.0 or not squares.shape[1]:
            return np.ones_like(squares)
        step_s = self.observed.step_s
        window = 2 * round(0.5 * self.options.density_window_s / step_s) + 1
        return self.smoothness.local_density_factor(squares, determined, window, self.options.density_prior_s / step_s)


def typical_variance(information: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the median variance of a point from a single frame, shape (keypoint,), m^2; NaN if never observed."""
    trace = np.trace(information, axis1=-2, axis2=-1) / 3.0
    there = np.asarray(weights.any(axis=-1))
    return np.array(
        [1.0 / np.median(own[seen]) if seen.any() else np.nan for own, seen in zip(trace, there, strict=True)]
    )
