"""A world laid anew: floor, origin, up and forward axes, in this order."""

from collections.abc import Sequence

import numpy as np

from posefuse.alignment.feet import Plane, floor_of_feet
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig, UpAxis, up_vector
from posefuse.model.options.alignment import PRESETS, AlignOptions
from posefuse.skeleton.skeletons import Skeleton

_LEAST_AREA = 1e-3
_ACROSS = 0.9
_SURE = 0.3
_LEAST_WALK_M = 0.5
_SIDES = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"))
_UNREAL = "Unreal is left-handed and in cm: its X, Y, Z are 100 x, -100 y and 100 z of this world."


def lay(points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig, options: AlignOptions) -> Alignment:
    """The world that the options ask for; lengths stay.

    Args:
        points_m: ranges of consecutive frames in the rig's world, each of shape (frame, person, keypoint, 3).
        skeleton: of the keypoints.
        rig: the cameras, whose up axis counts where nothing tells a floor.
        options: what to lay where.

    Raises:
        DetectionsError: if people do not show what is asked for.
        OptionsError: if three points lie on a line, a direction is upright, or there is neither floor nor up axis.
    """
    up = None if rig.up_axis is None else np.array(up_vector(rig.up_axis))
    plane, how = _floor(points_m, skeleton, up, options)
    forward, ahead_how = _ahead(points_m, skeleton, plane.normal, options)
    origin, origin_how = _origin(points_m, plane, options)
    up_axis, forward_axis = PRESETS[options.preset]
    rotation = _turned(plane.normal, forward, up_axis, forward_axis)
    steps = [how, origin_how, ahead_how, f"Up is {up_axis}, forward {forward_axis}."]
    if options.preset == "unreal":
        steps.append(_UNREAL)
    return Alignment(rotation, -rotation @ origin, 1.0, up_axis, rig.up_axis, tuple(steps))


def _floor(
    points_m: Sequence[np.ndarray], skeleton: Skeleton, up: np.ndarray | None, options: AlignOptions
) -> tuple[Plane, str]:
    if options.floor_points_m:
        return _floor_of_points(points_m, np.array(options.floor_points_m, dtype=np.float64).reshape(3, 3))
    if options.floor == "feet":
        plane = floor_of_feet(points_m, skeleton, up)
        return plane, f"The floor is where feet stand still, to {1000 * plane.misfit_m:.0f} mm{_tilt(plane, up)}."
    if up is None:
        raise OptionsError(
            "align: the calibration does not say which way is up. Say it with --up, or find the floor: "
            "align.floor = 'feet', or align.floor_points_m."
        )
    return Plane(up, np.zeros(3)), "The floor is the calibration's."


def _tilt(plane: Plane, up: np.ndarray | None) -> str:
    """What feet and calibration say of the floor's tilt, a clause."""
    known = f"; by them its tilt is known to {plane.doubt_deg:.1f} degrees" if plane.doubt_deg > 0.0 else ""
    if up is None:
        return known
    off = f"{np.degrees(np.arccos(np.clip(plane.normal @ up, -1, 1))):.1f} degrees off the calibration's up"
    counts = ", which counts with them" if plane.up_counts else ", which they contradict and which does not count"
    return f"{known}; {off}{counts}"


def _floor_of_points(points_m: Sequence[np.ndarray], corners: np.ndarray) -> tuple[Plane, str]:
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    size = float(np.linalg.norm(normal))
    longest = max(float(np.linalg.norm(corners[i] - corners[i - 1])) for i in range(3))
    if not size > _LEAST_AREA * longest**2:
        raise OptionsError(f"align.floor_points_m: the three points lie on a line: {corners.tolist()}.")
    normal /= size
    body = np.concatenate([part.reshape(-1, 3) for part in points_m])
    heights = (body[np.isfinite(body[:, 0])] - corners[0]) @ normal
    if len(heights) and np.median(heights) < 0:
        normal = -normal
    return Plane(normal, corners[0]), "The floor goes through three points that were given; up is where people are."


