"""Occlusion by bodies, modeled as capsules."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.skeleton.skeletons import Skeleton

_TORSO_M, _HEAD_M, _ARM_M, _LEG_M, _OTHER_M = 0.15, 0.11, 0.05, 0.07, 0.03
_NEAR_M = 0.05
# Radii of bodies without shoulders and hips, relative to their size: between core keypoints, and elsewhere.
_THICK, _THIN = 0.12, 0.015


@dataclass(frozen=True)
class Capsules:
    """Moving solid capsules.

    Attributes:
        starts_m: shape (frame, capsule, 3): start of the axis in meters, NaN if absent.
        ends_m: shape (frame, capsule, 3): end of the axis.
        radii_m: shape (capsule,): radii.
        owners: shape (capsule,), int64: person, -1 for an object.
    """

    starts_m: np.ndarray
    ends_m: np.ndarray
    radii_m: np.ndarray
    owners: np.ndarray

    @classmethod
    def none(cls, n_frames: int) -> "Capsules":
        """Return no capsules."""
        nothing = np.empty((n_frames, 0, 3))
        return cls(nothing, nothing, np.empty(0), np.empty(0, dtype=np.int64))

    @classmethod
    def concatenate(cls, parts: list["Capsules"]) -> "Capsules":
        """Return the union of several sets of capsules."""
        return cls(
            np.concatenate([part.starts_m for part in parts], axis=1),
            np.concatenate([part.ends_m for part in parts], axis=1),
            np.concatenate([part.radii_m for part in parts]),
            np.concatenate([part.owners for part in parts]),
        )


def bodies_of(points_m: np.ndarray, skeleton: Skeleton) -> Capsules:
    """Return torsos, heads and limbs around keypoints, or edges for a skeleton without shoulders and hips.

    Args:
        points_m: shape (frame, person, keypoint, 3), NaN where absent.
        skeleton: skeleton of the keypoints.
    """
    bones = _bones(skeleton)
    n_frames, n_people = points_m.shape[:2]

    def middles(ends: list[tuple[int, ...]]) -> np.ndarray:
        each = [points_m[:, :, list(end)].mean(axis=2) for end in ends]
        return np.ascontiguousarray(np.stack(each, axis=2).reshape(n_frames, -1, 3))

    return Capsules(
        starts_m=middles([start for start, _, _ in bones]),
        ends_m=middles([end for _, end, _ in bones]),
        radii_m=np.tile([radius for _, _, radius in bones], n_people),
        owners=np.repeat(np.arange(n_people), len(bones)),
    )


def hidden_keypoints(rig: CameraRig, points_m: np.ndarray, capsules: Capsules, scale: float = 1.0) -> np.ndarray:
    """Return occluded keypoints, shape (frame, view, person, keypoint), bool.

    Args:
        rig: cameras.
        points_m: shape (frame, person, keypoint, 3).
        capsules: bodies and objects.
        scale: ratio of the body size to that of an adult human, which scales the distance within which nothing is
            occluded.
    """
    from posefuse.kernels.synthetic.occlusion import mark_occluded

    n_frames, n_people, n_keypoints, _ = points_m.shape
    hidden = np.zeros((len(rig), n_frames, n_people, n_keypoints), dtype=bool)
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    for v, camera in enumerate(rig.cameras):
        mark_occluded(
            camera.center_m,
            points,
            capsules.starts_m,
            capsules.ends_m,
            capsules.radii_m,
            capsules.owners,
            _NEAR_M * scale,
            hidden[v],
        )
    return np.moveaxis(hidden, 0, 1)


def _bones(skeleton: Skeleton) -> list[tuple[tuple[int, ...], tuple[int, ...], float]]:
    """Return the two ends of each capsule, each the mean of keypoints, and its radius."""
    names = {name: i for i, name in enumerate(skeleton.keypoints)}

    def both(part: str) -> tuple[int, ...]:
        return tuple(names[f"{side}_{part}"] for side in ("left", "right") if f"{side}_{part}" in names)

    hips, shoulders = both("hip"), both("shoulder")
    if len(hips) < 2 or len(shoulders) < 2:
        return [((int(a),), (int(b),), _radius_m(skeleton, int(a), int(b))) for a, b in skeleton.edge_indices]
    bones: list[tuple[tuple[int, ...], tuple[int, ...], float]] = [(hips, shoulders, _TORSO_M)]
    head = both("ear") or tuple(names[name] for name in ("head", "nose") if name in names)[:1]
    if head:
        bones.append((head, head, _HEAD_M))
    for limb, radius in (("arm", _ARM_M), ("leg", _LEG_M)):
        # Three joints of a limb; the rest are hands and feet.
        chain = skeleton.chains.get(limb, ())[:3]
        for (upper_left, upper_right), (lower_left, lower_right) in pairwise(chain):
            bones.append(((names[upper_left],), (names[lower_left],), radius))
            bones.append(((names[upper_right],), (names[lower_right],), radius))
    return bones


def _radius_m(skeleton: Skeleton, a: int, b: int) -> float:
    """Return the radius of the capsule around an edge."""
    if skeleton.tree is None:
        return _OTHER_M
    trunk = bool(np.isin([a, b], skeleton.core_indices).all())
    return (_THICK if trunk else _THIN) * skeleton.tree.size_m
