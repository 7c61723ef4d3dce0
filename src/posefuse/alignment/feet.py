"""Estimate the floor as the plane on which feet stand still; the up direction need not be known."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.skeleton.skeletons import Skeleton

_SOLES = ("toe", "heel", "foot_index", "paw", "claw")
_ANKLES = ("ankle",)
_ANKLE_HEIGHT_M = 0.08
_STILL_SHARE = 0.3
"""Share of the frames, those with the least motion, in which a foot keypoint counts as standing still."""

_N_SAMPLES = 500
_TOLERANCES_M = (0.02, 0.04, 0.08)
"""Distances within which a foot keypoint is on the floor. Keypoints have different heights above the sole; with larger
noise a later value is used.
"""

_REQUIRED_SHARE = 0.7
"""Share of the still feet that must be on the floor."""

_MIN_POINTS = 30
_MIN_SPREAD_M = 0.15
"""Feet within a narrower band do not determine a plane."""

_LOW_QUANTILE = 0.25
_HEIGHT_SD_M = 0.02
"""Spread of the heights of different keypoints of a foot above its sole."""

_JACKKNIFE_GROUPS = 10
CALIBRATED_UP_SD_DEG = 2.0
"""Standard deviation of a calibration's up direction: a board on the floor, or a wand, is leveled to about this
angle.
"""

_CONTRADICTION_CHI2 = 9.21
"""Limit beyond which feet and calibration contradict each other (99 % of chi-square with two degrees of freedom)."""

_MAX_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class Plane:
    """Describe the floor.

    Attributes:
        normal: shape (3,): unit vector pointing up.
        point_m: shape (3,): a point on the floor.
        spread_m: extent of the foot points across their longest direction; infinite if the plane was given.
        misfit_m: median distance of these points from the plane.
        tilt_sd_deg: standard deviation of the tilt from the feet alone, in the least certain direction; 0 if given.
        uses_up: whether the known up direction contributes to the tilt.
    """

    normal: np.ndarray
    point_m: np.ndarray
    spread_m: float = np.inf
    misfit_m: float = 0.0
    tilt_sd_deg: float = 0.0
    uses_up: bool = False


def floor_from_feet(
    points_m: Sequence[np.ndarray],
    skeleton: Skeleton,
    up: np.ndarray | None,
    seed: int = 0,
    up_sd_deg: float = CALIBRATED_UP_SD_DEG,
) -> Plane:
    """Estimate the plane on which feet stand still: the plane with the most points nearby, refined by least squares.

    Args:
        points_m: ranges of consecutive frames, each of shape (frame, person, keypoint, 3).
        skeleton: with keypoints of feet.
        up: shape (3,), if known: combined with the feet by their uncertainties unless they contradict each other; if
            feet stand in one place or on one line, it replaces the plane's normal.
        seed: random seed.
        up_sd_deg: standard deviation of its tilt.

    Raises:
        DetectionsError: if the skeleton has no feet, too few frames show them, or they stand on one line and up is
            unknown.
    """
    columns, height_m = foot_columns(skeleton)
    parts = [_still_points(part[:, :, columns]) for part in points_m]
    still, keypoint = (np.concatenate(each) for each in zip(*parts, strict=True))
    if len(still) < _MIN_POINTS:
        raise DetectionsError(
            f"align.floor = 'feet' needs at least {_MIN_POINTS} positions of stationary feet, but found {len(still)}. "
            "Set three points on the floor (align.floor_points_m)."
        )
    body = np.concatenate([part.reshape(-1, 3) for part in points_m])
    body = body[np.isfinite(body[:, 0])].mean(axis=0)
    plane = _find_plane(still, seed)
    if plane.spread_m < _MIN_SPREAD_M:
        if up is None:
            raise DetectionsError(
                f"align.floor = 'feet': all feet are within {100 * plane.spread_m:.0f} cm of one line, which does not "
                "determine a plane, and the up axis is unknown. Set the up axis (`up`) or three points on the floor "
                "(align.floor_points_m)."
            )
        # Use the lower points: the other foot may be raised.
        middle = np.quantile(still @ up, _LOW_QUANTILE) * up
        plane = Plane(up, still.mean(axis=0) - (still.mean(axis=0) @ up) * up + middle, plane.spread_m, uses_up=True)
    # The rest of the body is above the feet.
    if (body - plane.point_m) @ plane.normal <= 0:
        plane = replace(plane, normal=-plane.normal)
    if not plane.uses_up:
        covariance = _normal_covariance(still, plane.normal, seed) + _height_covariance(still, keypoint, plane)
        plane = _combine_with_up(plane, covariance, up, np.radians(up_sd_deg))
    return replace(plane, point_m=plane.point_m - height_m * plane.normal)


def _find_plane(points: np.ndarray, seed: int) -> Plane:
    """Return the plane that most points are close to, at the smallest sufficient tolerance."""
    plane = None
    for tolerance_m in _TOLERANCES_M:
        near = _consensus_points(points, tolerance_m, np.random.default_rng(seed))
        plane = _fit_plane(points, near, tolerance_m)
        if near.mean() >= _REQUIRED_SHARE:
            break
    assert plane is not None
    return plane


def _normal_covariance(points: np.ndarray, normal: np.ndarray, seed: int) -> np.ndarray:
    """Return the covariance of the plane's normal, shape (3, 3), by leaving out one tenth of the time after the other.

    Errors of detections persist, and so does the position of a foot, so neighboring points are hardly independent.
    Source: the delete-a-group jackknife (Kott 2001).
    """
    normals = []
    for group in np.array_split(np.arange(len(points)), _JACKKNIFE_GROUPS):
        found = _find_plane(np.delete(points, group, axis=0), seed).normal
        normals.append(found if found @ normal > 0 else -found)
    off = np.array(normals) - np.mean(normals, axis=0)
    return (_JACKKNIFE_GROUPS - 1) / _JACKKNIFE_GROUPS * off.T @ off


def _height_covariance(points: np.ndarray, keypoint: np.ndarray, plane: Plane) -> np.ndarray:
    """Return the covariance of the normal that comes from the keypoints' unknown heights above the sole, shape (3, 3).

    The heights are the same in all frames, so that the jackknife does not see them. They turn the plane of a person who
    stands in one place, and hardly that of one who walks about.

    Args:
        points: shape (point, 3).
        keypoint: shape (point,): index of each point's keypoint.
        plane: plane through the points.
    """
    inside = np.eye(3) - np.outer(plane.normal, plane.normal)
    away = (points - points.mean(axis=0)) @ inside
    sums = np.stack([away[keypoint == k].sum(axis=0) for k in np.unique(keypoint)]) / len(points)
    gain = sums @ np.linalg.pinv(away.T @ away / len(points), rcond=1e-9, hermitian=True)
    return _HEIGHT_SD_M**2 * gain.T @ gain


def _combine_with_up(plane: Plane, covariance: np.ndarray, up: np.ndarray | None, up_sd: float) -> Plane:
    """Combine the plane with the known up direction, weighted by their uncertainties.

    If they contradict each other, only the plane is used.
    """
    tilt_sd_deg = float(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance)[-1])))
    if up is None:
        return replace(plane, tilt_sd_deg=tilt_sd_deg)
    horizontal = np.linalg.svd(up[None])[2][1:]
    off, own = horizontal @ plane.normal, horizontal @ covariance @ horizontal.T
    both = own + up_sd**2 * np.eye(2)
    if plane.normal @ up <= 0 or off @ np.linalg.solve(both, off) > _CONTRADICTION_CHI2:
        return replace(plane, tilt_sd_deg=tilt_sd_deg)
    tilt = up_sd**2 * np.linalg.solve(both, off) @ horizontal
    normal = up * np.sqrt(1.0 - tilt @ tilt) + tilt
    return replace(plane, normal=normal, tilt_sd_deg=tilt_sd_deg, uses_up=True)


def foot_columns(skeleton: Skeleton) -> tuple[list[int], float]:
    """Return the indices of the keypoints that touch the floor, and their height above it.

    Raises:
        DetectionsError: if there are none.
    """
    for words, height_m in ((_SOLES, 0.0), (_ANKLES, _ANKLE_HEIGHT_M)):
        columns = [k for k, name in enumerate(skeleton.keypoints) if any(word in name for word in words)]
        if columns:
            return columns, height_m
    raise DetectionsError(
        f"align.floor = 'feet' needs toes, heels, paws or ankles, and skeleton {skeleton.name} has none. Set three "
        "points on the floor (align.floor_points_m)."
    )


def _still_points(feet_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of foot keypoints that hardly move, shape (point, 3), and the index of each one's keypoint.

    Args:
        feet_m: shape (frame, person, keypoint, 3).
    """
    positions = feet_m[1:-1]
    step = np.linalg.norm(feet_m[2:] - feet_m[:-2], axis=-1)
    known = np.isfinite(step) & np.isfinite(positions[..., 0])
    still = known & (step <= np.quantile(step[known], _STILL_SHARE)) if known.any() else known
    return positions[still], np.nonzero(still)[2]


