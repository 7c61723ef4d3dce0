"""Shapes of bodies in the 3D scene: a radius at each keypoint, and ellipsoids for heads and trunks."""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_HUMAN_RADII = {
    "shoulder": 0.030, "elbow": 0.024, "wrist": 0.017, "hip": 0.045, "knee": 0.033, "ankle": 0.022, "heel": 0.018,
    "toe": 0.014, "neck": 0.028, "pelvis": 0.055, "spine": 0.055, "thorax": 0.055,
}  # fmt: skip
"""Radii as shares of stature: half the breadths and depths of limbs in tables of anthropometry of adults."""
_CROWN = ("head", "head_top")
_HUMAN_OTHER, _HAND, _FACE = 0.010, 0.0025, 0.0012
"""Fingers and faces are thinner than in reality, because their lines would otherwise merge."""
_HEAD, _NECK = (0.042, 0.062, 0.048), (0.028, 0.060, 0.030)
_ON_FACE = 0.004
"""Eyes, ears and nose among the keypoints of a face."""
_SKULL = (0.040, 0.060, 0.042)
"""The head behind the keypoints of a face, which are in front of it."""
_CHEST, _BELLY = (0.085, 0.125, 0.058), (0.080, 0.080, 0.060)
"""Half axes as shares of stature: to the side, along the axis, to the front."""
_CREATURE_SHARES = {"tti": 0.2, "spine": 0.4, "trunk": 0.4, "body": 0.4, "centroid": 0.4, "neck": 0.3}
_CREATURE_OTHER = 0.13
"""Radii of animals as shares of the shortest bone at a keypoint."""
_UNJOINED = 0.5
"""Length of a typical bone as a share of the distance of keypoints from the middle, for skeletons without edges."""
_CREATURE_MOST, _TAIL = 0.13, 0.02
"""The largest radius and that of tails, as shares of the longest bone."""
_TRUNK_SHARE, _THIGH_SHARE = 0.29, 0.24
"""Lengths of mid-hip to mid-shoulder and of a hip to its knee, as shares of stature."""
_ADULT_M = 1.7
"""Stature without a measured length."""
_SHOWN_FRAMES = 200


