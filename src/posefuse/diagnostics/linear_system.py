"""Linearized normal equations of all view parameters, with the points eliminated.

Points are eliminated by Schur complement, so that every parameter of every view is judged with the points free to move.
Sums are kept per block of time and per column: how blocks and columns scatter about their common solution shows how
many independent observations there are. Detection errors are correlated over seconds, and every keypoint has systematic
errors of its own.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import N_PARAMETERS, Parameter, RecordingModel
from posefuse.diagnostics.sample_points import STUDENT_T_DOF, SamplePoints

_WINDOW_S = 0.3
_MIN_SPREAD = 1e-3


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Hold normal equations of all view parameters, per cluster of observations.

    Attributes:
        normal: shape (cluster, unknown, unknown); the unknown axis enumerates views, then
            :class:`~posefuse.diagnostics.recording_model.Parameter`.
        right: shape (cluster, unknown): right-hand side.
    """

    normal: np.ndarray
    right: np.ndarray


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Hold the linearized problem at one recording model.

    Attributes:
        blocks: normal equations per block of time.
        columns: normal equations per column.
        block_index: shape (sample,), int: block of each sample.
        time_s: shape (block,): mean time of each block.
        n_checked: shape (view,): number of observations of points that another view observes too.
        duration_s: length of the sampled time.
    """

    blocks: NormalEquations
    columns: NormalEquations
    block_index: np.ndarray
    time_s: np.ndarray
    n_checked: np.ndarray
    duration_s: float


def time_blocks(time_s: np.ndarray, runs: np.ndarray, block_s: float) -> np.ndarray:
    """Return the block of time of each sample, shape (sample,), int; no block spans two pieces of the recording."""
    start = np.array([time_s[runs == run].min() for run in runs])
    key = np.stack([runs, np.floor((time_s - start) / block_s)], axis=1)
    return np.unique(key, axis=0, return_inverse=True)[1].ravel()


def linearize(
    observations: TrackedObservations, model: RecordingModel, points: SamplePoints, block_index: np.ndarray
) -> LinearSystem:
    """Return the normal equations at a recording model."""
    time_s = observations.frame_time_s[model.frames]
    columns = derivatives(points, velocities(points.points_m, time_s, observations.runs[model.frames]), model)
    by_world = points.jacobian @ model.rotation[:, None]
    weight = points.weight[..., None, None]
    # A point seen by one view carries no information about parameters.
    normal = np.einsum("scvki,scvkj->scij", by_world * weight, by_world)
    trace = np.trace(normal, axis1=-2, axis2=-1)
    good = np.isfinite(trace) & (trace > 0) & ((points.weight > 0).sum(axis=-1) >= 2)
    normal = np.where(good[..., None, None], normal, np.eye(3))
    inverse = np.linalg.inv(
        np.linalg.cholesky(normal + 1e-9 * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] * np.eye(3))
    )
    root = np.sqrt(np.where(good[..., None], points.weight, 0.0))
    curve = curvature(points)
    rows = columns * root[..., None, None]
    direct = np.einsum("scvki,scvkj->scvij", rows, rows)
    right = np.einsum("scvki,scvk->scvi", rows, points.residual * root[..., None])
    cross = inverse[:, :, None] @ np.swapaxes(by_world * root[..., None, None], -1, -2) @ rows
    n_samples, n_columns, n_views = points.weight.shape
    size = n_views * N_PARAMETERS
    cross = np.swapaxes(cross, 2, 3).reshape(n_samples, n_columns, 3, size)
    right = right.reshape(n_samples, n_columns, size)
    n_blocks = int(block_index.max()) + 1
    return LinearSystem(
        blocks=_clustered_equations(direct, cross, right, block_index, n_blocks, curve),
        columns=_clustered_equations(
            np.swapaxes(direct, 0, 1),
            np.swapaxes(cross, 0, 1),
            np.swapaxes(right, 0, 1),
            np.arange(n_columns),
            n_columns,
            curve,
        ),
        block_index=block_index,
        time_s=np.array([time_s[block_index == b].mean() for b in range(n_blocks)]),
        duration_s=_sampled_duration_s(time_s, block_index),
        n_checked=(points.weight > 0)[(points.weight > 0).sum(axis=-1) >= 2].sum(axis=0),
    )


def _sampled_duration_s(time_s: np.ndarray, block: np.ndarray) -> float:
    """Return the length of the sampled time, summed over blocks."""
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    return sum(float(np.ptp(time_s[block == b])) + step for b in np.unique(block))


def curvature(points: SamplePoints) -> float:
    """Return the curvature of the Student-t likelihood relative to that of reweighted least squares.

    Weights fall as residuals grow, so the score function is concave: the ratio is about 0.7 where residuals are
    unconstrained and closer to 1 where points follow the observations. Without it, steps are too short and standard
    deviations too small.
    """
    checked = (points.weight > 0) & ((points.weight > 0).sum(axis=-1) >= 2)[..., None]
    weight, squared = points.weight[checked], np.square(points.residual).sum(axis=-1)[checked]
    if not len(weight):
        return 1.0
    return float((weight * (1.0 - weight * squared / (STUDENT_T_DOF + 2.0))).sum() / weight.sum())


def _clustered_equations(
    direct: np.ndarray, cross: np.ndarray, right: np.ndarray, cluster_of: np.ndarray, n: int, curve: float
) -> NormalEquations:
    """Sum the reduced normal equations of the samples of each cluster."""
    views, size = direct.shape[2], right.shape[-1]
    normal, total = np.zeros((n, size, size)), np.zeros((n, size))
    for cluster in range(n):
        members = cluster_of == cluster
        coupling = cross[members].reshape(-1, size)
        normal[cluster] = -(coupling.T @ coupling)
        own = direct[members].sum(axis=(0, 1))
        for v in range(views):
            rows = slice(v * N_PARAMETERS, (v + 1) * N_PARAMETERS)
            normal[cluster, rows, rows] += own[v]
        total[cluster] = right[members].sum(axis=(0, 1))
    return NormalEquations(curve * normal, total)


def derivatives(points: SamplePoints, velocity_m_s: np.ndarray, model: RecordingModel) -> np.ndarray:
    """Return derivatives of the projections, shape (sample, column, view, 2, parameter).

    Derivatives are by view parameters and in units of the noise.
    """
    jacobian, camera_xyz, sigma = points.jacobian, points.camera_xyz, points.sigma
    x, y, z = np.moveaxis(camera_xyz, -1, 0)
    zero = np.zeros_like(x)
    by_rotation = -np.stack([np.stack(row, axis=-1) for row in ([zero, -z, y], [z, zero, -x], [-y, x, zero])], axis=-2)
    with np.errstate(invalid="ignore", divide="ignore"):
        projected = camera_xyz[..., :2] / z[..., None]
        projected = np.where((points.weight > 0)[..., None], projected / sigma[..., None], 0.0)
        radius2 = np.where(points.weight > 0, (x**2 + y**2) / z**2, 0.0)
    moved = np.einsum("svij,scj->scvi", model.rotation, velocity_m_s)
    out = np.zeros((*jacobian.shape[:-1], N_PARAMETERS))
    out[..., :3] = jacobian @ by_rotation
    out[..., 3:6] = jacobian
    out[..., Parameter.FOCAL] = projected
    out[..., Parameter.ASPECT] = projected * np.array([0.5, -0.5])
    out[..., Parameter.K1] = projected * radius2[..., None]
    out[..., Parameter.OFFSET] = (jacobian @ moved[..., None])[..., 0]
    return out


def velocities(points_m: np.ndarray, time_s: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Return velocities in m/s, shape (sample, column, 3), from line fits over neighboring samples.

    Velocities are 0 where too few samples determine them.
    """
    total = np.zeros((*points_m.shape[:2], 3))
    moment, spread, weight = np.zeros_like(total), np.zeros(points_m.shape[:2]), np.zeros(points_m.shape[:2])
    first = np.zeros(points_m.shape[:2])
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    reach = max(1, round(_WINDOW_S / step))
    for shift in range(-reach, reach + 1):
        neighbor = np.clip(np.arange(len(time_s)) + shift, 0, len(time_s) - 1)
        apart = time_s[neighbor] - time_s
        near = (
            (runs[neighbor] == runs)
            & (np.abs(apart) < (reach + 0.5) * step)
            & ((neighbor - np.arange(len(time_s))) == shift)
        )
        known = near[:, None] & np.isfinite(points_m[neighbor]).all(axis=-1)
        value = np.where(known[..., None], points_m[neighbor], 0.0)
        total += value
        moment += value * apart[:, None, None]
        first += known * apart[:, None]
        spread += known * apart[:, None] ** 2
        weight += known
    with np.errstate(invalid="ignore", divide="ignore"):
        slack = weight * spread - first**2
        slope = (weight[..., None] * moment - first[..., None] * total) / slack[..., None]
    return np.where(((weight >= 2) & (slack > _MIN_SPREAD * step**2))[..., None], slope, 0.0)