def _origin(points_m: Sequence[np.ndarray], plane: Plane, options: AlignOptions) -> tuple[np.ndarray, str]:
    """A point on the floor."""
    where, how = np.zeros(3), "The origin is on the floor under the calibration's."
    if options.origin_m:
        where, how = (
            np.array(options.origin_m, dtype=np.float64),
            "The origin is on the floor under a point that was given.",
        )
    elif options.origin == "subject":
        middles = np.concatenate([_middles(part) for part in points_m])
        known = middles[np.isfinite(middles[:, 0])]
        if not len(known):
            raise DetectionsError("align.origin = 'subject': nobody is seen in the frames that were looked at.")
        where, how = known[0], "The origin is on the floor where the subject is first seen."
    return where - ((where - plane.point_m) @ plane.normal) * plane.normal, how


def _middles(part: np.ndarray) -> np.ndarray:
    """Shape (frame, 3): the median of everything of the first person in each frame, NaN where nothing is seen."""
    out = np.full((len(part), 3), np.nan)
    if part.shape[1]:
        seen = np.isfinite(part[:, 0, :, 0]).any(axis=1)
        out[seen] = np.nanmedian(part[seen, 0], axis=1)
    return out


def _ahead(
    points_m: Sequence[np.ndarray], skeleton: Skeleton, up: np.ndarray, options: AlignOptions
) -> tuple[np.ndarray, str]:
    """A level unit vector."""
    if options.forward_m:
        given = np.array(options.forward_m, dtype=np.float64) / np.linalg.norm(options.forward_m)
        if abs(given @ up) > 0.99:
            raise OptionsError(f"align.forward_m is upright: {options.forward_m}. Give a direction along the floor.")
        return _level(given, up), "Forward was given."
    if options.forward == "subject":
        return _level(_facing(points_m, skeleton, up), up), "Forward is where the subject faces on the whole."
    if options.forward == "walk":
        return _level(_walk(points_m, up), up), "Forward is where the subject walks on the whole."
    axis = int(np.argmax(np.abs(up) < _ACROSS))
    return _level(np.eye(3)[axis], up), f"Forward is the calibration's {'xyz'[axis]} axis, levelled."


def _level(direction: np.ndarray, up: np.ndarray) -> np.ndarray:
    flat = direction - (direction @ up) * up
    return flat / np.linalg.norm(flat)


def _facing(points_m: Sequence[np.ndarray], skeleton: Skeleton, up: np.ndarray) -> np.ndarray:
    pairs = [(skeleton.index(a), skeleton.index(b)) for a, b in _SIDES if {a, b} <= set(skeleton.keypoints)]
    if not pairs:
        raise DetectionsError(
            f"align.forward = 'subject' needs hips or shoulders, and skeleton {skeleton.name} has neither. "
            "Give align.forward = 'walk' or align.forward_m."
        )
    leftwards = np.concatenate(
        [(part[..., a, :] - part[..., b, :]).reshape(-1, 3) for part in points_m for a, b in pairs]
    )
    ahead = np.cross(leftwards, up)
    size = np.linalg.norm(ahead, axis=-1)
    ahead = ahead[np.isfinite(size) & (size > 0)] / size[np.isfinite(size) & (size > 0), None]
    mean = ahead.mean(axis=0) if len(ahead) else np.zeros(3)
    if np.linalg.norm(mean) < _SURE:
        raise DetectionsError(
            "align.forward = 'subject': the subject faces every way alike. Give align.forward = 'walk', or "
            "align.forward_m."
        )
    return mean


def _walk(points_m: Sequence[np.ndarray], up: np.ndarray) -> np.ndarray:
    middles = np.concatenate([_middles(part) for part in points_m])
    known = middles[np.isfinite(middles[:, 0])]
    way = known[-1] - known[0] if len(known) else np.zeros(3)
    way = way - (way @ up) * up
    if np.linalg.norm(way) < _LEAST_WALK_M:
        raise DetectionsError(
            f"align.forward = 'walk': from first to last the subject gets {np.linalg.norm(way):.2f} m far, less than "
            f"{_LEAST_WALK_M} m. Give align.forward = 'subject' or align.forward_m."
        )
    return way


def _turned(up: np.ndarray, forward: np.ndarray, up_axis: UpAxis, forward_axis: UpAxis) -> np.ndarray:
    """Shape (3, 3): the rotation that puts up and forward along axes."""
    above, ahead = np.array(up_vector(up_axis)), np.array(up_vector(forward_axis))
    new = np.stack([ahead, np.cross(above, ahead), above], axis=1)
    old = np.stack([forward, np.cross(up, forward), up], axis=1)
    return new @ old.T