def body_shapes(points_m: np.ndarray, skeleton: Skeleton) -> dict[str, Any]:
    """Return the shapes as JSON data of the scene.

    Args:
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        skeleton: skeleton of the keypoints.

    Returns:
        ``size``: stature of each person in m, 1 for animals; ``radii``: radius at each keypoint, and ``blobs``:
        ellipsoids, both as shares of it; ``bare``: indices of edges that are not drawn. The axis of an ellipsoid leads
        from the middle of the keypoints ``low`` to that of ``high``, and its center is at ``at`` of this axis; ``side``
        are the keypoints to its left and right; ``fine``: keypoints of hands and faces.
    """
    names = {name: k for k, name in enumerate(skeleton.keypoints)}
    human = {f"{side}_{part}" for side in ("left", "right") for part in ("hip", "shoulder")} <= names.keys()
    shown = points_m[:: max(1, len(points_m) // _SHOWN_FRAMES)]
    people = [shown[:, p] for p in range(shown.shape[1])]
    if human:
        sizes, radii = [_stature_m(person, names) for person in people], _human_radii(skeleton)
    else:
        sizes, radii = [1.0] * len(people), _creature_radii(people, skeleton)
    return {
        "size": [round(size, 4) for size in sizes],
        "radii": radii,
        "blobs": _human_blobs(names, _has_face(skeleton)) if human else [],
        "fine": sorted({int(k) for part in skeleton.parts for k in part.keypoints}),
        "bare": [e for e, (a, b) in enumerate(skeleton.edges) if human and _in_head(a) and _in_head(b)],
    }


def _in_head(name: str) -> bool:
    return name in ("nose", "head", "head_top") or name.endswith(("_eye", "_ear", "neck"))


def _human_radii(skeleton: Skeleton) -> list[float]:
    radii = [
        next((radius for part, radius in _HUMAN_RADII.items() if part in name), _HUMAN_OTHER)
        for name in skeleton.keypoints
    ]
    if {"left_ear", "right_ear"} <= set(skeleton.keypoints):
        # The ellipsoid of the head has its own height, and the top of the head may be above it.
        radii = [_FACE if name in _CROWN else radius for name, radius in zip(skeleton.keypoints, radii, strict=True)]
    if _has_face(skeleton):
        radii = [_ON_FACE if _in_head(name) else radius for name, radius in zip(skeleton.keypoints, radii, strict=True)]
    for part in skeleton.parts:
        for k in part.keypoints:
            radii[int(k)] = _HAND if "hand" in part.name else _FACE
    return radii


def _creature_radii(people: Sequence[np.ndarray], skeleton: Skeleton) -> list[float]:
    """Return radii in m by the lengths of the bones."""
    shape = (len(people), len(skeleton.edges))
    lengths = np.array([_bone_lengths_m(person, skeleton) for person in people]).reshape(shape)
    known = [[length for length in bone if np.isfinite(length)] for bone in lengths.T]
    bones = [float(np.median(each)) if each else float("nan") for each in known]
    longest = max((bone for bone in bones if np.isfinite(bone)), default=_UNJOINED * _extent_m(people))
    most = _CREATURE_MOST * longest
    radii = []
    for k, name in enumerate(skeleton.keypoints):
        own = [bone for bone, ends in zip(bones, skeleton.edge_indices, strict=True) if k in ends and np.isfinite(bone)]
        share = next((s for part, s in _CREATURE_SHARES.items() if part in name.lower()), _CREATURE_OTHER)
        radius = _TAIL * longest if "tail" in name.lower() else min(share * min(own, default=longest), most)
        radii.append(float(f"{radius:.4g}"))
    return radii


def _extent_m(people: Sequence[np.ndarray]) -> float:
    """Return the median distance of keypoints from the middle of their body; 0 without any."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of frames without points
        apart = [person - np.nanmean(person, axis=1, keepdims=True) for person in people]
    extents = [_median(np.linalg.norm(each, axis=-1)) for each in apart]
    return float(np.nanmedian(extents)) if np.isfinite(extents).any() else 0.0


def _bone_lengths_m(points_m: np.ndarray, skeleton: Skeleton) -> list[float]:
    return [_median(np.linalg.norm(points_m[:, a] - points_m[:, b], axis=-1)) for a, b in skeleton.edge_indices]


def _stature_m(points_m: np.ndarray, names: Mapping[str, int]) -> float:
    """Return the stature that trunk and thighs of a person suggest, which people who sit or bend do not change."""

    def middle(part: str) -> np.ndarray:
        both = [names[f"{side}_{part}"] for side in ("left", "right") if f"{side}_{part}" in names]
        return points_m[:, both].mean(axis=1)

    lengths = [_median(np.linalg.norm(middle("shoulder") - middle("hip"), axis=-1)) / _TRUNK_SHARE]
    for side in ("left", "right"):
        if f"{side}_knee" in names and f"{side}_hip" in names:
            thigh = points_m[:, names[f"{side}_hip"]] - points_m[:, names[f"{side}_knee"]]
            lengths.append(_median(np.linalg.norm(thigh, axis=-1)) / _THIGH_SHARE)
    known = [length for length in lengths if np.isfinite(length)]
    return float(np.median(known)) if known else _ADULT_M


def _median(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")


def _has_face(skeleton: Skeleton) -> bool:
    return any("face" in part.name for part in skeleton.parts)


def _human_blobs(names: Mapping[str, int], has_face: bool) -> list[dict[str, Any]]:
    def both(part: str) -> list[int]:
        return [names[f"{side}_{part}"] for side in ("left", "right") if f"{side}_{part}" in names]

    shoulders, hips, ears = both("shoulder"), both("hip"), both("ear")
    head = ears or [names[name] for name in ("head", "nose") if name in names][:1]
    blobs = [
        {"low": hips, "high": shoulders, "at": 0.62, "side": shoulders, "half": _CHEST},
        {"low": hips, "high": shoulders, "at": 0.12, "side": hips, "half": _BELLY},
    ]
    if head:
        # The middle of the ears is the middle of the head; without ears, the head is above the nose.
        blobs.append({"low": shoulders, "high": head, "at": 1.0, "side": ears, "half": _SKULL if has_face else _HEAD})
        blobs.append({"low": shoulders, "high": head, "at": 0.5, "side": [], "half": _NECK})
    return blobs
