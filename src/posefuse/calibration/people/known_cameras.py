"""Place views that people calibrate where cameras are known to be, and find the cameras that are elsewhere.

Cameras are known in groups: their poses relative to each other, and with them the scale, are known within a group. The
cameras that kept their relative poses are those of the largest part of a group that fits an approximate calibration
after a similarity. Their poses are a prior of the estimate, with the covariance of the calibration that they are from.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posefuse.calibration.joint.known_poses import KnownPoses
from posefuse.calibration.people.views import MatchedViews, ViewTracks
from posefuse.model.cameras import Camera, CameraRig, vector_from_rotation
from posefuse.model.rotations import closest_rotation

_FX = "fx_px"


@dataclass(frozen=True, eq=False)
class KnownGroup:
    """Cameras whose poses relative to each other are known.

    Attributes:
        rig: the cameras, with their covariance.
        least_sd: standard deviations that are added to those of every pose: rad, m.
    """

    rig: CameraRig
    least_sd: tuple[float, float]

    @property
    def reach_m(self) -> float:
        """Median distance of the cameras from their middle."""
        centers = np.array([camera.center_m for camera in self.rig.cameras])
        return max(float(np.median(np.linalg.norm(centers - centers.mean(axis=0), axis=1))), 1e-3)


@dataclass(frozen=True, eq=False)
class Similarity:
    """The map ``scale * rotation @ x + shift_m`` of worlds."""

    scale: float
    rotation: np.ndarray
    shift_m: np.ndarray

    def camera(self, camera: Camera) -> Camera:
        """Return a camera in the other world."""
        rotation = camera.rotation @ self.rotation.T
        center = self.scale * self.rotation @ camera.center_m + self.shift_m
        return posed(camera, rotation, center)


def posed(camera: Camera, rotation: np.ndarray, center_m: np.ndarray) -> Camera:
    """Return a camera at a pose."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ center_m
    return replace(camera, camera_from_world=pose)


def similarity(found: Sequence[Camera], known: Sequence[Camera], scale: float | None = None) -> Similarity:
    """Return the similarity that maps cameras to where they are known to be, from two cameras on.

    Args:
        found: the cameras.
        known: the same cameras in the other world.
        scale: of the similarity; by default the distances of the cameras determine it.
    """
    turns = sum((b.rotation.T @ a.rotation for a, b in zip(found, known, strict=True)), np.zeros((3, 3)))
    rotation = closest_rotation(turns)
    a, b = (np.array([camera.center_m for camera in cameras]) for cameras in (found, known))
    a, b = a @ rotation.T, b
    if scale is None:
        apart, target = a - a.mean(axis=0), b - b.mean(axis=0)
        scale = max(float((apart * target).sum() / max(np.square(apart).sum(), 1e-12)), 1e-6)
    return Similarity(scale, rotation, b.mean(axis=0) - scale * a.mean(axis=0))


def pose_difference(found: Camera, known: Camera) -> tuple[float, float]:
    """Return the angle (rad) and the distance (m) between two poses of a camera."""
    turn = np.linalg.norm(vector_from_rotation(found.rotation @ known.rotation.T))
    return float(turn), float(np.linalg.norm(found.center_m - known.center_m))


def kept_cameras(
    found: Mapping[str, Camera], group: KnownGroup, limits: Mapping[str, tuple[float, float]]
) -> tuple[str, ...]:
    """Return the most cameras whose relative poses are the known ones; none if no two cameras kept them.

    Args:
        found: approximate poses by name, in any world.
        group: the known cameras.
        limits: largest angle (rad) and distance (m, in the known world) of each camera.
    """
    shared = [name for name in group.rig.names if name in found]
    best: tuple[tuple[int, float], tuple[str, ...]] | None = None
    for pair in combinations(shared, 2):
        kept: tuple[str, ...] = pair
        away: dict[str, float] = {}
        for _ in range(2):
            placed = similarity([found[n] for n in kept], [group.rig[n] for n in kept])
            away = {n: _away(placed.camera(found[n]), group.rig[n], limits[n]) for n in shared}
            kept = tuple(n for n in shared if away[n] <= 1.0)
            if len(kept) < 2:
                break
        if len(kept) > 1:
            score = len(kept), -sum(away[n] for n in kept)
            if best is None or score > best[0]:
                best = score, kept
    return () if best is None else best[1]


