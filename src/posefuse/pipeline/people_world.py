"""World of a calibration by people: its size by the people, up and the floor by their feet and posture."""

import re
from dataclasses import dataclass, replace

import numpy as np

from posefuse.alignment.apply import aligned_rig, identity_alignment
from posefuse.alignment.feet import floor_from_feet
from posefuse.alignment.infer_up import infer_up
from posefuse.alignment.size import estimate_height_m, scale_factor
from posefuse.alignment.world_axes import find_alignment
from posefuse.calibration.people.known_cameras import similarity
from posefuse.calibration.people.known_estimate import KnownEstimate
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.options.calibration import PeopleOptions
from posefuse.model.up_axis import InferredUp
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import ADULT_M

_STATURE_M = 1.7
"""Mean stature of adults."""
_ADULT_SD, _STATURE_SD, _LENGTH_SD, _ANIMAL_SD = 0.06, 0.035, 0.01, 0.2
"""Relative standard deviations of the scale: adults differ by 5 % in stature; proportions, as detectors see them, by
3.5 %.
"""
_ADULT_SHARE = 0.88
"""People smaller than this share of the tallest are children, or adults whom the mean stature does not describe."""
_MAX_FEET_SD_DEG = 10.0
"""Largest standard deviation of the tilt of a floor by feet alone."""
_SCALE = re.compile(r"The scale is set by .*?\(sd\)")
"""What the note of an earlier calibration by people states of the scale."""


@dataclass(frozen=True, eq=False)
class PeopleWorld:
    """The world of a calibration by people.

    Attributes:
        alignment: this world from the world of the estimate.
        scale_sd: relative standard deviation of all lengths; 0 if other than people determine the scale.
        notes: how scale and axes were determined, in sentences.
    """

    alignment: Alignment
    scale_sd: float
    notes: tuple[str, ...]


def earlier_world(found: KnownEstimate, earlier: CameraRig) -> PeopleWorld:
    """Return the world in which the cameras that did not move are where an earlier calibration has them."""
    world = _world_of(found, earlier, "The world and the scale are those of the earlier calibration.")
    # Covariances of cameras do not contain the error of the scale, so this note is all that is known of it.
    scale = [f"Of the earlier calibration: {stated[0]}." for note in earlier.notes if (stated := _SCALE.search(note))]
    return replace(world, notes=(*world.notes, *scale))


def board_world(found: KnownEstimate, by_board: CameraRig) -> PeopleWorld:
    """Return the world of a calibration by a board."""
    return _world_of(found, by_board, "The world and the scale are those of the board.")


def _world_of(found: KnownEstimate, known: CameraRig, note: str) -> PeopleWorld:
    now, kept = CameraRig(found.estimate.cameras), [name for name in found.kept if name in known.names]
    world = similarity([now[name] for name in kept], [known[name] for name in kept], scale=1.0)
    alignment = Alignment(world.rotation, world.shift_m, up_axis=known.up_axis, inferred_up=known.inferred_up)
    return PeopleWorld(alignment, 0.0, (note,))


def people_world(
    points_m: np.ndarray,
    skeleton: Skeleton,
    rig: CameraRig,
    rate_hz: float | None,
    options: PeopleOptions,
    known_scale: str = "",
) -> PeopleWorld:
    """Return the world in which people have their size and stand on the floor, z up where they show it.

    Args:
        points_m: shape (frame, person, keypoint, 3), in a world of any orientation and size.
        skeleton: of the keypoints.
        rig: the cameras in that world.
        rate_hz: frame rate, if known.
        options: stature or length, if known.
        known_scale: what the scale is known from, in a sentence; empty if it is that of the people.

    Raises:
        DetectionsError: if the stature or the length is given, but no person shows it.
        SkeletonError: if a keypoint does not exist.
    """
    scale, scale_sd, note = (1.0, 0.0, known_scale) if known_scale else _scale(points_m, skeleton, options)
    sized = replace(identity_alignment(rig), scale=scale)
    scaled_points, scaled_rig = points_m * scale, aligned_rig(rig, sized)
    turned, notes = _axes(scaled_points, skeleton, scaled_rig, rate_hz)
    return PeopleWorld(replace(turned, scale=scale), scale_sd, (note, *notes))


