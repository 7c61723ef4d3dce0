"""Ambiguous points: a single view and a bone allow two positions, and no neighboring frame resolves which."""

import numpy as np

from posefuse.trajectory.bones import Bones
from posefuse.trajectory.paths import Paths

_MIN_SEPARATION_SD = 8.0
"""Two positions closer than this many standard deviations may be confused. Linearized standard deviations are too small
where the ray is nearly tangent to the sphere around the other end of the bone.
"""

_RESOLVED_BY_MOTION_FRAMES = 2
"""For this many frames after a resolved one, the motion of the path itself identifies the position."""

_MIN_USED_WEIGHT = 0.5
"""Minimum weight of a view that counts as used."""


def has_single_views(paths: Paths) -> bool:
    """Return whether a single view determines any point of a path; others are not ambiguous."""
    return bool((paths.alive & ((paths.weights > _MIN_USED_WEIGHT).sum(axis=-1) == 1)).any())


def find_ambiguous(paths: Paths, jacobians: np.ndarray, bones: Bones, length_m: np.ndarray) -> np.ndarray:
    """Return which points may be at the other position, shape (keypoint, frame), bool.

    A ray intersects the sphere that a bone allows at two positions. The path identifies the right one while they are
    far apart. Once they have been close to each other, only a later frame with two views can resolve it, or an earlier
    one for the reverse direction of time.

    Args:
        paths: solved paths.
        jacobians: shape (keypoint, frame, view, 2, 3), px per m, of every view at the paths.
        bones: of the skeleton.
        length_m: shape (bone,), NaN where unknown.
    """
    views = (paths.weights > _MIN_USED_WEIGHT).sum(axis=-1)
    resolved = paths.alive & (views > 1)
    separation, sd = _separation(paths, jacobians, bones, length_m)
    near = paths.alive & (views == 1) & (separation < _MIN_SEPARATION_SD * sd)
    after, ambiguous_after = _unresolved_frames(paths.alive, resolved, near)
    before, ambiguous_before = (
        each[:, ::-1] for each in _unresolved_frames(paths.alive[:, ::-1], resolved[:, ::-1], near[:, ::-1])
    )
    unresolved = after & before & (views == 1) & np.isfinite(separation)
    return unresolved | (after & ~before & ambiguous_after) | (before & ~after & ambiguous_before)


def _separation(
    paths: Paths, jacobians: np.ndarray, bones: Bones, length_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance of the two positions, inf without a bone, and the standard deviation along the ray, in m."""
    view = np.argmax(paths.weights, axis=-1)[..., None, None, None]
    rows = np.take_along_axis(jacobians, view, axis=2)[:, :, 0]
    ray = np.cross(rows[..., 0, :], rows[..., 1, :])
    ray = np.nan_to_num(ray / np.maximum(np.linalg.norm(ray, axis=-1, keepdims=True), 1e-300))
    sd = np.sqrt(np.maximum(np.einsum("kfi,kfij,kfj->kf", ray, paths.covariance_m2, ray), 0.0))
    separation = np.full(sd.shape, -1.0)
    for (first_end, second_end), length in zip(bones.ends, length_m, strict=True):
        for own, far in ((first_end, second_end), (second_end, first_end)) if np.isfinite(length) else ():
            along = ((paths.paths_m[far] - paths.paths_m[own]) * ray[own]).sum(axis=-1)
            separation[own] = np.maximum(separation[own], np.where(paths.alive[far], 2.0 * np.abs(along), -1.0))
    return np.where(separation < 0.0, np.inf, separation), sd


def _unresolved_frames(alive: np.ndarray, resolved: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frames without a later resolved frame on their path, and frames since whose last one the positions met."""
    frame = np.broadcast_to(np.arange(alive.shape[1]), alive.shape)
    since = np.maximum.accumulate(np.where(resolved | ~alive, frame, -1), axis=1)
    last_near = np.maximum.accumulate(np.where(near & (frame - since > _RESOLVED_BY_MOTION_FRAMES), frame, -1), axis=1)
    count = alive.shape[1]
    next_frames = [
        np.minimum.accumulate(np.where(mask, frame, count + offset)[:, ::-1], axis=1)[:, ::-1]
        for offset, mask in enumerate((~alive, resolved))
    ]
    return alive & (next_frames[1] > next_frames[0]), last_near > since
