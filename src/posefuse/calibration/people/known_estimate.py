"""Estimate cameras from people where the poses of some are known, and find those that are no longer there."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.joint.estimate import estimate
from posefuse.calibration.joint.evidence import POSE_KINDS, choose
from posefuse.calibration.people.estimate import PeopleEstimate, estimate_people
from posefuse.calibration.people.joint_recording import joint_recording
from posefuse.calibration.people.known_cameras import (
    KnownGroup,
    Placement,
    kept_cameras,
    place,
    pose_difference,
    posed,
)
from posefuse.calibration.people.views import MatchedViews
from posefuse.calibration.stated_covariance import largest_sd
from posefuse.model.camera_covariance import CENTER, ROTATION
from posefuse.model.cameras import Camera

_ROUNDS = 4
_FIRST_SDS, _FIRST_RAD, _FIRST_SHARE = 4.0, np.radians(3.0), 0.06
"""Limits of the first comparison, which is with a calibration by people alone: its errors are a few degrees."""
_SDS, _LEAST_RAD, _LEAST_SHARE = 3.5, np.radians(0.3), 0.01
"""Limits of cameras that are compared with known ones in the same world, as after a calibration by a board."""
_ROTATION, _CENTER = slice(0, 3), slice(3, 6)


@dataclass(frozen=True, eq=False)
class KnownEstimate:
    """An estimate from people and known poses.

    Attributes:
        matched: the views that it is from.
        estimate: in the world of the known cameras, unless no two of them kept their relative pose.
        placement: the known poses; None if no two cameras kept theirs.
        kept: names of the cameras that are where they are known to be.
        moved: names of the cameras that are elsewhere.
    """

    matched: MatchedViews
    estimate: PeopleEstimate
    placement: Placement | None
    kept: tuple[str, ...]
    moved: tuple[str, ...]


def estimate_with_known(
    matched: MatchedViews, groups: Sequence[KnownGroup], *, add_unseen: bool = False
) -> KnownEstimate:
    """Estimate all cameras from people and from the poses of those that kept theirs.

    Args:
        matched: observations with an approximate calibration.
        groups: known cameras; no camera is in two of them.
        add_unseen: whether known cameras that people do not show are calibrated, too.

    Raises:
        CalibrationError: if no two views observe the same person at the same time.
    """
    alone = estimate_people(matched, held_out=False, refuse=False)
    found = {camera.name: camera for camera in alone.cameras}
    kept = [kept_cameras(found, group, _limits(alone, group, first=True)) for group in groups]
    if not any(kept):
        moved = tuple(n for group in groups if len(group.rig) > 1 for n in group.rig.names if n in found)
        return KnownEstimate(matched, estimate_people(matched), None, (), moved)
    refused: set[str] = set()
    for _ in range(_ROUNDS):
        placement = place(matched, found, groups, kept, add_unseen=add_unseen)
        result = estimate_people(placement.matched, placement.known, held_out=False)
        found = {camera.name: camera for camera in result.cameras if camera.name in found}
        refused |= _refused(placement, result, [n for each in kept for n in each])
        again = [
            _again(placement.poses, result, group, each, refused, found)
            for group, each in zip(groups, kept, strict=True)
        ]
        if again == kept or not any(again):
            break
        kept = again
    placement = place(matched, found, groups, kept, add_unseen=add_unseen)
    result = estimate_people(placement.matched, placement.known)
    names = [n for each in kept for n in each]
    moved = tuple(n for group, each in zip(groups, kept, strict=True) if each for n in group.rig.names if n in found)
    return KnownEstimate(placement.matched, result, placement, tuple(names), tuple(n for n in moved if n not in names))


def _limits(result: PeopleEstimate, group: KnownGroup, *, first: bool) -> Mapping[str, tuple[float, float]]:
    """Return the largest angle and distance at which a camera counts as one that did not move, by name."""
    sds, rad, share = (_FIRST_SDS, _FIRST_RAD, _FIRST_SHARE) if first else (_SDS, _LEAST_RAD, _LEAST_SHARE)
    out = {}
    for v, camera in enumerate(result.cameras):
        turn = largest_sd(result.covariance[v, _ROTATION, v, _ROTATION])
        shift_m = largest_sd(result.covariance[v, _CENTER, v, _CENTER])
        own = group.rig.covariance(camera.name)
        if own is not None:
            turn = float(np.hypot(turn, largest_sd(own.block(ROTATION))))
            shift_m = float(np.hypot(shift_m, largest_sd(own.block(CENTER))))
        out[camera.name] = (
            max(sds * float(np.hypot(turn, group.least_sd[0])), rad),
            max(sds * float(np.hypot(shift_m, group.least_sd[1])), share * group.reach_m),
        )
    return out


def _again(
    poses: Mapping[str, Camera],
    result: PeopleEstimate,
    group: KnownGroup,
    kept: tuple[str, ...],
    refused: set[str],
    shown: Collection[str],
) -> tuple[str, ...]:
    """Return the cameras that are where they are known to be, given the estimate with those that seemed to be."""
    if not kept:
        return ()
    limits = _limits(result, group, first=False)
    out = []
    for camera in result.cameras:
        # People do not show cameras that the placement added.
        if camera.name not in group.rig.names or camera.name in refused or camera.name not in shown:
            continue
        turn, shift_m = pose_difference(camera, poses[camera.name])
        if camera.name in kept or (turn <= limits[camera.name][0] and shift_m <= limits[camera.name][1]):
            out.append(camera.name)
    return tuple(n for n in group.rig.names if n in out) if len(out) > 1 else ()


def _refused(placement: Placement, result: PeopleEstimate, kept: Sequence[str]) -> set[str]:
    """Return kept cameras whose known pose the people contradict, as the check of recordings does."""
    views = []
    for view, camera in zip(placement.matched.views, result.cameras, strict=True):
        known = placement.poses[camera.name] if camera.name in kept else camera
        at = posed(camera, known.rotation, known.center_m)
        views.append(replace(view, camera=at, focal_known=True))
    recording, _ = joint_recording(replace(placement.matched, views=tuple(views)))
    joint = estimate(recording)
    if joint is None:
        return set()
    elsewhere = [v for v, camera in enumerate(result.cameras) if camera.name not in kept]
    choices = choose(joint, elsewhere)
    return {result.cameras[c.explanation.view].name for c in choices if c.explanation.kind in POSE_KINDS}