def _consensus_points(points: np.ndarray, tolerance_m: float, rng: np.random.Generator) -> np.ndarray:
    """Return the points near the best plane through three of them, shape (point,), bool.

    The best plane has the lowest bounded loss.
    """
    triples = rng.integers(0, len(points), (_N_SAMPLES, 3))
    corners = points[triples]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.maximum(size, 1e-12)
    offset = np.einsum("ti,ti->t", normal, corners[:, 0])
    distance = np.abs(points @ normal.T - offset)
    # A bounded loss ranks planes with equally many points.
    loss = np.minimum(distance / tolerance_m, 1.0).sum(axis=0)
    return distance[:, int(np.where(size[:, 0] > 1e-9, loss, np.inf).argmin())] < tolerance_m


def _fit_plane(points: np.ndarray, near: np.ndarray, tolerance_m: float) -> Plane:
    """Return the least-squares plane of the points near it, refitted until the set of these points is stable."""
    normal, middle, spread = np.array([0.0, 0.0, 1.0]), points.mean(axis=0), 0.0
    for _ in range(_MAX_ITERATIONS):
        middle = points[near].mean(axis=0)
        _, sizes, axes = np.linalg.svd(points[near] - middle, full_matrices=False)
        normal, spread = axes[2], float(4.0 * sizes[1] / np.sqrt(near.sum()))
        found = np.abs((points - middle) @ normal) < tolerance_m
        if found.sum() < 3 or (found == near).all():
            break
        near = found
    return Plane(normal, middle, spread, float(np.median(np.abs((points[near] - middle) @ normal))))
