"""Paths of the feet and hips of a person in axes with z up, which contact and gait are estimated from."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction, unpack_covariance
from posefuse.skeleton.skeletons import Skeleton

SIDES = ("left", "right")
PARTS = ("heel", "toes")
HEEL, TOES = 0, 1
_TOES = ("big_toe", "small_toe", "foot_index")


@dataclass(frozen=True, eq=False)
class FootPaths:
    """Paths of one person's feet and hips. Missing points are NaN.

    Attributes:
        time_s: shape (frame,): increasing times.
        feet_m: shape (frame, side, part, 3): heel and toes of the left and of the right foot.
        sd_m: shape (frame, side, part, 3): standard deviations along the axes.
        hips_m: shape (frame, side, 3).
        knee_deg: shape (frame, side): flexion of the knee from the points, 0 for a straight leg.
        leg_m: shape (frame, side): length of thigh and shank from the points.
    """

    time_s: np.ndarray
    feet_m: np.ndarray
    sd_m: np.ndarray
    hips_m: np.ndarray
    knee_deg: np.ndarray
    leg_m: np.ndarray

    @property
    def pelvis_m(self) -> np.ndarray:
        """Middle of the hips, shape (frame, 3)."""
        return self.hips_m.mean(axis=1)

    def between(self, first: int, last: int) -> "FootPaths":
        """Return the frames ``first`` to ``last`` (excluded)."""
        names = ("time_s", "feet_m", "sd_m", "hips_m", "knee_deg", "leg_m")
        return replace(self, **{name: getattr(self, name)[first:last] for name in names})


def has_feet(skeleton: Skeleton) -> bool:
    """Return whether a skeleton has hips, heels and toes on both sides."""
    return all(
        f"{side}_hip" in skeleton.keypoints and all(part_keypoints(skeleton, side, part) for part in (HEEL, TOES))
        for side in SIDES
    )


def foot_paths(parts: Iterable[Reconstruction], layer: LayerName, up: tuple[float, float, float]) -> list[FootPaths]:
    """Collect the paths of every person's feet.

    Args:
        parts: consecutive ranges of frames of one result whose skeleton has feet.
        layer: name of the layer.
        up: unit vector of the world that points up.
    """
    turn = level_axes(np.array(up))
    rows = [_of_range(part, layer, turn) for part in parts]
    times = np.concatenate([part[0] for part in rows])
    arrays = [np.concatenate([part[i] for part in rows], axis=0) for i in range(1, 6)]
    return [FootPaths(times, *(each[:, p] for each in arrays)) for p in range(arrays[0].shape[1])]


def level_axes(up: np.ndarray) -> np.ndarray:
    """Return a rotation to axes with z up, shape (3, 3); the world's horizontal axes are kept if z is up."""
    up = up / np.linalg.norm(up)
    first = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = first - (first @ up) * up
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def part_keypoints(skeleton: Skeleton, side: str, part: int) -> list[int]:
    """Return the indices of the keypoints of the heel or of the toes of a foot."""
    names = [f"{side}_{name}" for name in (("heel",) if part == HEEL else _TOES)]
    return [skeleton.index(name) for name in names if name in skeleton.keypoints]


def _of_range(part: Reconstruction, layer: LayerName, turn: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return times and the fields of paths in their order for a range of frames; people are the second axis."""
    points = np.asarray(part.layers[layer].points_m[:])
    covariance = unpack_covariance(np.asarray(part.layers[layer].covariance_m2[:]))
    return part.time_s, *_of_points(points, covariance, part.skeleton, turn)


def foot_paths_of_points(
    time_s: np.ndarray, points_m: np.ndarray, covariance_m2: np.ndarray, skeleton: Skeleton, turn: np.ndarray
) -> FootPaths:
    """Return the paths of one person's feet.

    Args:
        time_s: shape (frame,).
        points_m: shape (frame, keypoint, 3).
        covariance_m2: shape (frame, keypoint, 3, 3).
        skeleton: of the keypoints; it has feet.
        turn: from :func:`level_axes`.
    """
    arrays = _of_points(points_m[:, None], covariance_m2[:, None], skeleton, turn)
    return FootPaths(time_s, *(each[:, 0] for each in arrays))


def _of_points(
    points_m: np.ndarray, covariance_m2: np.ndarray, skeleton: Skeleton, turn: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the fields of paths after the times; the first axes of the points are frame, person and keypoint."""
    points = points_m @ turn.T
    feet, sds = [], []
    for side in SIDES:
        for part in (HEEL, TOES):
            columns = part_keypoints(skeleton, side, part)
            feet.append(points[:, :, columns].mean(axis=2))
            own = turn @ covariance_m2[:, :, columns].mean(axis=2) @ turn.T
            sds.append(np.sqrt(np.diagonal(own, axis1=-2, axis2=-1)))
    shape = (*points.shape[:2], 2, 2, 3)
    hips = points[:, :, [skeleton.index(f"{side}_hip") for side in SIDES]]
    knees, legs = _legs(points, skeleton)
    return np.stack(feet, axis=2).reshape(shape), np.stack(sds, axis=2).reshape(shape), hips, knees, legs


def _legs(points_m: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return the flexion of the knees in degrees and the length of thigh and shank in meters.

    Both have the shape (frame, person, side), NaN without knees or ankles.
    """
    flexion, length = (np.full((*points_m.shape[:2], 2), np.nan) for _ in range(2))
    for s, side in enumerate(SIDES):
        names = [f"{side}_{joint}" for joint in ("hip", "knee", "ankle")]
        if not set(names) <= set(skeleton.keypoints):
            continue
        hip, knee, ankle = (points_m[:, :, skeleton.index(name)] for name in names)
        thigh, shank = knee - hip, ankle - knee
        lengths = np.linalg.norm(thigh, axis=-1), np.linalg.norm(shank, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            cosine = (thigh * shank).sum(-1) / lengths[0] / lengths[1]
        flexion[..., s] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        length[..., s] = lengths[0] + lengths[1]
    return flexion, length
