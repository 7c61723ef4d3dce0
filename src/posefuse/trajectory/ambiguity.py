"""Where one view and a bone allow two places, before and behind, and nothing after tells which."""

import numpy as np

from posefuse.trajectory.bones import Bones
from posefuse.trajectory.paths import Paths

_APART = 8.0
"""Two places nearer to each other than so many standard deviations may be taken one for the other: linear ones are too
small where the ray only touches the sphere about the bone's other end."""

_BY_TIME = 2
"""So many frames after a known one the path's own motion tells which place it is."""

_COUNTS = 0.5


def ambiguous(paths: Paths, jacobians: np.ndarray, bones: Bones, length_m: np.ndarray) -> np.ndarray:
    """Which points may as well be at the other place, shape (keypoint, frame), bool.

    A ray meets the sphere that a bone allows in two places. The path knows which while they are far apart; once they
    have been near each other only a later frame that two views see tells, or an earlier one, backwards.

    Args:
        paths: solved.
        jacobians: shape (keypoint, frame, view, 2, 3), px a metre, of every view at the paths.
        bones: of the skeleton.
        length_m: shape (bone,), NaN where unknown.
    """
    views = (paths.weights > _COUNTS).sum(axis=-1)
    known = paths.alive & (views > 1)
    apart, sd = _apart(paths, jacobians, bones, length_m)
    near = paths.alive & (views == 1) & (apart < _APART * sd)
    after, doubted_after = _open(paths.alive, known, near)
    before, doubted_before = (each[:, ::-1] for each in _open(paths.alive[:, ::-1], known[:, ::-1], near[:, ::-1]))
    never = after & before & (views == 1) & np.isfinite(apart)
    return never | (after & ~before & doubted_after) | (before & ~after & doubted_before)


def _apart(paths: Paths, jacobians: np.ndarray, bones: Bones, length_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far apart the two places are, inf without a bone, and the standard deviation along the ray, m."""
    view = np.argmax(paths.weights, axis=-1)[..., None, None, None]
    rows = np.take_along_axis(jacobians, view, axis=2)[:, :, 0]
    ray = np.cross(rows[..., 0, :], rows[..., 1, :])
    ray = np.nan_to_num(ray / np.maximum(np.linalg.norm(ray, axis=-1, keepdims=True), 1e-300))
    sd = np.sqrt(np.maximum(np.einsum("kfi,kfij,kfj->kf", ray, paths.covariance_m2, ray), 0.0))
    apart = np.full(sd.shape, -1.0)
    for (one, other), length in zip(bones.ends, length_m, strict=True):
        for own, far in ((one, other), (other, one)) if np.isfinite(length) else ():
            along = ((paths.paths_m[far] - paths.paths_m[own]) * ray[own]).sum(axis=-1)
            apart[own] = np.maximum(apart[own], np.where(paths.alive[far], 2.0 * np.abs(along), -1.0))
    return np.where(apart < 0.0, np.inf, apart), sd


def _open(alive: np.ndarray, known: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which frames have no known one after them on their path, and of which the two places were near since one was."""
    frame = np.broadcast_to(np.arange(alive.shape[1]), alive.shape)
    since = np.maximum.accumulate(np.where(known | ~alive, frame, -1), axis=1)
    late_near = np.maximum.accumulate(np.where(near & (frame - since > _BY_TIME), frame, -1), axis=1)
    count = alive.shape[1]
    coming = [
        np.minimum.accumulate(np.where(mask, frame, count + late)[:, ::-1], axis=1)[:, ::-1]
        for late, mask in enumerate((~alive, known))
    ]
    return alive & (coming[1] > coming[0]), late_near > since