def _scale(points_m: np.ndarray, skeleton: Skeleton, options: PeopleOptions) -> tuple[float, float, str]:
    """Return the factor of all lengths, its relative standard deviation, and a sentence."""
    if options.length_m is not None:
        align = AlignOptions(length_m=options.length_m, length_between=options.length_between)
        between = " to ".join(options.length_between)
        text = f"The scale is set by the distance from {between}, {options.length_m:g} m."
        return scale_factor([points_m], skeleton, align), _LENGTH_SD, text
    if options.stature_m is not None:
        text = f"The scale is set by the stature of {options.stature_m:g} m, within {100 * _STATURE_SD:g} % (sd)."
        return options.stature_m / max(_heights_m(points_m, skeleton)), _STATURE_SD, text
    try:
        heights_m = _heights_m(points_m, skeleton)
    except DetectionsError:
        return _animal_scale(points_m, skeleton)
    height_m = float(np.mean([each for each in heights_m if each > _ADULT_SHARE * max(heights_m)]))
    text = (
        f"The scale is set by the proportions of an adult of {_STATURE_M:g} m, within {100 * _ADULT_SD:g} % (sd). For "
        "a better one, add `stature_m`, or `length_m` and `length_between`."
    )
    return _STATURE_M / height_m, _ADULT_SD, text


def _heights_m(points_m: np.ndarray, skeleton: Skeleton) -> list[float]:
    """Return the heights of all people who show the limbs that it follows from.

    Raises:
        DetectionsError: if no person does.
    """
    heights, problem = [], None
    for person in range(points_m.shape[1]):
        try:
            heights.append(estimate_height_m([points_m[:, person : person + 1]], skeleton))
        except DetectionsError as error:
            problem = error
    if not heights:
        raise problem or DetectionsError("No person was observed by two cameras.")
    return heights


def _animal_scale(points_m: np.ndarray, skeleton: Skeleton) -> tuple[float, float, str]:
    """Return the scale by the size that the skeleton states, or that of the estimate."""
    size = None if skeleton.tree is None or skeleton.tree.size_m == ADULT_M else skeleton.tree.size_m
    bodies = points_m.reshape(-1, *points_m.shape[-2:])
    whole = bodies[np.isfinite(bodies[..., 0]).mean(axis=1) > 0.5]
    if size is None or not len(whole):
        text = "The scale is unknown: add `length_m` and `length_between`."
        return 1.0, np.nan, text
    extent = np.nanmedian(np.linalg.norm(np.nanmax(whole, axis=1) - np.nanmin(whole, axis=1), axis=-1))
    text = (
        f"The scale is set by the size of {size:g} m that the skeleton {skeleton.name!r} states, within "
        f"{100 * _ANIMAL_SD:g} % (sd). For a better one, add `length_m` and `length_between`."
    )
    return float(size / extent), _ANIMAL_SD, text


def _axes(
    points_m: np.ndarray, skeleton: Skeleton, rig: CameraRig, rate_hz: float | None
) -> tuple[Alignment, tuple[str, ...]]:
    """Return the alignment to the floor, or to the up direction of upright people, or none; and sentences."""
    up, reason = infer_up([points_m], skeleton, rig, rate_hz)
    known = rig.with_up(None, up)
    try:
        found = find_alignment([points_m], skeleton, known, AlignOptions(floor="feet", origin="subject"))
        tilt_deg = _tilt_sd_deg(points_m, skeleton, known)
        if up is not None or tilt_deg < _MAX_FEET_SD_DEG:
            inferred = found.inferred_up or InferredUp((0.0, 0.0, 1.0), max(tilt_deg, 0.1))
            return replace(found, inferred_up=inferred), found.steps
    except (DetectionsError, OptionsError):
        pass
    if up is None:
        first = rig.cameras[0]
        world = Alignment(first.rotation, first.translation_m)
        return world, (f"The up axis is unknown, and the first camera is the world: {reason}.",)
    found = find_alignment([points_m], skeleton, known, AlignOptions(origin="subject"))
    return found, (f"Up is inferred from people: {reason}.", *found.steps)


def _tilt_sd_deg(points_m: np.ndarray, skeleton: Skeleton, rig: CameraRig) -> float:
    """Return the standard deviation of the tilt of the floor by feet alone."""
    up = None if rig.inferred_up is None else np.array(rig.inferred_up.direction)
    return floor_from_feet([points_m], skeleton, up).tilt_sd_deg
