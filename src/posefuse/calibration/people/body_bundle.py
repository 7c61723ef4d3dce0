"""Fast bundle adjustment of approximate cameras from moving bodies with rigid bones.

Poses, time offsets, focal lengths, points and the lengths of bones maximize the likelihood with Student-t errors by
Levenberg-Marquardt steps, with the points of each sample eliminated (Triggs et al. 2000). Rigid bones determine what
epipolar geometry determines weakly: the focal length and, of two distant views, the angle between them.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.bodies import BodySamples, Bones, focal_changes
from posefuse.kernels.calibration.body_bundle import (
    CENTER,
    FOCAL,
    OFFSET,
    ROTATION,
    VIEW_COLUMNS,
    body_residuals,
    body_terms,
    eliminate_points,
    step_of_points,
)
from posefuse.kernels.calibration.ray_points import triangulate_rays
from posefuse.model.cameras import rotation_from_vector

_MEDIAN_LENGTH = float(np.sqrt(2.0 * np.log(2.0)))
_MIN_SCALE, _MAX_SCALE = 0.05, 20.0
_MIN_GAIN = 1e-4
_MAX_DAMPING = 1e6
_FOCAL_SD, _FIXED_SD, _OFFSET_SD_S = 0.4, 1e-3, 0.1
_GAUGE_PRECISION = 1e-6
_MIN_COSINE = 0.05
_MIN_SHARE = 0.05
_LOOSE_SD = 1e6
_MIN_VIEWS = 3
"""Views from which the noise of each can be estimated."""


@dataclass(frozen=True, eq=False)
class BodyState:
    """Hold the parameters of a bundle adjustment of bodies.

    Attributes:
        rotations: shape (view, 3, 3), camera from world.
        centers: shape (view, 3).
        shift_s: shape (view,): by which observations are taken later than the samples.
        log_focal: shape (view,): change of the logarithm of the focal length since the samples were taken.
        points: shape (sample, keypoint, 3), NaN where unknown.
        log_lengths: shape (person, length).
        scale: shape (view,): noise relative to the nominal one.
        focal_spread: standard deviation of the logarithms of the focal lengths around a common factor.
        focal_middle: shape (view,): logarithms around which focal lengths are; their mean is fixed.
    """

    rotations: np.ndarray
    centers: np.ndarray
    shift_s: np.ndarray
    log_focal: np.ndarray
    points: np.ndarray
    log_lengths: np.ndarray
    scale: np.ndarray
    focal_spread: float = 0.2
    focal_middle: np.ndarray | None = None

    def moved(self, change: np.ndarray, points_step: np.ndarray) -> "BodyState":
        """Return the state after a step of the parameters and of the points (sample, keypoint, 3)."""
        n = len(self.rotations)
        views = change[: n * VIEW_COLUMNS].reshape(n, VIEW_COLUMNS)
        turns = np.array([rotation_from_vector(row) for row in views[:, ROTATION:CENTER]])
        return replace(
            self,
            rotations=turns @ self.rotations,
            centers=self.centers + views[:, CENTER:OFFSET],
            shift_s=self.shift_s + views[:, OFFSET],
            log_focal=self.log_focal + views[:, FOCAL],
            points=self.points + points_step,
            log_lengths=self.log_lengths + change[n * VIEW_COLUMNS :].reshape(self.log_lengths.shape),
        )


def initial_state(
    samples: BodySamples,
    bones: Bones,
    rotations: np.ndarray,
    centers: np.ndarray,
    log_focal: np.ndarray | None = None,
) -> BodyState:
    """Return the state of cameras with triangulated points and median lengths of bones."""
    n, n_samples, n_keypoints = len(rotations), len(samples.time_s), len(samples.mirror)
    state = BodyState(
        rotations=np.ascontiguousarray(rotations),
        centers=np.ascontiguousarray(centers),
        shift_s=np.zeros(n),
        log_focal=np.zeros(n) if log_focal is None else log_focal,
        points=np.empty((n_samples, n_keypoints, 3)),
        log_lengths=np.zeros((0, 0)),
        scale=np.ones(n),
    )
    triangulate_rays(state.rotations, state.centers, moved_rays(samples, state), state.points)
    return replace(state, log_lengths=median_log_lengths(samples, bones, state.points))


def median_log_lengths(samples: BodySamples, bones: Bones, points: np.ndarray) -> np.ndarray:
    """Return the median logarithmic lengths of bones, shape (person, length); the mean of the others where unknown."""
    n_people, n_lengths = int(samples.person.max(initial=0)) + 1, int(bones.length.max(initial=-1)) + 1
    out = np.full((n_people, n_lengths), np.nan)
    lengths = np.log(np.linalg.norm(points[:, bones.ends[:, 0]] - points[:, bones.ends[:, 1]], axis=-1) + 1e-12)
    for p in range(n_people):
        for length in range(n_lengths):
            of_both = lengths[samples.person == p][:, bones.length == length]
            if np.isfinite(of_both).any():
                out[p, length] = np.nanmedian(of_both)
    known = np.isfinite(out)
    return np.where(known, out, out[known].mean() if known.any() else 0.0)


def adjust_bodies(
    samples: BodySamples, bones: Bones, state: BodyState, free: np.ndarray, rounds: int = 2, max_steps: int = 10
) -> BodyState:
    """Adjust cameras and bodies.

    Args:
        samples: observations.
        bones: bones of the skeleton.
        state: initial parameters.
        free: shape (view, VIEW_COLUMNS), bool: free parameters of the views.
        rounds: number of estimates of the noise of each view, each followed by at most ``max_steps`` steps.
        max_steps: bound on the steps of a round.
    """
    columns = np.concatenate(
        [np.flatnonzero(free.ravel()), free.size + np.arange(state.log_lengths.size, dtype=np.int64)]
    )
    for _ in range(rounds):
        state = replace(state, scale=noise_scales(samples, bones, state))
        state = _descend(samples, bones, state, columns, max_steps)
    return state


def residuals_of(samples: BodySamples, state: BodyState) -> np.ndarray:
    """Return residuals in units of the nominal noise, shape (sample, view, keypoint)."""
    out = np.empty(samples.observed.shape[:3])
    body_residuals(state.rotations, state.centers, state.points, moved_rays(samples, state), out)
    return out


def noise_scales(samples: BodySamples, bones: Bones, state: BodyState) -> np.ndarray:
    """Return the noise of each view relative to the nominal one, shape (view,).

    Two views do not show which of them is noisier, so that they have the same.
    """
    residuals = residuals_of(samples, state)
    unfitted = np.sqrt(residual_share(samples, bones, state))
    if samples.n_views < _MIN_VIEWS:
        return np.full(samples.n_views, bounded_scale(median_scale(residuals) / unfitted))
    out = np.array([median_scale(residuals[:, v]) for v in range(samples.n_views)]) / unfitted
    # Half way to the median, so that a view that the points follow does not gain much more influence by it.
    return np.clip(np.sqrt(out * np.median(out)), _MIN_SCALE, _MAX_SCALE)


def residual_share(samples: BodySamples, bones: Bones, state: BodyState) -> float:
    """Return which share of the variance of the errors is left in the residuals, as the points follow the rest.

    It is the share of the degrees of freedom (H. D. Patterson and R. Thompson, "Recovery of inter-block information
    when block sizes are unequal", Biometrika 58, 1971): without it, bones that stretch seem to make detections exact.
    """
    loose = replace(bones, sd=np.full_like(bones.sd, _LOOSE_SD))
    followed = _Terms.of(samples, loose, state).points
    matrices = _regular(_Terms.of(samples, bones, state).points)
    n = 2.0 * np.isfinite(samples.observed[..., 0]).sum()
    fitted = float(np.einsum("sij,sji->", np.linalg.inv(matrices), followed))
    return float(np.clip(1.0 - fitted / max(n, 1.0), _MIN_SHARE, 1.0))


def points_information(samples: BodySamples, bones: Bones, state: BodyState) -> np.ndarray:
    """Return the information on the points of each sample, shape (sample, 3 keypoints, 3 keypoints)."""
    return _Terms.of(samples, bones, state).points


def _regular(matrices: np.ndarray) -> np.ndarray:
    """Return information on points, (sample, 3 keypoints, 3 keypoints), that is regular where points are missing."""
    out = matrices.copy()
    diagonal = np.einsum("sii->si", out)
    diagonal[...] = np.where(diagonal > 0.0, diagonal * (1.0 + 1e-9), 1.0)
    return out


def median_scale(residuals: np.ndarray) -> float:
    """Return the noise relative to the nominal one by the median residual, NaN where missing; 1 without any."""
    known = residuals[~np.isnan(residuals)]
    return float(np.median(np.minimum(known, 1e6))) / _MEDIAN_LENGTH if len(known) else 1.0


def bounded_scale(scale: float) -> float:
    """Return a plausible scale of the noise."""
    return min(max(scale, _MIN_SCALE), _MAX_SCALE)


def pooled_scale(residuals: np.ndarray) -> float:
    """Return the noise of all views relative to the nominal one; residuals have any shape, NaN where missing."""
    return bounded_scale(median_scale(residuals))


def moved_rays(samples: BodySamples, state: BodyState) -> np.ndarray:
    """Return the observations after the changes of time offsets and focal lengths since the samples were taken."""
    if not (state.shift_s.any() or state.log_focal.any()):
        return samples.observed
    out = samples.observed.copy()
    out[..., :3] += state.shift_s[:, None, None] * samples.observed[..., 3:6]
    # A longer focal length moves the rays to the optical axis, and makes the same error in px a smaller angle.
    shrink = np.exp(-state.log_focal)[:, None]
    along = out[..., 2].copy()
    out[..., :2] *= shrink[..., None]
    out[..., :3] /= np.linalg.norm(out[..., :3], axis=-1, keepdims=True)
    # A pixel is cos^2 of the angle along the radius and cos across it; their geometric mean is used.
    out[..., 9] *= shrink * (np.maximum(out[..., 2], _MIN_COSINE) / np.maximum(along, _MIN_COSINE)) ** 1.5
    out[..., 6:9] = focal_changes(out[..., :3])
    return out


def _descend(samples: BodySamples, bones: Bones, state: BodyState, columns: np.ndarray, max_steps: int) -> BodyState:
    """Run Levenberg-Marquardt steps at a fixed noise."""
    damping = 1e-3
    terms = _Terms.of(samples, bones, state)
    for _ in range(max_steps):
        gain = 0.0
        while damping < _MAX_DAMPING:
            step = terms.step(columns, damping)
            candidate = None if step is None else state.moved(*step)
            new_terms = None if candidate is None else _Terms.of(samples, bones, candidate)
            if candidate is not None and new_terms is not None and new_terms.cost < terms.cost:
                gain = terms.cost - new_terms.cost
                state, terms = candidate, new_terms
                damping = max(0.2 * damping, 1e-7)
                break
            damping *= 5.0
        if gain <= _MIN_GAIN * (1.0 + terms.cost):
            break
    return state


def _focal_precision(n_views: int, state: BodyState) -> np.ndarray:
    """Return the precision of the prior of focal lengths: a common factor, and the spread of the cameras around it."""
    common = np.full((n_views, n_views), 1.0 / n_views)
    sd = _FOCAL_SD if state.focal_middle is None else _FIXED_SD
    return (np.eye(n_views) - common) / state.focal_spread**2 + common / sd**2


@dataclass(frozen=True, eq=False)
class _Terms:
    """Hold the terms of the normal equations of a state."""

    cost: float
    points: np.ndarray
    mixed: np.ndarray
    matrix: np.ndarray
    gradient: np.ndarray

    @classmethod
    def of(cls, samples: BodySamples, bones: Bones, state: BodyState) -> "_Terms":
        n_samples, n_views, n_keypoints = samples.observed.shape[:3]
        size = n_views * VIEW_COLUMNS + state.log_lengths.size
        points = np.zeros((n_samples, 3 * n_keypoints, 3 * n_keypoints))
        mixed = np.zeros((n_samples, 3 * n_keypoints, size + 1))
        views = np.zeros((size, size + 1))
        n_lengths = state.log_lengths.shape[1]
        columns = n_views * VIEW_COLUMNS + samples.person[:, None] * n_lengths + bones.length
        cost = body_terms(
            state.rotations,
            state.centers,
            state.points,
            np.ascontiguousarray(state.log_lengths[samples.person][:, bones.length]),
            moved_rays(samples, state),
            state.scale,
            (bones.ends, bones.sd, columns),
            (points, mixed, views),
        )
        matrix, gradient = views[:, :-1].copy(), views[:, -1].copy()
        middle = np.zeros(n_views) if state.focal_middle is None else state.focal_middle
        for column, values, precision in (
            (OFFSET, state.shift_s, np.eye(n_views) / _OFFSET_SD_S**2),
            (FOCAL, state.log_focal - middle, _focal_precision(n_views, state)),
        ):
            places = np.arange(n_views) * VIEW_COLUMNS + column
            matrix[np.ix_(places, places)] += precision
            gradient[places] += precision @ values
            cost += 0.5 * float(values @ precision @ values)
        return cls(float(cost), points, mixed, matrix, gradient)

    def step(self, columns: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the damped step of the free parameters and of the points; None if the equations are singular."""
        factors = self.points.copy()
        eliminated = np.ascontiguousarray(self.mixed[:, :, np.append(columns, self.mixed.shape[2] - 1)])
        reduced = np.zeros((len(columns) + 1, len(columns) + 1))
        eliminate_points(factors, eliminated, damping, reduced)
        matrix = self.matrix[np.ix_(columns, columns)]
        matrix[np.diag_indices_from(matrix)] *= 1.0 + damping
        matrix[np.diag_indices_from(matrix)] += _GAUGE_PRECISION * np.trace(matrix) / max(len(matrix), 1)
        lower = np.tril(reduced)[:-1, :-1]
        matrix -= lower + lower.T - np.diag(np.diag(lower))
        change = np.zeros(len(self.gradient))
        try:
            change[columns] = -np.linalg.solve(matrix, self.gradient[columns] - reduced[-1, :-1])
        except np.linalg.LinAlgError:
            return None
        steps = np.empty(factors.shape[:2])
        step_of_points(factors, eliminated, change[columns], steps)
        return change, steps.reshape(len(steps), -1, 3)
