"""The linearised question: by how much would the views agree better if this or that were a little different?

Points are eliminated (Schur's complement), so that every unknown of every view is judged with points free to move.
Sums are kept by block of time and by column: how blocks and columns scatter about their common answer says how many
independent observations there are. Detectors' errors last for seconds and each keypoint has habits of its own.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.points import TAILS, Points
from posefuse.diagnostics.state import N_COLUMNS, Column, State

_SMOOTH_S = 0.3
_LEAST_TOLD = 1e-3


@dataclass(frozen=True, eq=False)
class Sums:
    """Normal equations of all views' unknowns, by cluster of observations.

    Attributes:
        normal: shape (cluster, unknown, unknown); unknowns are views by columns of :class:`Column`.
        right: shape (cluster, unknown).
    """

    normal: np.ndarray
    right: np.ndarray


@dataclass(frozen=True, eq=False)
class System:
    """What one look at the recording tells.

    Attributes:
        blocks: by block of time.
        columns: by column.
        block_of: shape (sample,), int.
        time_s: shape (block,): of the middle of each block.
        seen: shape (view,): observations that other views check.
        lasts_s: how much time was looked at.
    """

    blocks: Sums
    columns: Sums
    block_of: np.ndarray
    time_s: np.ndarray
    seen: np.ndarray
    lasts_s: float


def block_of(time_s: np.ndarray, runs: np.ndarray, block_s: float) -> np.ndarray:
    """Shape (sample,), int: blocks of time, none across two pieces of a recording."""
    start = np.array([time_s[runs == run].min() for run in runs])
    key = np.stack([runs, np.floor((time_s - start) / block_s)], axis=1)
    return np.unique(key, axis=0, return_inverse=True)[1].ravel()


def linearise(evidence: Evidence, state: State, points: Points, block: np.ndarray) -> System:
    """The normal equations of what can be wrong, at what is believed."""
    time_s = evidence.frame_time_s[state.frames]
    columns = derivatives(points, velocities(points.points_m, time_s, evidence.runs[state.frames]), state)
    by_world = points.jacobian @ state.rotation[:, None]
    weight = points.weight[..., None, None]
    # Views that see a point alone tell nothing; a point of two views tells one number.
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
    straight = np.einsum("scvki,scvkj->scvij", rows, rows)
    right = np.einsum("scvki,scvk->scvi", rows, points.residual * root[..., None])
    cross = inverse[:, :, None] @ np.swapaxes(by_world * root[..., None, None], -1, -2) @ rows
    n_samples, n_columns, n_views = points.weight.shape
    size = n_views * N_COLUMNS
    cross = np.swapaxes(cross, 2, 3).reshape(n_samples, n_columns, 3, size)
    right = right.reshape(n_samples, n_columns, size)
    n_blocks = int(block.max()) + 1
    return System(
        blocks=_sums(straight, cross, right, block, n_blocks, curve),
        columns=_sums(
            np.swapaxes(straight, 0, 1),
            np.swapaxes(cross, 0, 1),
            np.swapaxes(right, 0, 1),
            np.arange(n_columns),
            n_columns,
            curve,
        ),
        block_of=block,
        time_s=np.array([time_s[block == b].mean() for b in range(n_blocks)]),
        lasts_s=_lasts(time_s, block),
        seen=(points.weight > 0)[(points.weight > 0).sum(axis=-1) >= 2].sum(axis=0),
    )


def _lasts(time_s: np.ndarray, block: np.ndarray) -> float:
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    return sum(float(np.ptp(time_s[block == b])) + step for b in np.unique(block))


def curvature(points: Points) -> float:
    """How fast scores change with what is believed, over what reweighted least squares make of it.

    Weights fall as residuals grow, so that the score of Student's t bends: 0.7 where residuals are free to be as they
    are, nearer 1 where points follow them. Without it steps are too short and standard deviations too small.
    """
    told = (points.weight > 0) & ((points.weight > 0).sum(axis=-1) >= 2)[..., None]
    weight, squared = points.weight[told], np.square(points.residual).sum(axis=-1)[told]
    if not len(weight):
        return 1.0
    return float((weight * (1.0 - weight * squared / (TAILS + 2.0))).sum() / weight.sum())


def _sums(straight: np.ndarray, cross: np.ndarray, right: np.ndarray, of: np.ndarray, n: int, curve: float) -> Sums:
    views, size = straight.shape[2], right.shape[-1]
    normal, total = np.zeros((n, size, size)), np.zeros((n, size))
    for cluster in range(n):
        mine = of == cluster
        lever = cross[mine].reshape(-1, size)
        normal[cluster] = -(lever.T @ lever)
        own = straight[mine].sum(axis=(0, 1))
        for v in range(views):
            at = slice(v * N_COLUMNS, (v + 1) * N_COLUMNS)
            normal[cluster, at, at] += own[v]
        total[cluster] = right[mine].sum(axis=(0, 1))
    return Sums(curve * normal, total)


def derivatives(points: Points, velocity_m_s: np.ndarray, state: State) -> np.ndarray:
    """Shape (sample, column, view, 2, unknown): how expected observations move, in units of the noise."""
    jacobian, inside, sigma = points.jacobian, points.inside, points.sigma
    x, y, z = np.moveaxis(inside, -1, 0)
    zero = np.zeros_like(x)
    turn = -np.stack([np.stack(row, axis=-1) for row in ([zero, -z, y], [z, zero, -x], [-y, x, zero])], axis=-2)
    with np.errstate(invalid="ignore", divide="ignore"):
        at = inside[..., :2] / z[..., None]
        at = np.where((points.weight > 0)[..., None], at / sigma[..., None], 0.0)
        radius2 = np.where(points.weight > 0, (x**2 + y**2) / z**2, 0.0)
    moved = np.einsum("svij,scj->scvi", state.rotation, velocity_m_s)
    out = np.zeros((*jacobian.shape[:-1], N_COLUMNS))
    out[..., :3] = jacobian @ turn
    out[..., 3:6] = jacobian
    out[..., Column.FOCAL] = at
    out[..., Column.ASPECT] = at * np.array([0.5, -0.5])
    out[..., Column.BEND] = at * radius2[..., None]
    out[..., Column.LATE] = (jacobian @ moved[..., None])[..., 0]
    return out


def velocities(points_m: np.ndarray, time_s: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Shape (sample, column, 3), m/s: of straight lines through a few samples around each; 0 where nobody knows."""
    total = np.zeros((*points_m.shape[:2], 3))
    moment, spread, weight = np.zeros_like(total), np.zeros(points_m.shape[:2]), np.zeros(points_m.shape[:2])
    first = np.zeros(points_m.shape[:2])
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    reach = max(1, round(_SMOOTH_S / step))
    for shift in range(-reach, reach + 1):
        at = np.clip(np.arange(len(time_s)) + shift, 0, len(time_s) - 1)
        apart = time_s[at] - time_s
        near = (runs[at] == runs) & (np.abs(apart) < (reach + 0.5) * step) & ((at - np.arange(len(time_s))) == shift)
        known = near[:, None] & np.isfinite(points_m[at]).all(axis=-1)
        value = np.where(known[..., None], points_m[at], 0.0)
        total += value
        moment += value * apart[:, None, None]
        first += known * apart[:, None]
        spread += known * apart[:, None] ** 2
        weight += known
    with np.errstate(invalid="ignore", divide="ignore"):
        slack = weight * spread - first**2
        slope = (weight[..., None] * moment - first[..., None] * total) / slack[..., None]
    return np.where(((weight >= 2) & (slack > _LEAST_TOLD * step**2))[..., None], slope, 0.0)
