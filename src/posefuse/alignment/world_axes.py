"""Determine the world's floor, origin, and up and forward axes, in this order."""

from collections.abc import Sequence

import numpy as np

from posefuse.alignment.feet import CALIBRATED_UP_SD_DEG, Plane, floor_from_feet
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.options.alignment import PRESETS, AlignOptions
from posefuse.model.up_axis import InferredUp, UpAxis, up_vector
from posefuse.skeleton.skeletons import Skeleton

_MIN_AREA = 1e-3
_MAX_VERTICAL = 0.9
_MIN_MEAN_LENGTH = 0.3
_MIN_WALK_M = 0.5
_SIDES = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"))
_UNREAL = "Unreal is left-handed and in cm: its X, Y, Z are 100 x, -100 y and 100 z of this world."


def find_alignment(
    points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig, options: AlignOptions
) -> Alignment:
    """Return the alignment that the options request; lengths stay unchanged.

    Args:
        points_m: ranges of consecutive frames in the rig's world, each of shape (frame, person, keypoint, 3).
        skeleton: of the keypoints.
        rig: the cameras; their up direction is used if no floor is requested.
        options: requested alignment.

    Raises:
        DetectionsError: if the detections do not determine the requested alignment.
        OptionsError: if three points are collinear, a direction is vertical, or there is neither a floor nor an up
            axis.
    """
    plane, floor_note = _floor(points_m, skeleton, rig, options)
    forward, forward_note = _forward(points_m, skeleton, plane.normal, options)
    origin, origin_note = _origin(points_m, plane, options)
    up_axis, forward_axis = PRESETS[options.preset]
    rotation = _axes_rotation(plane.normal, forward, up_axis, forward_axis)
    steps = [floor_note, origin_note, forward_note, f"Up is {up_axis}, forward {forward_axis}."]
    if options.preset == "unreal":
        steps.append(_UNREAL)
    inferred = None
    if rig.inferred_up is not None and plane.uses_up:
        inferred = InferredUp(up_vector(up_axis), min(plane.tilt_sd_deg or np.inf, rig.inferred_up.sd_deg))
    return Alignment(
        rotation, -rotation @ origin, 1.0, up_axis, rig.up_axis, tuple(steps),
        inferred_up=inferred, calibration_inferred_up=rig.inferred_up,
    )  # fmt: skip


def _floor(
    points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig, options: AlignOptions
) -> tuple[Plane, str]:
    """Return the floor and its description."""
    up = _known_up(rig)
    if options.floor_points_m:
        return _floor_of_points(points_m, np.array(options.floor_points_m, dtype=np.float64).reshape(3, 3))
    if options.floor == "feet":
        up_sd_deg = CALIBRATED_UP_SD_DEG if rig.inferred_up is None else rig.inferred_up.sd_deg
        plane = floor_from_feet(points_m, skeleton, up, up_sd_deg=up_sd_deg)
        misfit_mm = 1000 * plane.misfit_m
        return (
            plane,
            f"The floor is the plane where feet stand still, within {misfit_mm:.0f} mm{_tilt_note(plane, rig)}.",
        )
    if up is None:
        raise OptionsError(
            "align: the calibration does not define the up axis. Set it with `up`, or estimate the floor with "
            "align.floor = 'feet' or align.floor_points_m."
        )
    if rig.inferred_up is not None:
        text = "The floor is perpendicular to the up direction inferred from people, through the calibration's origin."
        return Plane(up, np.zeros(3), uses_up=True), text
    return Plane(up, np.zeros(3), uses_up=True), "The floor is that of the calibration."


def _known_up(rig: CameraRig) -> np.ndarray | None:
    """Return the up direction that the calibration states or people show, shape (3,); None if unknown."""
    if rig.inferred_up is not None:
        return np.array(rig.inferred_up.level_direction)
    return None if rig.up is None else np.array(rig.up)


def _tilt_note(plane: Plane, rig: CameraRig) -> str:
    """Describe the tilt of the floor and its agreement with the up direction, as a clause."""
    known = f"; its tilt has a standard deviation of {plane.tilt_sd_deg:.1f} degrees" if plane.tilt_sd_deg > 0.0 else ""
    up = _known_up(rig)
    if up is None:
        return known
    source = "the calibration's up axis" if rig.inferred_up is None else "the up direction inferred from people"
    off = f"{np.degrees(np.arccos(np.clip(plane.normal @ up, -1, 1))):.1f} degrees from {source}"
    counts = ", which is combined with the feet" if plane.uses_up else ", which contradicts the feet and is not used"
    return f"{known}; {off}{counts}"


