"""Paths of one person's keypoints: rounds of weighing views, making everything linear, and solving.

Every round is one Gauss-Newton step on all paths together. The first ones trust the views the measured points rest
on, so that the density can follow the motion before anything is rejected for not being smooth.
"""

import sys
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.ndimage import binary_opening, uniform_filter1d

from posefuse.kernels.trajectory.band import REACH, factor_paths, invert_paths
from posefuse.kernels.trajectory.bone_terms import (
    add_bone_gradient,
    add_to_diagonal,
    bone_directions,
    propagate_bone_information,
    solve_with_bones,
)
from posefuse.kernels.trajectory.observation_terms import (
    assemble_system,
    squared_differences,
    weigh_observations,
    whiten_errors,
)
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.observed import Observed
from posefuse.trajectory.roughness import Roughness
from posefuse.trajectory.smoothness import Smoothness, alive_frames
from posefuse.trajectory.start import begin

_RIDGE = 1e-5
"""Of a frame's information: holds a point back that nothing else holds, and is next to nothing where anything does."""

_MOST_STEPS = 30
_TOLERANCE = 1e-3
_TRUSTING = 2
"""So many rounds weigh views as the measured points do."""

_ERRORS_S = 0.3
"""A view errs more or less than usual for about so long."""

_AGREED, _IN_A_ROW = 3, 3
"""So many views agree on a point, for so many frames, that the path must go there."""

_STRICT = 0.65
"""Views whose errors last are left out so much sooner: those of one frame do not make up for those of the next."""

_LASTS_S = 1.2
"""What an error is in the mean over so long lasts."""

STEADIEST = 1e6
"""Errors of one size all the time."""

_LEAST_SCALE, _MOST_SCALE = 0.5, 4.0

_BONE_REACH = 3.0
"""In units of what a bone gives and views leave open: so far beside its length it holds a quarter as tightly."""

_STIFFEST = 10.0
"""Bones are taken for no stiffer than so many times what views say along them: stiffer ones would tell hardly more, and
the solve would take long."""

_BONE_S = 0.05
"""A bone's length differs from its own for about so long at a time."""


