"""The floor: the plane on which feet stand still, found without knowing which way is up."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.skeleton.skeletons import Skeleton

_SOLES = ("toe", "heel", "foot_index", "paw", "claw")
_ANKLES = ("ankle",)
_ANKLE_HEIGHT_M = 0.08
_STILL_SHARE = 0.3
"""So many of the frames, those in which it moves least, tell where a foot's point stands."""

_TRIES = 500
_NEAR_M = (0.02, 0.04, 0.08)
"""A foot's point lies on the floor within the first of these: they stand at different heights above their soles. Where
noise is larger than that, within a later one."""

_MOST = 0.7
"""So large a share of feet that stand still lies on the floor."""

_FEWEST = 30
_LEAST_SPREAD_M = 0.15
"""Feet that stand in a narrower band than this tell no plane."""

_LOW_SHARE = 0.25
_GROUPS = 10
_UP_SD = np.radians(2.0)
"""How well a calibration knows which way is up: a board on the floor, or a wand, is levelled to about so much."""

_CONTRADICTED = 9.21
"""Beyond this (99 % of chi-square, two degrees of freedom) feet and calibration do not mean the same."""

_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Plane:
    """The floor.

    Attributes:
        normal: shape (3,): unit vector upwards.
        point_m: shape (3,): on it.
        spread_m: how wide the points that tell it lie, across their longest direction; infinite where it was given.
        misfit_m: median distance of these points from it.
        doubt_deg: standard deviation of its tilt by itself, where it is least known; 0 where it was given.
        up_counts: whether the calibration's up had a part in its tilt.
    """

    normal: np.ndarray
    point_m: np.ndarray
    spread_m: float = np.inf
    misfit_m: float = 0.0
    doubt_deg: float = 0.0
    up_counts: bool = False


def floor_of_feet(points_m: Sequence[np.ndarray], skeleton: Skeleton, up: np.ndarray | None, seed: int = 0) -> Plane:
    """The plane on which feet stand still, by the most points near one plane, then least squares of these.

    Args:
        points_m: ranges of consecutive frames, each of shape (frame, person, keypoint, 3).
        skeleton: with keypoints of feet.
        up: shape (3,), if known, to about 2 degrees: counts beside the feet by how well each is known, unless they
            contradict each other; where feet stand in one place or on one line it takes the plane's part.
        seed: of the draws.

    Raises:
        DetectionsError: if there are no feet, too few frames show them, or they stand on one line and nobody knows
            which way is up.
    """
    columns, height_m = foot_columns(skeleton)
    still = np.concatenate([_still(part[:, :, columns]) for part in points_m])
    if len(still) < _FEWEST:
        raise DetectionsError(
            f"align.floor = 'feet' found feet in {len(still)} places, and needs {_FEWEST}. Give three points on the "
            "floor (align.floor_points_m)."
        )
    body = np.concatenate([part.reshape(-1, 3) for part in points_m])
    body = body[np.isfinite(body[:, 0])].mean(axis=0)
    plane = _plane(still, seed)
    if plane.spread_m < _LEAST_SPREAD_M:
        if up is None:
            raise DetectionsError(
                f"align.floor = 'feet': feet stand within {100 * plane.spread_m:.0f} cm of one line, which is no "
                "plane, and which way is up is not known. Say it with --up, or give three points on the floor "
                "(align.floor_points_m)."
            )
        # The lower ones: the other foot may be held up.
        middle = np.quantile(still @ up, _LOW_SHARE) * up
        plane = Plane(up, still.mean(axis=0) - (still.mean(axis=0) @ up) * up + middle, plane.spread_m, up_counts=True)
    # Feet are where the rest of the body is not.
    if (body - plane.point_m) @ plane.normal <= 0:
        plane = replace(plane, normal=-plane.normal)
    if not plane.up_counts:
        plane = _with_up(plane, _tilts(still, plane.normal, seed), up)
    return replace(plane, point_m=plane.point_m - height_m * plane.normal)


def _plane(points: np.ndarray, seed: int) -> Plane:
    """The plane that most of the points are near, as near as noise allows."""
    plane = None
    for near_m in _NEAR_M:
        near = _most_agreed(points, near_m, np.random.default_rng(seed))
        plane = _fitted(points, near, near_m)
        if near.mean() >= _MOST:
            break
    assert plane is not None
    return plane


