"""Normal equations of all views' poses and clocks, with the points eliminated, and the influence of each error.

The derivative by the time offset is the velocity of a point. A velocity measured by the same detections contains their
errors, which would pretend information about the clock of a person who stands still. It is therefore shrunk by the
share of its variance that errors explain (regression calibration: Carroll et al. 2006, Measurement Error in Nonlinear
Models).
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.joint.noise_law import STUDENT_T_DOF
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.triangulated import student_t_weights, triangulate
from posefuse.calibration.joint.velocities import support_frames
from posefuse.kernels.calibration.joint import (
    FOCAL,
    PRINCIPAL,
    joint_rows,
    second_derivatives,
)

_MIN_SHARE, _MIN_FACTOR, _SHRINKAGE, _MIN_FIRMNESS = 0.05, 0.6, 0.5, 0.1
_MIN_MOVING, _MIN_SCALE = 0.3, 0.1
_MIN_RESIDUALS = 30


@dataclass(frozen=True, eq=False)
class Rows:
    """Hold residuals and derivatives of sampled points at some parameters.

    Attributes:
        frames: shape (sample,): sampled frames.
        time_s: shape (sample,): time since the middle of the samples.
        points_m: shape (sample, column, 3), NaN where unknown.
        support_m: shape (support, column, 3): points of the samples and of the frames around them.
        residual: shape (point, view, 2): observed minus projected in units of the noise.
        by_view: shape (point, view, 2, parameter).
        by_point: shape (point, view, 2, 3).
        seen: shape (point, view), bool.
        weight: shape (point, view): Student-t weights, 0 where not seen.
        scale: shape (view,): noise of each view as a multiple of the expected noise.
        sigma: shape (point, view): noise in the normalized image plane.
        cameras: rotations, shape (view, 3, 3), centers, shape (view, 3), and lenses, shape (view, 2), as in
            :attr:`posefuse.calibration.joint.parameters.JointParameters.lens`.
        velocity_m_s: shape (point, 3): velocities, 0 if most of their variance is error.
        velocity_noise: variance of the errors of velocities, in units of the noise, 1/s^2.
    """

    frames: np.ndarray
    time_s: np.ndarray
    points_m: np.ndarray
    support_m: np.ndarray
    residual: np.ndarray
    by_view: np.ndarray
    by_point: np.ndarray
    seen: np.ndarray
    weight: np.ndarray
    scale: np.ndarray
    sigma: np.ndarray
    cameras: tuple[np.ndarray, np.ndarray, np.ndarray]
    velocity_m_s: np.ndarray
    velocity_noise: float

    @property
    def n_views(self) -> int:
        """Return the number of views."""
        return self.residual.shape[1]

    @property
    def n_parameters(self) -> int:
        """Return the number of parameters of each view."""
        return self.by_view.shape[3]

    @property
    def curvature(self) -> float:
        """Return the mean curvature of the Student-t likelihood, 1 for Gaussian errors of unit variance."""
        weight, squared = self.weight[self.seen], self.squared[self.seen]
        if not len(weight):
            return 1.0
        return max(float((weight * (1.0 - weight * squared / (STUDENT_T_DOF + 2.0))).mean()), 0.1)

    @property
    def squared(self) -> np.ndarray:
        """Return the squared lengths of the residuals, shape (point, view)."""
        return np.einsum("nvk,nvk->nv", self.residual, self.residual)

    @property
    def relative_curvature(self) -> float:
        """Return the curvature relative to that of reweighted least squares."""
        return self.curvature / float(self.weight[self.seen].mean()) if self.seen.any() else 1.0

    @property
    def scores(self) -> np.ndarray:
        """Return residuals times weights, shape (point, view, 2)."""
        return self.residual * self.weight[..., None]

    def leverage(self) -> np.ndarray:
        """Return the share of each view's errors that the points absorb, shape (point, view)."""
        inverse = _inverse(np.einsum("nvki,nvkj->nij", self.by_point, self.by_point))
        return 0.5 * np.einsum("nvki,nij,nvkj->nv", self.by_point, inverse, self.by_point)


