"""Feet of fitted bodies that rest while they are in contact: legs follow by inverse kinematics.

Bodies are fitted before the ground is known. Where the solved layer has a foot in contact, the foot of the body rests,
too: it moves as a rigid body, and the knee bends so that thigh and shank keep their lengths.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation

from posefuse.biomechanics.foot_paths import HEEL, SIDES, TOES, part_keypoints
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer, Reconstruction, unpack_covariance
from posefuse.model.status import is_used
from posefuse.model.track_events import Poses
from posefuse.pipeline.foot_contact import FootContact
from posefuse.trajectory.ground_contact import GroundContact

_MEMORY_S = 0.2
"""Correlation time of the errors of fitted feet."""
_SHIFT_SD_M, _TURN_SD, _FIT_SD_M = 0.03, 0.15, 0.002
"""Standard deviations of the shift of a foot, of its turn in rad, and of what a rigid foot does not explain."""
_LEAST_WEIGHT = 0.02
"""Weight of a keypoint of the foot that is not in contact."""
_LARGEST_MOVE_SD = 2.5
"""Largest move in standard deviations of the point: a foot that would have to move more does not rest."""


@dataclass(frozen=True)
class _Leg:
    """Indices of a leg's keypoints, and of its bones and segment among the poses; -1 without.

    Attributes:
        hip: keypoint.
        knee: keypoint.
        ankle: keypoint.
        feet: keypoints of heel and toes.
        bones: bones that end in the knee and in the ankle.
        segment: segment of the foot.
    """

    hip: int
    knee: int
    ankle: int
    feet: tuple[int, ...]
    bones: tuple[int, int]
    segment: int


def with_resting_feet(
    part: Reconstruction, solved: Layer, contact: FootContact, rig: CameraRig, detections: Detections
) -> Reconstruction:
    """Return consecutive frames whose fitted bodies neither slide nor sink while their feet are in contact.

    Points and poses of the legs move. The covariances stay: they do not count what contact adds.

    Args:
        part: the frames, with a ``model`` layer, poses and tracks.
        solved: solved layer of the same frames, which shows the contact.
        contact: estimates the contact of feet.
        rig: calibrated cameras.
        detections: detections of the same frames.
    """
    layer, poses = part.layers["model"], part.poses
    assert poses is not None
    points, turns, directions = np.array(layer.points_m), np.array(poses.turns), np.array(poses.directions)
    paths_m, paths_m2 = np.asarray(solved.points_m), unpack_covariance(np.asarray(solved.covariance_m2))
    for p in range(points.shape[1]):
        found = contact(p, part.time_s, paths_m[:, p].swapaxes(0, 1), paths_m2[:, p].swapaxes(0, 1))
        if found is None:
            continue
        sds_m = np.sqrt(np.nanmedian(np.asarray(layer.covariance_m2)[:, p][..., [0, 3, 5]].mean(axis=-1), axis=0))
        moves = {
            keypoint: _move_m(found, c, part.time_s, points[:, p, keypoint], sds_m[keypoint])
            for c, keypoint in enumerate(found.keypoints)
        }
        for side in SIDES:
            _move_leg(_leg(part, poses, side), moves, points[:, p], (turns[:, p], directions[:, p]))
    layers = {**part.layers, "model": _with_errors(replace(layer, points_m=points), layer, rig, detections, part)}
    return replace(part, layers=layers, poses=replace(poses, turns=turns, directions=directions))


def _move_m(
    contact: GroundContact, c: int, time_s: np.ndarray, path_m: np.ndarray, sd_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much a keypoint of the foot moves, shape (frame, 3), and its weight, shape (frame,).

    The errors of its path are correlated in time. Their most probable values make it rest on the ground while it is in
    contact, and vanish with the correlation before and after. Moves beyond what errors explain are shortened.
    """
    known = np.asarray(np.isfinite(path_m).all(axis=1))
    moves, weight = np.zeros_like(path_m), np.where(known, np.maximum(contact.touching[c], _LEAST_WEIGHT), 0.0)
    if not known.any():
        return moves, weight
    terms = contact.terms(time_s)
    path = np.where(known[:, None], path_m, 0.0)
    both = known[1:] & known[:-1]
    rest = np.where(both, terms.rest[c], 0.0)
    slip = np.diff(path, axis=0) - terms.steps_m
    decay = np.exp(-np.diff(time_s) / _MEMORY_S)
    steady = 1.0 / (sd_m**2 * (1.0 - decay**2))
    bands = np.zeros((2, len(path)))
    bands[1, 0] = sd_m**-2
    bands[1, 1:] += steady + rest
    bands[1, :-1] += decay**2 * steady + rest
    bands[0, 1:] = -decay * steady - rest
    right = np.zeros_like(path)
    right[1:] -= rest[:, None] * slip
    right[:-1] += rest[:, None] * slip
    moves = solveh_banded(bands, right)
    # Along the normal of the ground, its height is known, too.
    support = np.where(known, terms.support[c], 0.0)
    bands[1] += support
    above = support * (terms.heights_m[c] - path @ terms.normal)
    along = solveh_banded(bands, right @ terms.normal + above)
    moves += (along - moves @ terms.normal)[:, None] * terms.normal
    longest_m = _LARGEST_MOVE_SD * sd_m
    return moves * (longest_m / np.maximum(np.linalg.norm(moves, axis=1), longest_m))[:, None], weight


