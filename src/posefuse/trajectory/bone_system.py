"""The system of all paths with bones: stiffness of the bones, and one step of the paths with its covariance."""

import numpy as np

from posefuse.kernels.trajectory.band import REACH, factor_paths, invert_paths
from posefuse.kernels.trajectory.bone_terms import (
    BoneTerms,
    PathFactor,
    Stopping,
    add_bone_gradient,
    add_to_diagonal,
    bone_directions,
    propagate_bone_information,
    solve_with_bones,
)
from posefuse.kernels.trajectory.observation_terms import PathSystem
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.paths import PersonPriors

_STOPPING = Stopping(max_iterations=30, tolerance=1e-3, negligible=1e-3)
"""Larger errors than 0.001 standard deviations per coordinate would show as seams between windows."""

_MIN_LENGTH_M = 1e-12
"""Length that stands for none in a quotient."""

_BONE_REACH = 3.0
"""Distance, in standard deviations of length and views, at which a bone holds a quarter as tightly."""
_MAX_RELATIVE_STIFFNESS = 10.0
"""Upper bound of the stiffness of bones, relative to the information of the views along them. Stiffer bones would add
hardly any information but slow down the solve.
"""
_BONE_CORRELATION_S = 0.05
"""Correlation time of the length error of a bone, in seconds."""


def bone_stiffness(
    bones: Bones,
    paths_m: np.ndarray,
    person_priors: PersonPriors,
    alive: np.ndarray,
    variance_m2: np.ndarray,
    step_s: float,
) -> np.ndarray:
    """Return the stiffness of bones, shape (bone, frame): inverse variance of each length per independent frame.

    A bone far from its length, relative to its own variation and the uncertainty of the views, is down-weighted
    (Geman and McClure).

    Args:
        bones: of the skeleton.
        paths_m: shape (keypoint, frame, 3).
        person_priors: of the person.
        alive: shape (keypoint, frame), bool.
        variance_m2: shape (keypoint,): typical variance of a point from a single frame.
        step_s: time between frames.
    """
    one, other = bones.ends.T
    share = min(step_s / (2.0 * _BONE_CORRELATION_S), 1.0)
    seen_m2 = np.nan_to_num(variance_m2[one] + variance_m2[other], nan=np.inf)
    give_m2 = np.square(person_priors.length_sd_m)
    with np.errstate(divide="ignore"):
        stiffness = np.minimum(share / give_m2, _MAX_RELATIVE_STIFFNESS / seen_m2)
    length_error_m = np.linalg.norm(paths_m[one] - paths_m[other], axis=-1) - person_priors.length_m[:, None]
    reach_m2 = _BONE_REACH**2 * (give_m2 + seen_m2)[:, None]
    with np.errstate(invalid="ignore"):
        weight = np.square(1.0 / (1.0 + np.nan_to_num(np.square(length_error_m) / reach_m2)))
    return np.where(alive[one] & alive[other], stiffness[:, None] * weight, 0.0)


def solve_system(
    bones: Bones, paths_m: np.ndarray, system: PathSystem, stiffness: np.ndarray, length_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps of the paths, and the covariance within the band.

    Args:
        bones: of the skeleton.
        paths_m: shape (keypoint, frame, 3).
        system: normal equations without bones; overwritten.
        stiffness: from :func:`bone_stiffness`.
        length_m: shape (bone,).
    """
    band, rhs, information = system
    ends, order = bones.ends, bones.order
    keypoints, frames, _ = paths_m.shape
    directions, length_error = np.empty((len(ends), frames, 3)), np.empty((len(ends), frames))
    # A bone of unknown length has stiffness 0, but a NaN length would spread to all keypoints.
    bone_directions(ends, np.nan_to_num(length_m), paths_m, directions, length_error)
    bone_information = np.empty_like(information)
    propagate_bone_information(
        ends, order, directions, stiffness, information, bone_information, np.empty((len(order), 3, 3))
    )
    add_to_diagonal(bone_information, band)
    add_bone_gradient(ends, directions, stiffness, length_error, rhs)
    lower, inverse = np.empty((keypoints, frames, REACH, 3, 3)), np.empty((keypoints, frames, 3, 3))
    factor_paths(band, lower, inverse, np.empty(keypoints))
    steps, covariance = np.empty_like(rhs), np.empty_like(band)
    solve_with_bones(
        PathFactor(lower, inverse),
        BoneTerms(
            bones.components, ends, directions, stiffness, _across(stiffness, length_error, length_m), bone_information
        ),
        rhs,
        _STOPPING,
        steps,
    )
    invert_paths(lower, inverse, covariance)
    return steps, covariance


def _across(stiffness: np.ndarray, length_error_m: np.ndarray, length_m: np.ndarray) -> np.ndarray:
    """Return the stiffness against the rotation of bones, shape (bone, frame), of those that are longer than known.

    It is the second derivative of the squared error of the length across the bone. Gauss-Newton steps, which leave it
    out, overshoot where a bone is shorter than the errors of its ends, such as those of a face, and alternate between
    two solutions. Its negative values, for bones that are too short, are left out: with them, the system might not be
    positive definite.
    """
    error_m = np.maximum(length_error_m, 0.0)
    return stiffness * error_m / np.maximum(error_m + np.nan_to_num(length_m)[:, None], _MIN_LENGTH_M)
