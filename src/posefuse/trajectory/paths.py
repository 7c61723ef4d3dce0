"""Paths of one person's keypoints, and the parameters they are solved with."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from scipy.ndimage import uniform_filter1d

from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.trajectory.initial_paths import initial_paths
from posefuse.trajectory.observations import PersonObservations
from posefuse.trajectory.smoothness import Smoothness, alive_frames

CONSTANT_LEVEL_STRENGTH = 1e6
"""Strength of the prior on the error level that stands for a constant level."""


_SETTLED_SIGMA, _SETTLED_S = 1.0, 0.5
"""Further rounds follow while one moves a path by this many standard deviations, RMS over this time, as where a single
view sees a point for long. Rounds that windows of a recording did not have in common would show at their borders."""


@dataclass(frozen=True, eq=False)
class PersonPriors:
    """Parameters of the solve for one person.

    Attributes:
        density: shape (keypoint,): spectral density of the white jerk or acceleration.
        length_m: shape (bone,).
        length_sd_m: shape (bone,): inf where a bone has no effect.
        correlation_s: correlation time of detection errors; 0 if they are white.
        spread: factor of the non-persistent errors of accepted observations relative to the noise model.
        innovation_scale: mean square of the innovations of errors, in units of the expected value.
        scale_strength: strength of the prior that the error level of a view is constant, as an equivalent sample size.
        persistent_ratio: variance of persistent errors over that of the others.
        roughness_m2: shape (keypoint,): variance of the motion around its path; None estimates it from the path.
        inflation: shape (keypoint,): variance of white errors by which paths weight the views, relative to that of the
            errors; None for 1.
        error_variance: variance of the errors relative to the noise model, its spread and their level.
        variance_m2: shape (keypoint,): typical variance of a point from a single frame, as paths weight it; None or NaN
            takes that of the frames that are solved.
    """

    density: np.ndarray
    length_m: np.ndarray
    length_sd_m: np.ndarray
    correlation_s: float
    spread: float
    innovation_scale: float = 1.0
    scale_strength: float = CONSTANT_LEVEL_STRENGTH
    persistent_ratio: float = 0.0
    roughness_m2: np.ndarray | None = None
    inflation: np.ndarray | None = None
    error_variance: float = 1.0
    variance_m2: np.ndarray | None = None

    def of_keypoints(self, keypoints: np.ndarray, bones: np.ndarray) -> Self:
        """Return the parameters of some keypoints and of the bones between them."""
        roughness, inflation, variance = self.roughness_m2, self.inflation, self.variance_m2
        return replace(
            self, density=self.density[keypoints], length_m=self.length_m[bones], length_sd_m=self.length_sd_m[bones],
            roughness_m2=None if roughness is None else roughness[keypoints],
            inflation=None if inflation is None else inflation[keypoints],
            variance_m2=None if variance is None else variance[keypoints],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths between two rounds.

    Attributes:
        paths_m: shape (keypoint, frame, 3).
        covariance_m2: shape (keypoint, frame, 3, 3), without persistent errors.
        persistent_covariance_m2: shape (keypoint, frame, 3, 3): covariance from persistent errors.
        weights: shape (keypoint, frame, view): weight of each observation.
        alive: shape (keypoint, frame), bool: observed, or in a gap no longer than allowed.
        variance_m2: shape (keypoint,): typical variance of a point from a single frame, as paths weight it.
        density_factor: shape (keypoint, row): local density relative to that of the keypoint.
        squares: shape (keypoint, row): squared finite differences, in units of the value that the density predicts.
        determined: shape (keypoint, row): number of components of each difference that the data determine.
    """

    paths_m: np.ndarray
    covariance_m2: np.ndarray
    persistent_covariance_m2: np.ndarray
    weights: np.ndarray
    alive: np.ndarray
    variance_m2: np.ndarray
    density_factor: np.ndarray
    squares: np.ndarray
    determined: np.ndarray

    def has_settled_since(self, before: "Paths", step_s: float) -> bool:
        """Return whether no path moved since a round before by more than its standard deviation over a while."""
        with np.errstate(invalid="ignore", divide="ignore"):
            moved = np.square(self.paths_m - before.paths_m).sum(axis=-1)
            moved /= np.trace(self.covariance_m2, axis1=-2, axis2=-1) / 3.0
        window = 2 * round(0.5 * _SETTLED_S / step_s) + 1
        moved = np.where(self.alive & np.isfinite(moved), moved, 0.0)
        return not (uniform_filter1d(moved, window, axis=1, mode="nearest") > _SETTLED_SIGMA**2).any()

    def of_keypoints(self, keypoints: np.ndarray) -> Self:
        """Return the paths of some keypoints."""
        return type(self)(*(getattr(self, each.name)[keypoints] for each in fields(self)))

    def with_keypoints(self, keypoints: np.ndarray, others: Self) -> Self:
        """Return the paths with those of some keypoints replaced."""
        return self.joined([(np.arange(len(self.paths_m)), self), (keypoints, others)])

    @classmethod
    def joined(cls, parts: Sequence[tuple[np.ndarray, Self]]) -> Self:
        """Return the paths of all keypoints from those of groups; later groups replace earlier ones."""
        number = 1 + max(int(keypoints.max()) for keypoints, _ in parts)
        arrays = []
        for each in fields(cls):
            of_first = getattr(parts[0][1], each.name)
            whole = np.empty((number, *of_first.shape[1:]), of_first.dtype)
            for keypoints, paths in parts:
                whole[keypoints] = getattr(paths, each.name)
            arrays.append(whole)
        return cls(*arrays)

    @classmethod
    def initial(cls, observed: PersonObservations, smoothness: Smoothness, options: TrajectoryOptions) -> Self:
        """Return the measured points, interpolated where missing."""
        paths, weights = initial_paths(observed)
        keypoints, frames, _ = paths.shape
        rows = np.ones((keypoints, len(smoothness.time_s)))
        return cls(
            paths_m=paths,
            covariance_m2=np.zeros((keypoints, frames, 3, 3)),
            persistent_covariance_m2=np.zeros((keypoints, frames, 3, 3)),
            weights=weights,
            alive=alive_frames(np.asarray(weights.any(axis=-1)), observed.time_s, options.max_gap_s),
            variance_m2=np.full(keypoints, np.nan),
            density_factor=rows,
            squares=rows,
            determined=3.0 * rows,
        )