def _leg(part: Reconstruction, poses: Poses, side: str) -> _Leg:
    """Return the indices of a leg."""
    index = part.skeleton.index
    feet = (*part_keypoints(part.skeleton, side, HEEL), *part_keypoints(part.skeleton, side, TOES))
    bones = tuple(poses.bones.index(f"{side}_{name}") for name in ("knee", "ankle"))
    segment = f"{side}_foot"
    return _Leg(
        index(f"{side}_hip"), index(f"{side}_knee"), index(f"{side}_ankle"), feet, (bones[0], bones[1]),
        poses.segments.index(segment) if segment in poses.segments else -1,
    )  # fmt: skip


def _move_leg(
    leg: _Leg,
    moves: Mapping[int, tuple[np.ndarray, np.ndarray]],
    points_m: np.ndarray,
    bodies: tuple[np.ndarray, np.ndarray],
) -> None:
    """Move a foot and bend its leg, in place.

    Args:
        leg: indices of the leg.
        moves: moves and weights of the keypoints of feet.
        points_m: shape (frame, keypoint, 3).
        bodies: turns of segments, shape (frame, segment, 3, 3), and directions of bones, shape (frame, bone, 3).
    """
    turns, directions = bodies
    rows = np.flatnonzero(np.isfinite(points_m[:, [leg.hip, leg.knee, leg.ankle]]).all(axis=(1, 2)))
    hip, knee, ankle = (points_m[rows, each] for each in (leg.hip, leg.knee, leg.ankle))
    feet = points_m[rows][:, leg.feet]
    by = np.stack([moves[keypoint][0][rows] for keypoint in leg.feet], axis=1)
    weight = np.stack([moves[keypoint][1][rows] for keypoint in leg.feet], axis=1)
    shift, turn = _rigid_motion(feet - ankle[:, None], by, weight)
    rotation = Rotation.from_rotvec(turn).as_matrix()
    ankle_to, knee_to = _bend(hip, knee, ankle, ankle + shift)
    points_m[rows, leg.knee], points_m[rows, leg.ankle] = knee_to, ankle_to
    for k, keypoint in enumerate(leg.feet):
        points_m[rows, keypoint] = ankle_to + np.einsum("fij,fj->fi", rotation, feet[:, k] - ankle)
    if leg.segment >= 0:
        turns[rows, leg.segment] = rotation @ turns[rows, leg.segment]
    thigh, shank = leg.bones
    directions[rows, thigh] = _turned(directions[rows, thigh], knee - hip, knee_to - hip)
    directions[rows, shank] = _turned(directions[rows, shank], ankle - knee, ankle_to - knee_to)