@dataclass(frozen=True, eq=False)
class Law:
    """What one person's paths are solved with.

    Attributes:
        density: shape (keypoint,): of the white jerk or acceleration.
        length_m: shape (bone,).
        length_sd_m: shape (bone,): inf where a bone tells nothing.
        correlation_s: how long detection errors last; 0 if they are white.
        spread: of accepted errors that pass, in units of the noise.
        fresh: mean square of what is new in errors, in units of what is expected.
        steady: how steadily a view errs: as if so many numbers had shown that it errs as usual.
        lasting: variance of what lasts throughout of the errors, over that of what passes.
        roughness_m2: shape (keypoint,): variance of what the motion is beside its paths; None lets them tell it.
    """

    density: np.ndarray
    length_m: np.ndarray
    length_sd_m: np.ndarray
    correlation_s: float
    spread: float
    fresh: float = 1.0
    steady: float = STEADIEST
    lasting: float = 0.0
    roughness_m2: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths between two rounds.

    Attributes:
        paths_m: shape (keypoint, frame, 3).
        covariance_m2: shape (keypoint, frame, 3, 3), of errors that pass.
        lasting_m2: shape (keypoint, frame, 3, 3): of errors that last throughout.
        weights: shape (keypoint, frame, view): what each observation counted.
        alive: shape (keypoint, frame), bool: seen, or in a gap no longer than allowed.
        variance_m2: shape (keypoint,): of what a frame by itself says of the point, as it usually is.
        lively: shape (keypoint, row): the density next to the keypoint's own.
        squares: shape (keypoint, row): squared differences of frames, over what the keypoint's own density expects.
        known: shape (keypoint, row): how many numbers the data determine of each.
    """

    paths_m: np.ndarray
    covariance_m2: np.ndarray
    lasting_m2: np.ndarray
    weights: np.ndarray
    alive: np.ndarray
    variance_m2: np.ndarray
    lively: np.ndarray
    squares: np.ndarray
    known: np.ndarray

    @classmethod
    def begin(cls, observed: Observed, smoothness: Smoothness, options: TrajectoryOptions) -> Self:
        """The measured points, and what lies between them."""
        paths, weights = begin(observed)
        keypoints, frames, _ = paths.shape
        rows = np.ones((keypoints, len(smoothness.time_s)))
        return cls(
            paths_m=paths,
            covariance_m2=np.zeros((keypoints, frames, 3, 3)),
            lasting_m2=np.zeros((keypoints, frames, 3, 3)),
            weights=weights,
            alive=alive_frames(np.asarray(weights.any(axis=-1)), observed.time_s, options.max_gap_s),
            variance_m2=np.full(keypoints, np.nan),
            lively=rows,
            squares=rows,
            known=3.0 * rows,
        )


@dataclass(frozen=True, eq=False)
class Solver:
    """One person's problem.

    Attributes:
        observed: what views saw.
        smoothness: the prior.
        bones: of the skeleton.
        options: of the solve.
    """

    observed: Observed
    smoothness: Smoothness
    bones: Bones
    options: TrajectoryOptions

    def solve(self, law: Law) -> Paths:
        """All rounds, and how far the motion may be from the paths."""
        paths = self.smooth(law)
        if not self.tells_roughness(law):
            return paths
        rough = self.roughness(paths, law).variance_m2 if law.roughness_m2 is None else law.roughness_m2
        return replace(paths, covariance_m2=paths.covariance_m2 + rough[:, None, None, None] * np.eye(3))

    def tells_roughness(self, law: Law) -> bool:
        """Whether what lies beside a path can be motion: errors that last look like motion that the path misses."""
        return law.correlation_s == 0.0 and law.lasting == 0.0

    def roughness(self, paths: Paths, law: Law) -> Roughness:
        """What the motion is beside its paths, as far as these frames tell."""
        return Roughness.of(self.observed, paths.paths_m, paths.covariance_m2, paths.weights, law.spread)

    def smooth(self, law: Law) -> Paths:
        """All rounds."""
        paths = Paths.begin(self.observed, self.smoothness, self.options)
        scale = self.scale(law)
        for number in range(_TRUSTING + self.options.iterations):
            paths = self.round(paths, law, scale, trusting=number < _TRUSTING, least=self._least(law))
        return paths

    def first_variance(self, paths: Paths, law: Law) -> np.ndarray:
        """Shape (keypoint,), m^2: of what a frame by itself says of the point, where the paths begin."""
        residuals, jacobians = self.observed.linear(paths.paths_m)
        rows = np.zeros(paths.lively.shape)
        sigma = law.spread * self.observed.sigma_px
        _, _, seen = self._terms(residuals, jacobians, sigma, paths.weights, law, rows, paths)
        return usual_variance(seen, paths.weights)

    def round(self, paths: Paths, law: Law, scale: np.ndarray, *, trusting: bool, least: int = sys.maxsize) -> Paths:
        """One step.

        Args:
            paths: so far.
            law: of the person.
            scale: shape (keypoint, frame, view): how much more each view errs than it usually does.
            trusting: whether views keep their weights.
            least: so many views that measured a point together are not left out together.
        """
        observed, options = self.observed, self.options
        residuals, jacobians = observed.linear(paths.paths_m)
        weights = paths.weights
        if not trusting:
            weights = self._kept_in(self._weights(residuals, jacobians, paths.covariance_m2, law), least)
        weights = np.where(np.isfinite(residuals[..., 0]), weights, 0.0)
        alive = alive_frames(np.asarray(weights.any(axis=-1)), observed.time_s, options.max_gap_s)
        density = law.density[:, None] * paths.lively
        stiffness = self.smoothness.stiffness(density, alive)
        sigma = law.spread * observed.sigma_px * scale
        band, pull, seen = self._terms(residuals, jacobians, sigma, weights, law, stiffness, paths)
        variance = usual_variance(seen, weights)
        steps, covariance = self._step(
            paths.paths_m, band, pull, seen, self._tightness(paths.paths_m, law, alive, variance), law.length_m
        )
        moved = paths.paths_m + self._shortened(steps)
        squares, known = np.empty(stiffness.shape), np.empty(stiffness.shape)
        squared_differences(self.smoothness.differences, stiffness, moved, covariance, squares, known)
        lively = self._liveliness(squares * paths.lively, known)
        own = covariance[:, :, 0].copy()
        lasting = self._lasting(own, seen, law)
        return Paths(moved, own, lasting, weights, alive, variance, lively, squares * paths.lively, known)

    def _lasting(self, covariance_m2: np.ndarray, seen: np.ndarray, law: Law) -> np.ndarray:
        """Covariance of what errors that last throughout do to the points, shape (keypoint, frame, 3, 3).

        With the information ``I`` of one frame and the path's covariance ``P`` as if of ``n`` such frames, an error
        that is the same in all of them moves the point by ``n P J^T e``; ``n`` is what makes ``n I`` no more than the
        inverse of ``P`` in any direction. Directions that time or bones hold, not views, are not moved.
        """
        if law.lasting == 0.0:
            return np.zeros_like(covariance_m2)
        window = 2 * round(0.5 * self.options.max_gap_s / self.observed.step_s) + 1
        kept = self._kept(law.correlation_s)[-1]
        usual = uniform_filter1d(seen, window, axis=1, mode="nearest") * (1.0 + kept) / (1.0 - kept)
        gain = covariance_m2 @ usual
        # The root of the mean square of the eigenvalues, as good as the largest.
        most = np.sqrt(np.maximum(np.einsum("kfij,kfji->kf", gain, gain), 1e-300) / 3.0)[..., None, None]
        return law.lasting * (gain @ covariance_m2) / np.square(most)

    def _least(self, law: Law) -> int:
        """So many views that agree are right, where they are and the path is not."""
        return 2 if law.lasting > 0.0 else _AGREED

    def _kept_in(self, weights: np.ndarray, least: int) -> np.ndarray:
        """Weights; where the path left hardly a view, those of the measured point: it was too smooth to follow."""
        agreed = self.observed.agreed & np.isfinite(self.observed.sigma_px)
        lost = ((weights > 0.5).sum(axis=-1) < 2) & (agreed.sum(axis=-1) >= least)
        # Three frames in a row: single ones may be three views that err alike.
        lost = binary_opening(lost, np.ones((1, _IN_A_ROW), dtype=bool))
        return np.where(lost[..., None], agreed, weights)

    def _weights(self, residuals: np.ndarray, jacobians: np.ndarray, covariance_m2: np.ndarray, law: Law) -> np.ndarray:
        """Of each observation by how far it lies from where the path is, as well as that is known."""
        observed, options = self.observed, self.options
        strict = _STRICT if law.lasting > 0.0 else 1.0
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
        law: Law,
        stiffness: np.ndarray,
        paths: Paths,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The band, the pull, and the information of single frames."""
        keypoints, frames, _ = paths.paths_m.shape
        band, pull = np.empty((keypoints, frames, REACH + 1, 3, 3)), np.empty((keypoints, frames, 3))
        seen = np.empty((keypoints, frames, 3, 3))
        known = np.where(np.isfinite(paths.variance_m2), paths.variance_m2, np.inf)
        ridge = _RIDGE / known + 1e-12
        assemble_system(
            residuals,
            jacobians,
            sigma_px,
            weights,
            self._kept(law.correlation_s),
            self.smoothness.differences,
            stiffness,
            paths.paths_m,
            ridge,
            band,
            pull,
            seen,
        )
        return band, pull, seen

    @cached_property
    def disagreement(self) -> tuple[np.ndarray, np.ndarray]:
        """How far views lie from the measured points they make, and how much they tell by that.

        Residuals (keypoint, frame, view, 2) in sigmas, larger by what the point took up of them; and the share it left,
        (keypoint, frame, view), 0 where a view is not one the point rests on. They know nothing of time: what quick
        motion does to a path that is too smooth is no error of a view.
        """
        observed = self.observed
        there = np.asarray(np.isfinite(observed.points_m).all(axis=-1))
        residuals, _ = observed.linear(np.where(there[..., None], observed.points_m, 0.0))
        used = observed.agreed & np.isfinite(observed.sigma_px) & np.isfinite(residuals[..., 0]) & there[..., None]
        count = used.sum(axis=-1)
        used &= (count > 1)[..., None]
        left = (np.maximum(2.0 * count - 3.0, 1.0) / np.maximum(2.0 * count, 1.0))[..., None]
        scaled = np.where(used[..., None], residuals / observed.sigma_px[..., None], 0.0) / np.sqrt(left)[..., None]
        return scaled, np.where(used, left, 0.0)

    @cached_property
    def usually(self) -> np.ndarray:
        """Shape (keypoint, frame, view): ones."""
        return np.ones(self.observed.sigma_px.shape)

    def scale(self, law: Law) -> np.ndarray:
        """Shape (keypoint, frame, view): how much more each view errs about a frame than it usually does.

        From what of its errors is new in each frame: what is left over from the last one may as well be the point's.
        """
        if law.steady >= STEADIEST:
            return self.usually
        total, count = self._new_errors(law)
        scale = np.sqrt((law.steady + total / min(law.fresh, 1.0)) / (law.steady + count))
        # Of the variance of sizes, 2 / steady, about a third is of changes too quick to be seen.
        return np.clip(scale, _LEAST_SCALE, _MOST_SCALE) * np.sqrt(1.0 + 0.7 / law.steady)

    def _new_errors(self, law: Law) -> tuple[np.ndarray, np.ndarray]:
        """What is new in errors about each frame, squared, and how many numbers that is of."""
        residuals, left = self.disagreement
        if law.lasting > 0.0:
            residuals = self._passing(residuals, left > 0.0)
        squares, counts = np.empty(left.shape), np.empty(left.shape)
        sigma = law.spread * self.usually
        whiten_errors(residuals, sigma, left, self._kept(law.correlation_s), squares, counts)
        window = 2 * round(0.5 * _ERRORS_S / self.observed.step_s) + 1
        total = uniform_filter1d(left * squares, window, axis=1, mode="nearest") * window
        return total, uniform_filter1d(left * counts, window, axis=1, mode="nearest") * window

    def _passing(self, residuals: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Residuals less what they are about each frame in the mean: what lasts is no new error."""
        window = 2 * round(0.5 * _LASTS_S / self.observed.step_s) + 1
        total = uniform_filter1d(residuals, window, axis=1, mode="constant")
        share = uniform_filter1d(used.astype(np.float64), window, axis=1, mode="constant")
        mean = total / np.maximum(share, 0.5 / window)[..., None]
        return np.where(used[..., None], residuals - mean, 0.0)

    def steadiness(self, law: Law) -> tuple[float, float]:
        """``fresh`` and ``steady`` of a law: by how much more errors vary in size than chance would have it."""
        total, count = self._new_errors(law)
        told = count > 0.5
        if not told.any():
            return 1.0, STEADIEST
        # A spell that no scale reaches is no size of errors: one of a wrong limb would make all frames uncertain.
        count = count[told]
        size = np.minimum(total[told] / count, _MOST_SCALE**2)
        fresh = float((count * size).sum() / count.sum())
        varies = float((count * np.square(size / fresh - 1.0)).sum() / count.sum())
        chance = 2.0 * len(count) / float(count.sum())
        return fresh, min(2.0 / max(varies - chance, 2.0 / STEADIEST), STEADIEST)

    def _kept(self, correlation_s: float) -> np.ndarray:
        """Shape (frame,): the correlation of an error with that of the frame before."""
        kept = np.zeros(len(self.observed.time_s))
        if correlation_s > 0.0:
            kept[1:] = np.exp(-np.diff(self.observed.time_s) / correlation_s)
        return kept

    def _tightness(self, paths_m: np.ndarray, law: Law, alive: np.ndarray, variance_m2: np.ndarray) -> np.ndarray:
        """Shape (bone, frame): one over the variance of each length, as if frames told of it one by one.

        A bone farther from its length than its give and what views leave open gives way (Geman and McClure's weight).
        """
        one, other = self.bones.ends.T
        share = min(self.observed.step_s / (2.0 * _BONE_S), 1.0)
        seen_m2 = np.nan_to_num(variance_m2[one] + variance_m2[other], nan=np.inf)
        give_m2 = np.square(law.length_sd_m)
        with np.errstate(divide="ignore"):
            own = np.minimum(share / give_m2, _STIFFEST / seen_m2)
        off_m = np.linalg.norm(paths_m[one] - paths_m[other], axis=-1) - law.length_m[:, None]
        reach_m2 = _BONE_REACH**2 * (give_m2 + seen_m2)[:, None]
        with np.errstate(invalid="ignore"):
            held = np.square(1.0 / (1.0 + np.nan_to_num(np.square(off_m) / reach_m2)))
        return np.where(alive[one] & alive[other], own[:, None] * held, 0.0)

    def _step(
        self,
        paths_m: np.ndarray,
        band: np.ndarray,
        pull: np.ndarray,
        seen: np.ndarray,
        tightness: np.ndarray,
        length_m: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where everything pulls the paths, and the covariance within the band."""
        ends, order = self.bones.ends, self.bones.order
        keypoints, frames, _ = paths_m.shape
        directions, excess = np.empty((len(ends), frames, 3)), np.empty((len(ends), frames))
        # A bone of unknown length pulls at nothing; what is not a number would pull at everything.
        bone_directions(ends, np.nan_to_num(length_m), paths_m, directions, excess)
        told = np.empty_like(seen)
        propagate_bone_information(ends, order, directions, tightness, seen, told, np.empty((len(order), 3, 3)))
        add_to_diagonal(told, band)
        add_bone_gradient(ends, directions, tightness, excess, pull)
        lower, inverse = np.empty((keypoints, frames, REACH, 3, 3)), np.empty((keypoints, frames, 3, 3))
        factor_paths(band, lower, inverse, np.empty(keypoints))
        steps, covariance = np.empty_like(pull), np.empty_like(band)
        solve_with_bones(
            band, told, lower, inverse, ends, directions, tightness, pull, _MOST_STEPS, _TOLERANCE, steps
        )  # fmt: skip
        invert_paths(lower, inverse, covariance)
        return steps, covariance

    @cached_property
    def farthest_m(self) -> float:
        """The longest step: half the subject's size, as measured; inf where it has none."""
        points = self.observed.points_m
        with np.errstate(invalid="ignore"):
            extent = np.linalg.norm(np.fmax.reduce(points, axis=0) - np.fmin.reduce(points, axis=0), axis=-1)
        extent = extent[extent > 0.0]
        return 0.5 * float(np.median(extent)) if extent.size else np.inf

    def _shortened(self, steps_m: np.ndarray) -> np.ndarray:
        """Steps no longer than what is linear reaches: one that runs away would be all that rounds after it see."""
        length = np.linalg.norm(steps_m, axis=-1, keepdims=True)
        return steps_m * np.minimum(1.0, self.farthest_m / np.maximum(length, 1e-300))

    def _liveliness(self, squares: np.ndarray, known: np.ndarray) -> np.ndarray:
        if self.options.density_window_s <= 0.0 or not squares.shape[1]:
            return np.ones_like(squares)
        step_s = self.observed.step_s
        window = 2 * round(0.5 * self.options.density_window_s / step_s) + 1
        return self.smoothness.local(squares, known, window, self.options.density_prior_s / step_s)


def usual_variance(seen: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Shape (keypoint,), m^2: of what a frame by itself says, in the median of those seen; NaN if there are none."""
    trace = np.trace(seen, axis1=-2, axis2=-1) / 3.0
    there = np.asarray(weights.any(axis=-1))
    return np.array(
        [1.0 / np.median(own[known]) if known.any() else np.nan for own, known in zip(trace, there, strict=True)]
    )