def _tilts(points: np.ndarray, normal: np.ndarray, seed: int) -> np.ndarray:
    """Shape (3, 3): covariance of a plane's normal, by leaving out a tenth of the time after the other.

    Errors of detections last, and so does where a foot stands: neighbouring points tell hardly more than one.
    Source: the delete-a-group jackknife (Kott 2001).
    """
    normals = []
    for group in np.array_split(np.arange(len(points)), _GROUPS):
        found = _plane(np.delete(points, group, axis=0), seed).normal
        normals.append(found if found @ normal > 0 else -found)
    off = np.array(normals) - np.mean(normals, axis=0)
    return (_GROUPS - 1) / _GROUPS * off.T @ off


def _with_up(plane: Plane, tilts: np.ndarray, up: np.ndarray | None) -> Plane:
    """The plane with the calibration's up, each by how well it is known; without it where they contradict."""
    doubt_deg = float(np.degrees(np.sqrt(np.linalg.eigvalsh(tilts)[-1])))
    if up is None:
        return replace(plane, doubt_deg=doubt_deg)
    level = np.linalg.svd(up[None])[2][1:]
    off, own = level @ plane.normal, level @ tilts @ level.T
    both = own + _UP_SD**2 * np.eye(2)
    if plane.normal @ up <= 0 or off @ np.linalg.solve(both, off) > _CONTRADICTED:
        return replace(plane, doubt_deg=doubt_deg)
    tilt = _UP_SD**2 * np.linalg.solve(both, off) @ level
    normal = up * np.sqrt(1.0 - tilt @ tilt) + tilt
    return replace(plane, normal=normal, doubt_deg=doubt_deg, up_counts=True)


def foot_columns(skeleton: Skeleton) -> tuple[list[int], float]:
    """Places of the keypoints that stand on the floor, and how high above it they are.

    Raises:
        DetectionsError: if there are none.
    """
    for words, height_m in ((_SOLES, 0.0), (_ANKLES, _ANKLE_HEIGHT_M)):
        columns = [k for k, name in enumerate(skeleton.keypoints) if any(word in name for word in words)]
        if columns:
            return columns, height_m
    raise DetectionsError(
        f"align.floor = 'feet' looks for toes, heels, paws or ankles, and skeleton {skeleton.name} has none. Give "
        "three points on the floor (align.floor_points_m)."
    )


def _still(feet_m: np.ndarray) -> np.ndarray:
    """Shape (point, 3): where points of feet hardly move, shape (frame, person, keypoint, 3)."""
    if len(feet_m) < 3:
        return np.zeros((0, 3))
    step = np.linalg.norm(feet_m[2:] - feet_m[:-2], axis=-1)
    here = feet_m[1:-1]
    known = np.isfinite(step) & np.isfinite(here[..., 0])
    if not known.any():
        return np.zeros((0, 3))
    return here[known & (step <= np.quantile(step[known], _STILL_SHARE))]


def _most_agreed(points: np.ndarray, near_m: float, rng: np.random.Generator) -> np.ndarray:
    """Shape (point,), bool: those near the plane, of planes through three of them, that most are near."""
    triples = rng.integers(0, len(points), (_TRIES, 3))
    corners = points[triples]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.maximum(size, 1e-12)
    offset = np.einsum("ti,ti->t", normal, corners[:, 0])
    away = np.abs(points @ normal.T - offset)
    # A bounded loss tells planes with equally many points apart.
    loss = np.minimum(away / near_m, 1.0).sum(axis=0)
    return away[:, int(np.where(size[:, 0] > 1e-9, loss, np.inf).argmin())] < near_m


def _fitted(points: np.ndarray, near: np.ndarray, near_m: float) -> Plane:
    """The plane of least squares of those near it, until these stay the same."""
    normal, middle, spread = np.array([0.0, 0.0, 1.0]), points.mean(axis=0), 0.0
    for _ in range(_ROUNDS):
        middle = points[near].mean(axis=0)
        _, sizes, axes = np.linalg.svd(points[near] - middle, full_matrices=False)
        normal, spread = axes[2], float(4.0 * sizes[1] / np.sqrt(near.sum()))
        found = np.abs((points - middle) @ normal) < near_m
        if found.sum() < 3 or (found == near).all():
            break
        near = found
    return Plane(normal, middle, spread, float(np.median(np.abs((points[near] - middle) @ normal))))