def _rigid_motion(arms_m: np.ndarray, moves_m: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the most probable shift and turn of feet about their ankles, each of shape (row, 3).

    Args:
        arms_m: shape (row, keypoint, 3): keypoints relative to the ankle.
        moves_m: shape (row, keypoint, 3): moves of the keypoints.
        weight: shape (row, keypoint): weights of the moves.
    """
    x, y, z = np.moveaxis(np.where(np.isfinite(arms_m), arms_m, 0.0), -1, 0)
    zero = np.zeros_like(x)
    # A turn w moves an arm by w x arm.
    by_turn = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=-1).reshape(*arms_m.shape, 3)
    jacobian = np.concatenate([np.broadcast_to(np.eye(3), by_turn.shape), by_turn], axis=-1)
    weighted = np.expand_dims(weight, (-1, -2)) * jacobian
    hessian = np.einsum("fkia,fkib->fab", weighted, jacobian) / _FIT_SD_M**2
    hessian += np.diag([*[_SHIFT_SD_M**-2] * 3, *[_TURN_SD**-2] * 3])
    right = np.einsum("fkia,fki->fa", weighted, moves_m) / _FIT_SD_M**2
    solution = np.linalg.solve(hessian, right[..., None])[..., 0]
    return solution[:, :3], solution[:, 3:]


def _bend(hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ankle and knee, each of shape (row, 3), in m, with the ankle as near to its target as the leg reaches."""
    thigh, shank = np.linalg.norm(knee - hip, axis=1), np.linalg.norm(ankle - knee, axis=1)
    line = target - hip
    length = np.linalg.norm(line, axis=1)
    line = line / length[:, None]
    # Legs that are longer or shorter than they can be reach as far as they did.
    before = np.linalg.norm(ankle - hip, axis=1)
    reach = np.clip(length, np.minimum(np.abs(thigh - shank), before), np.maximum(0.9995 * (thigh + shank), before))
    along = (thigh**2 - shank**2 + reach**2) / (2.0 * reach)
    out = np.sqrt(np.maximum(thigh**2 - along**2, 0.0))
    side = (knee - hip) - np.einsum("fi,fi->f", knee - hip, line)[:, None] * line
    size = np.linalg.norm(side, axis=1, keepdims=True)
    side = np.where(size > 1e-9, side / np.maximum(size, 1e-9), 0.0)
    return hip + reach[:, None] * line, hip + along[:, None] * line + out[:, None] * side


def _turned(vectors: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return vectors turned by the smallest rotations that turn other vectors, each of shape (row, 3)."""
    a = before / np.linalg.norm(before, axis=1, keepdims=True)
    b = after / np.linalg.norm(after, axis=1, keepdims=True)
    axis, cosine = np.cross(a, b), np.einsum("fi,fi->f", a, b)[:, None]
    own = np.einsum("fi,fi->f", axis, vectors)[:, None]
    return cosine * vectors + np.cross(axis, vectors) + axis * own / (1.0 + cosine)


def _with_errors(moved: Layer, layer: Layer, rig: CameraRig, detections: Detections, part: Reconstruction) -> Layer:
    """Return the layer with the reprojection errors of points that moved."""
    assert part.tracks is not None
    rows, points = part.tracks.rows(detections), np.asarray(moved.points_m)
    changed = (points != np.asarray(layer.points_m)).any(axis=-1) & np.isfinite(points[..., 0])
    errors = np.array(layer.view_error_px)
    for v, camera in enumerate(rig.cameras):
        at = changed & (rows[:, :, v] >= 0)[..., None]
        f, p, k = np.nonzero(at)
        pixels = np.asarray(detections.keypoints_px)[rows[f, p, v], k]
        errors[f, p, k, v] = np.linalg.norm(camera.project(points[at])[0] - pixels, axis=-1)
    counted = is_used(np.asarray(layer.view_status)) & np.isfinite(errors)
    number = counted.sum(axis=-1)
    mean = np.where(counted, errors, 0.0).sum(axis=-1, dtype=np.float64) / np.maximum(number, 1)
    mean = np.where(changed & (number > 0), mean, np.asarray(layer.reprojection_error_px))
    return replace(moved, view_error_px=errors, reprojection_error_px=mean)