def linearize(
    recording: JointRecording,
    frames: np.ndarray,
    parameters: JointParameters,
    scale: np.ndarray,
    start_m: np.ndarray | None = None,
) -> Rows:
    """Triangulate the sampled points and return their residuals and derivatives.

    Args:
        recording: the keypoints.
        frames: shape (sample,): frames to use, ascending.
        parameters: poses and clocks.
        scale: shape (view,): noise of each view as a multiple of the expected noise.
        start_m: shape (support, column, 3): starting points, such as :attr:`Rows.support_m` of other parameters.
    """
    support = support_frames(recording, frames)
    moments_s = recording.moments_s
    time_s = moments_s[support.frames] - 0.5 * (moments_s[frames[0]] + moments_s[frames[-1]])
    observed = triangulate(recording, support.frames, time_s, parameters, scale, start_m)
    points, cameras, n_views = observed.points_m, observed.cameras, recording.n_views
    velocity = support.slopes(points, time_s).reshape(-1, 3)
    slopes = support.slopes(observed.scores(), time_s).reshape(-1, n_views, 2)
    at = support.center
    xy, sigma = observed.xy[at].reshape(-1, n_views, 2), observed.sigma[at].reshape(-1, n_views)
    n = len(xy)
    residual, by_point = np.empty((n, n_views, 2)), np.empty((n, n_views, 2, 3))
    by_view = np.empty((n, n_views, 2, parameters.size))
    cameras = *cameras, parameters.lens
    motion = velocity, np.repeat(time_s[at], points.shape[1])
    joint_rows(xy, sigma, cameras, points[at].reshape(-1, 3), motion, residual, by_view, by_point)
    seen = np.asarray(by_point.any(axis=(2, 3)))
    weight = np.where(seen, student_t_weights(residual), 0.0)
    rows = Rows(
        frames,
        time_s[at],
        points[at],
        points,
        residual,
        by_view,
        by_point,
        seen,
        weight,
        scale,
        sigma,
        cameras,
        velocity,
        0.0,
    )
    return _with_velocity_noise(rows, slopes)


def _with_velocity_noise(rows: Rows, slopes: np.ndarray) -> Rows:
    """Return the rows with the variance of the errors of the velocities; without velocities if these are mere errors.

    The errors of velocities follow from the derivatives of the scores by time, ``slopes`` of shape (point, view, 2):
    both are projections of the same errors.
    """
    still = replace(rows, velocity_m_s=np.zeros_like(rows.velocity_m_s), by_view=_without_clocks(rows.by_view))
    known = rows.velocity_m_s.any(axis=1) & (rows.seen.sum(axis=1) > 1)
    if not known.any():
        return still
    information = _by_points(rows, np.broadcast_to(np.eye(2), (*rows.seen.shape, 2, 2)))[known]
    observed = np.einsum("ni,nij,nj->n", rows.velocity_m_s[known], information, rows.velocity_m_s[known])
    changed = known[:, None] & rows.seen & slopes.any(axis=-1)
    if not changed.any():
        return still
    # Relative to the scores' variance, and times that of a maximum-likelihood estimate.
    changing = np.square(slopes).sum(axis=-1)[changed].sum() / np.square(rows.scores).sum(axis=-1)[changed].sum()
    noise = float(changing * (STUDENT_T_DOF + 4.0) / (STUDENT_T_DOF + 2.0))
    limit = np.percentile(observed, 98.0)
    moving = 1.0 - 3.0 * noise / max(float(np.minimum(observed, limit).mean()), 1e-12)
    return still if moving < _MIN_MOVING else replace(rows, velocity_noise=noise)


def _without_clocks(by_view: np.ndarray) -> np.ndarray:
    """Return derivatives without those by the clocks."""
    out = by_view.copy()
    out[..., 6:8] = 0.0
    return out


def pretended_information(rows: Rows) -> np.ndarray:
    """Return the part of the normal equations that is due to the errors of the velocities."""
    n_views = rows.n_views
    each = rows.n_parameters
    size = n_views * each
    out = np.zeros((size, size))
    if rows.velocity_noise == 0.0:
        return out
    root = np.linalg.cholesky(_inverse(_by_points(rows, np.broadcast_to(np.eye(2), (*rows.seen.shape, 2, 2)))))
    scaled = rows.by_point @ root[:, None]
    squares = np.swapaxes(scaled, -1, -2) @ scaled
    own = np.trace(squares, axis1=-2, axis2=-1)
    entries = np.moveaxis(squares.reshape(-1, n_views, 9), 2, 0)
    moving = rows.curvature * rows.velocity_noise * rows.velocity_m_s.any(axis=1)
    when = np.repeat(rows.time_s, rows.points_m.shape[1])
    for a, b in ((6, 6), (6, 7), (7, 6), (7, 7)):
        weight = moving * when ** (a + b - 12)
        shared = np.diag(weight @ own) - (np.swapaxes(entries, 1, 2) @ (weight[:, None] * entries)).sum(axis=0)
        out[a::each, b::each] = shared
    return out