def _floor_of_points(points_m: Sequence[np.ndarray], corners: np.ndarray) -> tuple[Plane, str]:
    """Return the plane through three points, with people above it."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    size = float(np.linalg.norm(normal))
    longest = max(float(np.linalg.norm(corners[i] - corners[i - 1])) for i in range(3))
    if not size > _MIN_AREA * longest**2:
        raise OptionsError(f"align.floor_points_m: the three points must not be collinear, got {corners.tolist()}.")
    normal /= size
    body = np.concatenate([part.reshape(-1, 3) for part in points_m])
    heights = (body[np.isfinite(body[:, 0])] - corners[0]) @ normal
    if len(heights) and np.median(heights) < 0:
        normal = -normal
    return Plane(normal, corners[0]), "The floor is the plane through the three given points; people are above it."


def _origin(points_m: Sequence[np.ndarray], plane: Plane, options: AlignOptions) -> tuple[np.ndarray, str]:
    """Return the origin, a point on the floor, and its description."""
    point, floor_note = np.zeros(3), "The origin is on the floor under the calibration's."
    if options.origin_m:
        point, floor_note = (
            np.array(options.origin_m, dtype=np.float64),
            "The origin is on the floor under the given point.",
        )
    elif options.origin == "subject":
        centers = np.concatenate([_centers(part) for part in points_m])
        known = centers[np.isfinite(centers[:, 0])]
        if not len(known):
            raise DetectionsError("align.origin = 'subject': no person is visible in the sampled frames.")
        point, floor_note = known[0], "The origin is on the floor under the subject's first position."
    return point - ((point - plane.point_m) @ plane.normal) * plane.normal, floor_note


def _centers(part: np.ndarray) -> np.ndarray:
    """Return the median of all keypoints of the first person in each frame, shape (frame, 3), NaN without any."""
    out = np.full((len(part), 3), np.nan)
    if part.shape[1]:
        seen = np.isfinite(part[:, 0, :, 0]).any(axis=1)
        out[seen] = np.nanmedian(part[seen, 0], axis=1)
    return out


def _forward(
    points_m: Sequence[np.ndarray], skeleton: Skeleton, up: np.ndarray, options: AlignOptions
) -> tuple[np.ndarray, str]:
    """Return the forward direction, a horizontal unit vector, and its description."""
    if options.forward_m:
        direction = np.array(options.forward_m, dtype=np.float64) / np.linalg.norm(options.forward_m)
        if abs(direction @ up) > 0.99:
            raise OptionsError(f"align.forward_m is vertical: {options.forward_m}. Set a horizontal direction.")
        return _horizontal(direction, up), "Forward is the given direction."
    if options.forward == "subject":
        return _horizontal(
            _facing_direction(points_m, skeleton, up), up
        ), "Forward is the mean facing direction of the subject."
    if options.forward == "walk":
        return _horizontal(_walking_direction(points_m, up), up), "Forward is the direction in which the subject walks."
    axis = int(np.argmax(np.abs(up) < _MAX_VERTICAL))
    return _horizontal(np.eye(3)[axis], up), f"Forward is the calibration's {'xyz'[axis]} axis, made horizontal."


def _horizontal(direction: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the horizontal unit vector of a direction."""
    horizontal = direction - (direction @ up) * up
    return horizontal / np.linalg.norm(horizontal)


def _facing_direction(points_m: Sequence[np.ndarray], skeleton: Skeleton, up: np.ndarray) -> np.ndarray:
    """Return the mean facing direction of the subject."""
    pairs = [(skeleton.index(a), skeleton.index(b)) for a, b in _SIDES if {a, b} <= set(skeleton.keypoints)]
    if not pairs:
        raise DetectionsError(
            f"align.forward = 'subject' needs hips or shoulders, and skeleton {skeleton.name} has neither. "
            "Set align.forward = 'walk' or align.forward_m."
        )
    leftward = np.concatenate(
        [(part[..., a, :] - part[..., b, :]).reshape(-1, 3) for part in points_m for a, b in pairs]
    )
    ahead = np.cross(leftward, up)
    size = np.linalg.norm(ahead, axis=-1)
    ahead = ahead[np.isfinite(size) & (size > 0)] / size[np.isfinite(size) & (size > 0), None]
    mean = ahead.mean(axis=0) if len(ahead) else np.zeros(3)
    if np.linalg.norm(mean) < _MIN_MEAN_LENGTH:
        raise DetectionsError(
            "align.forward = 'subject': the subject has no predominant facing direction. Set align.forward = 'walk' or "
            "align.forward_m."
        )
    return mean


def _walking_direction(points_m: Sequence[np.ndarray], up: np.ndarray) -> np.ndarray:
    """Return the horizontal displacement from the first to the last position of the subject."""
    centers = np.concatenate([_centers(part) for part in points_m])
    known = centers[np.isfinite(centers[:, 0])]
    displacement = known[-1] - known[0] if len(known) else np.zeros(3)
    displacement = displacement - (displacement @ up) * up
    if np.linalg.norm(displacement) < _MIN_WALK_M:
        raise DetectionsError(
            f"align.forward = 'walk': the subject moves by {np.linalg.norm(displacement):.2f} m from the first to the "
            f"last frame, less than {_MIN_WALK_M} m. Set align.forward = 'subject' or align.forward_m."
        )
    return displacement


def _axes_rotation(up: np.ndarray, forward: np.ndarray, up_axis: UpAxis, forward_axis: UpAxis) -> np.ndarray:
    """Return the rotation that maps up and forward to the given axes, shape (3, 3)."""
    up_vector_new, ahead = np.array(up_vector(up_axis)), np.array(up_vector(forward_axis))
    new = np.stack([ahead, np.cross(up_vector_new, ahead), up_vector_new], axis=1)
    old = np.stack([forward, np.cross(up, forward), up], axis=1)
    return new @ old.T
