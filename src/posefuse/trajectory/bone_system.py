"""The system of all paths with bones: stiffness of the bones, and one step of the paths with its covariance."""

import numpy as np

from posefuse.kernels.trajectory.band import FACTOR_ROWS, LANES, REACH, factor_paths
from posefuse.kernels.trajectory.band_inverse import invert_paths
from posefuse.kernels.trajectory.blocks import empty_blocks
from posefuse.kernels.trajectory.bone_solve import Stopping, Vectors, solve_with_bones
from posefuse.kernels.trajectory.bone_terms import BonePrior, BoneTerms, add_bones, propagate_bone_information
from posefuse.kernels.trajectory.observation_terms import PathSystem
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.paths import PersonPriors

_STOPPING = Stopping(max_iterations=30, tolerance=1e-3, negligible=1e-3)
"""The error of all coordinates of a group of keypoints is 0.001 standard deviations in the root mean square; a single
coordinate may err by up to 0.2."""

_BONE_REACH = 3.0
"""Distance, in standard deviations of length and views, at which a bone holds a quarter as tightly."""
_MAX_RELATIVE_STIFFNESS = 10.0
"""Upper bound of the stiffness of bones, relative to the information of the views along them. Stiffer bones would add
hardly any information but slow down the solve.
"""
_BONE_CORRELATION_S = 0.05
"""Correlation time of the length error of a bone, in seconds."""


def bone_prior(bones: Bones, person_priors: PersonPriors, variance_m2: np.ndarray, step_s: float) -> BonePrior:
    """Return the lengths of bones, and how tightly they hold per independent frame.

    A bone far from its length, relative to its own variation and the uncertainty of the views, is down-weighted.

    Args:
        bones: of the skeleton.
        person_priors: of the person.
        variance_m2: shape (keypoint,): typical variance of a point from a single frame.
        step_s: time between frames.
    """
    one, other = bones.ends.T
    share = min(step_s / (2.0 * _BONE_CORRELATION_S), 1.0)
    seen_m2 = np.nan_to_num(variance_m2[one] + variance_m2[other], nan=np.inf)
    give_m2 = np.square(person_priors.length_sd_m)
    with np.errstate(divide="ignore"):
        stiffness = np.minimum(share / give_m2, _MAX_RELATIVE_STIFFNESS / seen_m2)
    # A bone of unknown length has stiffness 0, but a NaN length would spread to all keypoints.
    return BonePrior(bones.ends, np.nan_to_num(person_priors.length_m), stiffness, _BONE_REACH**2 * (give_m2 + seen_m2))


def solve_system(
    bones: Bones, prior: BonePrior, alive: np.ndarray, paths_m: np.ndarray, system: PathSystem
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the steps of the paths, their covariance, and the traces of the covariance within the band.

    Args:
        bones: of the skeleton.
        prior: of the bones.
        alive: shape (keypoint, frame), bool.
        paths_m: shape (keypoint, frame, 3).
        system: normal equations without bones; overwritten.

    Returns:
        Shapes (keypoint, block, 3 * BLOCK), (keypoint, frame, 3, 3) and (keypoint, REACH + 1, frame).
    """
    keypoints, frames, _ = paths_m.shape
    n_bones, tiles = len(bones.ends), bones.groups.tiles
    terms = BoneTerms(
        empty_blocks(n_bones, frames, 3), empty_blocks(n_bones, frames, 1), empty_blocks(n_bones, frames, 1),
        empty_blocks(keypoints, frames, 6),
    )  # fmt: skip
    if n_bones:
        add_bones(prior, alive, paths_m, terms, system.rhs)
        propagate_bone_information(bones.ends, bones.order, system.information, terms)
        np.add(system.diagonal, terms.information, out=system.diagonal)
    factor = np.empty((len(tiles), frames + 2 * REACH, FACTOR_ROWS * LANES))
    factor_paths(system.diagonal, system.coupling, tiles, factor)
    vectors = Vectors.of(system.rhs, frames)
    solve_with_bones(factor, bones.groups, bones.ends, terms, _STOPPING, vectors)
    covariance, traces = np.empty((keypoints, frames, 3, 3)), np.empty((keypoints, REACH + 1, frames))
    invert_paths(factor, tiles, covariance, traces)
    return vectors.steps, covariance, traces