def normal_equations(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Return the reweighted normal equations with the points eliminated, and their right-hand side."""
    n_views = rows.n_views
    each = rows.n_parameters
    size = n_views * each
    weighted = rows.by_point * rows.weight[..., None, None]
    inverse = _inverse(np.einsum("nvki,nvkj->nij", weighted, rows.by_point))
    coupling = np.einsum("nvki,nvkp->nivp", weighted, rows.by_view, optimize=True).reshape(-1, 3, size)
    root = np.linalg.cholesky(inverse)
    reduced = (np.swapaxes(root, 1, 2) @ coupling).reshape(-1, size)
    normal = -(reduced.T @ reduced)
    for v in range(n_views):
        at = slice(v * each, (v + 1) * each)
        own = rows.by_view[:, v].reshape(-1, each)
        normal[at, at] += own.T @ (own * np.repeat(rows.weight[:, v], 2)[:, None])
    score = rows.scores
    total = np.einsum("nvk,nvkp->vp", score, rows.by_view, optimize=True).ravel()
    by_points = np.einsum("nvk,nvki->ni", score, rows.by_point)
    total -= np.einsum("ni,nip->p", (inverse @ by_points[..., None])[..., 0], coupling, optimize=True)
    return normal, total


def observed_curvature(rows: Rows) -> np.ndarray:
    """Return the second derivative of the cost with the points eliminated, shape (parameter, parameter).

    Unlike the reweighted normal equations, it contains the change of the weights and the second derivatives of the
    projections. Without the latter, the errors of the points pretend information about directions that the points
    barely determine: the curvature there is a quarter too large for a person who stands still. Points whose own
    equations are then not positive definite keep constant weights and first derivatives.
    """
    n_views, each = rows.n_views, rows.n_parameters
    size = n_views * each
    _, bent, coupling, inverse, by_view = _bent(rows)
    root = np.linalg.cholesky(inverse)
    reduced = (np.swapaxes(root, 1, 2) @ coupling).reshape(-1, size)
    normal = -(reduced.T @ reduced)
    for v in range(n_views):
        at = slice(v * each, (v + 1) * each)
        own = rows.by_view[:, v].reshape(-1, each).T @ bent[:, v].reshape(-1, each)
        normal[at, at] += own + by_view[v]
    return 0.5 * (normal + normal.T)


def score_responses(rows: Rows) -> np.ndarray:
    """Return by how much every score falls with every parameter, shape (point, view, 2, parameter).

    The points follow the parameters. Second derivatives count only in how the points follow.
    """
    n, n_views, each = len(rows.seen), rows.n_views, rows.n_parameters
    bend, bent, coupling, inverse, _ = _bent(rows)
    by_point = (bend @ rows.by_point).reshape(n, 2 * n_views, 3)
    out = -(by_point @ (inverse @ coupling)).reshape(n, n_views, 2, -1)
    for v in range(n_views):
        out[:, v, :, v * each : (v + 1) * each] += bent[:, v]
    return out


def _bent(rows: Rows) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return second derivatives of the cost.

    Returns:
        By the residuals, shape (point, view, 2, 2); by residuals and own view, shape (point, view, 2, parameter); by
        points and views, shape (point, 3, parameter); the inverse of those by the points, shape (point, 3, 3); and the
        terms of the second derivatives of the projections by the views.
    """
    outer = rows.residual[..., :, None] * rows.residual[..., None, :]
    falling = 2.0 * outer / (STUDENT_T_DOF + rows.squared)[..., None, None]
    weighted = rows.weight[..., None, None] * np.eye(2)
    bend = weighted - rows.weight[..., None, None] * falling
    by_view, mixed, by_points = _second_derivatives(rows, rows.scores)
    firm = np.linalg.eigvalsh(_by_points(rows, weighted))[:, 0]
    weak = ~(np.linalg.eigvalsh(by_points + _by_points(rows, bend))[:, 0] > _MIN_FIRMNESS * firm)
    if weak.any():
        bend[weak] = weighted[weak]
        by_view, mixed, by_points = _second_derivatives(rows, np.where(weak[:, None, None], 0.0, rows.scores))
    by_points += _by_points(rows, bend)
    bent = bend @ rows.by_view
    coupling = np.einsum("nvki,nvkp->nivp", rows.by_point, bent, optimize=True) + mixed
    return bend, bent, coupling.reshape(len(bent), 3, -1), _inverse(by_points), by_view


def _second_derivatives(rows: Rows, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the terms of the second derivatives of the projections: by views, mixed, and by points."""
    (n, n_views), each = rows.seen.shape, rows.n_parameters
    by_view = np.zeros((n_views, each, each))
    mixed, by_points = np.zeros((n, 3, n_views, each)), np.zeros((n, 3, 3))
    when = np.repeat(rows.time_s, rows.points_m.shape[1])
    points = rows.points_m.reshape(-1, 3)
    motion = (rows.velocity_m_s, when)
    second_derivatives(scores, rows.sigma, rows.cameras[:2], points, motion, by_view, mixed, by_points)
    if each > FOCAL:
        # A projection relative to the principal point is proportional to the focal length.
        both = np.einsum("nvk,nvkp->vp", scores, rows.by_view)[:, :PRINCIPAL]
        by_view[:, FOCAL, :PRINCIPAL] -= both
        by_view[:, :PRINCIPAL, FOCAL] -= both
        by_view[:, FOCAL, FOCAL] += both[:, FOCAL]
        mixed[..., FOCAL] -= np.einsum("nvk,nvki->niv", scores, rows.by_point)
    return by_view, mixed, by_points


def _by_points(rows: Rows, bend: np.ndarray) -> np.ndarray:
    """Return the second derivatives by the points, shape (point, 3, 3)."""
    return np.einsum("nvki,nvkl,nvlj->nij", rows.by_point, bend, rows.by_point, optimize=True)


def influences(rows: Rows) -> np.ndarray:
    """Return the influence of every error on the score of every parameter, shape (point, view, 2, parameter).

    Errors are in units of the noise. The points are eliminated with equal weights, as in the expectation.
    """
    n_views = rows.n_views
    each = rows.n_parameters
    size = n_views * each
    inverse = _inverse(np.einsum("nvki,nvkj->nij", rows.by_point, rows.by_point))
    coupling = np.einsum("nvki,nvkp->nivp", rows.by_point, rows.by_view, optimize=True).reshape(-1, 3, size)
    n = len(inverse)
    out = -(rows.by_point.reshape(n, n_views * 2, 3) @ (inverse @ coupling))
    out = out.reshape(n, n_views, 2, size)
    for v in range(n_views):
        out[:, v, :, v * each : (v + 1) * each] += rows.by_view[:, v]
    return out


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Invert symmetric matrices, shape (point, 3, 3); the inverse of a singular one is 0."""
    trace = np.trace(matrix, axis1=-2, axis2=-1)
    good = np.isfinite(trace) & (trace > 0)
    ridge = np.where(good, 1e-9 * trace, 1.0)[:, None, None] * np.eye(3)
    inverse = np.linalg.inv(np.where(good[:, None, None], matrix, 0.0) + ridge)
    return np.where(good[:, None, None], inverse, 1e-300 * np.eye(3))


def noise_scales(rows: Rows) -> np.ndarray:
    """Return the noise of each view as a multiple of the expected noise, shape (view,), from its residuals.

    A view with little noise attracts the points, and its residuals shrink further. The scales are therefore shrunk
    towards their common value.
    """
    left = 2.0 * np.clip(1.0 - rows.leverage(), _MIN_SHARE, 1.0)
    squared = rows.weight * rows.squared * np.square(rows.scale)
    several = rows.seen & (rows.seen.sum(axis=1) > 2)[:, None]
    used = several if several.sum() >= _MIN_RESIDUALS else rows.seen
    common = squared[used].sum() / left[used].sum() if used.any() else 1.0
    scale = np.full(rows.n_views, common)
    for v in range(rows.n_views):
        known = several[:, v]
        if known.sum() >= _MIN_RESIDUALS:
            own = squared[known, v].sum() / left[known, v].sum()
            scale[v] = common * np.clip((own / common) ** _SHRINKAGE, _MIN_FACTOR**2, _MIN_FACTOR**-2)
    return np.maximum(np.sqrt(scale), _MIN_SCALE)