def _away(found: Camera, known: Camera, limit: tuple[float, float]) -> float:
    """Return how far a camera is from where it is known to be, in units of the limits."""
    turn, shift_m = pose_difference(found, known)
    return max(turn / limit[0], shift_m / limit[1])


@dataclass(frozen=True, eq=False)
class Placement:
    """Views at the known poses of their cameras.

    Attributes:
        matched: the views; those of known cameras that people do not show have no observations.
        known: the prior of their poses.
        poses: the cameras by name, in the world of the estimate: where they are known to be, also if they moved.
    """

    matched: MatchedViews
    known: KnownPoses
    poses: Mapping[str, Camera]


def place(
    matched: MatchedViews,
    found: Mapping[str, Camera],
    groups: Sequence[KnownGroup],
    kept: Sequence[tuple[str, ...]],
    *,
    add_unseen: bool = False,
) -> Placement:
    """Place the views of known cameras where these are, in the world of the group with the most kept cameras.

    Args:
        matched: the views.
        found: poses of their cameras by name, in any world.
        groups: known cameras; no camera is in two of them.
        kept: of each group, the names of the cameras that are where they are known to be, two at least or none; two at
            least in one group.
        add_unseen: whether known cameras that people do not show are added, as views without observations.
    """
    first = max(range(len(groups)), key=lambda g: len(kept[g]))
    world = similarity([found[n] for n in kept[first]], [groups[first].rig[n] for n in kept[first]])
    poses = {name: world.camera(camera) for name, camera in found.items()}
    placed, rigs = dict(poses), []
    for g, (group, own) in enumerate(zip(groups, kept, strict=True)):
        rig = group.rig
        if g != first and own:
            to_world = similarity([rig[n] for n in own], [poses[n] for n in own], scale=1.0)
            rig = replace(rig, cameras=tuple(to_world.camera(camera) for camera in rig.cameras))
        unseen = [n for n in rig.names if n not in found] if add_unseen and own else []
        there = [n for n in rig.names if n in own or n in unseen]
        if there:
            rigs.append((rig.select(there), group.least_sd))
        placed |= {n: rig[n] for n in (rig.names if own else ())}
        poses |= {n: rig[n] for n in there}
        # Cameras that are elsewhere keep their lenses.
        elsewhere = [n for n in rig.names if n in found and n not in there]
        rigs += [(CameraRig((poses[n],), covariances=_lens_of(rig, n)), group.least_sd) for n in elsewhere]
    lenses = {name for group in groups for name in group.rig.names if _has_free_focal(group.rig, name)}
    views = _views(matched, poses, lenses)
    names = [view.camera.name for view in views]
    known = KnownPoses.nothing(len(views))
    for rig, least_sd in rigs:
        known = known + KnownPoses.of(rig, np.array([names.index(n) for n in rig.names]), len(views), least_sd)
    extra = len(views) - len(matched.views)
    clocks = np.append(matched.offset_s, np.zeros(extra)), np.append(matched.rate, np.ones(extra))
    return Placement(replace(matched, views=views, offset_s=clocks[0], rate=clocks[1]), known, placed)


def _lens_of(rig: CameraRig, name: str) -> tuple:
    own = rig.covariance(name)
    return () if own is None else (own,)


def _has_free_focal(rig: CameraRig, name: str) -> bool:
    """Return whether the focal length of a camera has a covariance."""
    own = rig.covariance(name)
    return own is not None and _FX in own.parameters


def _views(matched: MatchedViews, poses: Mapping[str, Camera], free_lenses: set[str]) -> tuple[ViewTracks, ...]:
    """Return the views at their poses, and empty ones of cameras that have no view."""
    out = []
    for view in matched.views:
        name = view.camera.name
        camera = replace(view.camera, camera_from_world=poses[name].camera_from_world)
        out.append(replace(view, camera=camera, focal_known=view.focal_known and name not in free_lenses))
    like = matched.views[0]
    names = [view.camera.name for view in matched.views]
    for name, camera in poses.items():
        if name not in names:
            nothing = np.full_like(like.keypoints_px, np.nan)
            blind = replace(like, camera=camera, keypoints_px=nothing, confidence=nothing[..., 0])
            out.append(replace(blind, focal_known=name not in free_lenses))
    return tuple(out)
