"""The cheapest two points of a pair by exhaustive search over view states, for cameras without distortion."""

from itertools import product

import numpy as np

from posefuse.model.cameras import CameraRig

_ROUNDS = 60
# A hundredth of the standard error of a point, squared.
_SMALL_STEP = 1e-4


def bounded(squared: np.ndarray, full: float, none: float) -> np.ndarray:
    """Return the cost whose derivative is the weight ``(1 - u)^2`` of ``consensus``."""
    u = np.clip((squared - full) / (none - full), 0.0, 1.0)
    return np.minimum(squared, full) + (none - full) * (1.0 - (1.0 - u) ** 3) / 3.0


def every_set(views: int) -> np.ndarray:
    """Return all assignments of observations to a point, shape (set, view): 0 left, 1 right, -1 none."""
    return np.array(list(product((-1, 0, 1), repeat=views)))


def cheapest(rig: CameraRig, pixels: np.ndarray, sigma_px: float, full: float, none: float) -> float:
    """Return the lowest bounded cost of two points, each refined from every possible set of observations.

    For every state of every view there is the set of observations that a point then has; any two of these points, or
    one, are scored with every view in its cheapest state. A point rests on two rays; if there
    is one only, one observation that is left over may be that of the other, which it does not fix.

    Args:
        rig: pinhole cameras.
        pixels: shape (view, 2, 2): of the left and the right label, NaN where missing.
        sigma_px: of the noise.
        full, none: in squared sigmas.
    """
    bound = full + (none - full) / 3.0
    present = np.isfinite(pixels).all(axis=-1)
    sets = every_set(len(rig))
    possible = np.array([all(label < 0 or present[v, label] for v, label in enumerate(chosen)) for chosen in sets])
    sets = sets[possible & ((sets >= 0).sum(axis=1) >= 2)]
    squared = np.full((1, len(rig), 2), none)
    if len(sets):
        points = refined_points(rig, pixels, sets, sigma_px, full, none)
        squared = np.concatenate([squared_residuals(rig, pixels, points, sigma_px, none), squared])
    cost, near = bounded(squared, full, none), squared < none
    total = np.zeros((len(cost), len(cost)))
    held = np.zeros((2, *total.shape), dtype=int)
    for v in range(len(rig)):
        straight = cost[:, None, v, 0] + cost[None, :, v, 1]
        crossed = cost[:, None, v, 1] + cost[None, :, v, 0]
        as_labeled = straight <= crossed
        total += np.minimum(straight, crossed)
        held[0] += np.where(as_labeled, near[:, None, v, 0], near[:, None, v, 1])
        held[1] += np.where(as_labeled, near[None, :, v, 1], near[None, :, v, 0])
    left_over = held.sum(axis=0) < present.sum()
    empty = np.arange(len(cost)) == len(cost) - 1
    fixed = [(held[0] >= 2) | empty[:, None], (held[1] >= 2) | empty[None]]
    lacking = (empty[:, None] | empty[None]) & left_over
    total = np.where(fixed[0] & fixed[1], total - bound * lacking, np.inf)
    return float(total.min() - bound * (~present).sum())


def squared_residuals(
    rig: CameraRig, pixels: np.ndarray, points: np.ndarray, sigma_px: float, none: float
) -> np.ndarray:
    """Return squared residuals in sigmas, at most ``none``, shape (point, view, 2)."""
    matrices = np.stack([camera.matrix @ camera.camera_from_world[:3] for camera in rig.cameras])
    projected = np.einsum("vij,sj->svi", matrices, np.concatenate([points, np.ones((len(points), 1))], axis=1))
    offset = projected[..., None, :2] / projected[..., None, 2:] - pixels[None]
    squared = (offset**2).sum(axis=-1) / sigma_px**2
    return np.where((squared < none) & (projected[..., None, 2] > 0), squared, none)


def refined_points(
    rig: CameraRig, pixels: np.ndarray, sets: np.ndarray, sigma_px: float, full: float, none: float
) -> np.ndarray:
    """Return the point of each set of observations, shape (set, 3), by reweighted Gauss-Newton."""
    matrices = np.stack([camera.matrix @ camera.camera_from_world[:3] for camera in rig.cameras])
    member = sets >= 0
    observed = np.where(member[..., None], pixels[np.arange(len(rig)), np.maximum(sets, 0)], 0.0)
    rows = matrices[None, :, :2] - observed[..., None] * matrices[None, :, 2:]
    algebraic = np.where(member[..., None, None], rows, 0.0).reshape(len(sets), -1, 4)
    normal = np.einsum("sri,srj->sij", algebraic[..., :3], algebraic[..., :3])
    right = -np.einsum("sri,sr->si", algebraic[..., :3], algebraic[..., 3])
    points = np.linalg.solve(normal + 1e-9 * np.eye(3), right[..., None])[..., 0]
    settled = np.zeros(len(points), dtype=bool)
    for turn in range(_ROUNDS):
        wide = 4.0 if turn < 2 else 1.0
        homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        depth = np.einsum("vi,si->sv", matrices[:, 2], homogeneous)
        residual = np.einsum("svri,si->svr", rows, homogeneous) / depth[..., None]
        squared = np.where(depth > 0, (residual**2).sum(axis=-1) / sigma_px**2, np.inf)
        u = np.clip((squared - wide * full) / (wide * (none - full)), 0.0, 1.0)
        weight = np.where(member, (1.0 - u) ** 2, 0.0)
        jacobian = (rows[..., :3] - residual[..., None] * matrices[None, :, None, 2, :3]) / depth[..., None, None]
        normal = np.einsum("sv,svri,svrj->sij", weight, jacobian, jacobian)
        gradient = np.einsum("sv,svri,svr->si", weight, jacobian, np.where(weight[..., None] > 0, residual, 0.0))
        ridge = 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-300 * np.eye(3)
        step = np.linalg.solve(normal + ridge, gradient[..., None])[..., 0]
        points = np.where(settled[:, None], points, points - step)
        settled |= (turn >= 2) & (np.einsum("si,si->s", step, gradient) / sigma_px**2 < _SMALL_STEP)
    return points
