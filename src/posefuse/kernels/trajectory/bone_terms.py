"""Bones in the trajectory system: their terms, and the information they transfer.

Bones couple two keypoints. They are stored separately from the matrices of the paths, as one direction and one
stiffness per bone and frame. Arrays of numbers per keypoint or bone and frame are in blocks, see
:mod:`posefuse.kernels.trajectory.blocks`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import inline, kernel

_RELATIVE_RIDGE = 1e-7
"""Unobserved directions of a point get this fraction of its information."""

_MIN_PIVOT = 1e-13


class BonePrior(NamedTuple):
    """Lengths of bones.

    Attributes:
        bones: shape (bone, 2), int64: keypoints.
        lengths: shape (bone,); 0 where unknown.
        stiffness: shape (bone,): inverse variance of the length of a bone near its length; 0 without an effect.
        reach_squared: shape (bone,): squared length error at which a bone holds a quarter as tightly.
    """

    bones: Any
    lengths: Any
    stiffness: Any
    reach_squared: Any


class BoneTerms(NamedTuple):
    """Coupling of keypoints by bones.

    Attributes:
        directions: shape (bone, block, 3 * BLOCK): unit vectors from the second end to the first.
        stiffness: shape (bone, block, BLOCK): inverse variance of the length; 0 where the bone is absent.
        across: shape (bone, block, BLOCK): stiffness against the rotation of the bone, at most that of the length.
        information: shape (keypoint, block, 6 * BLOCK): stands in for the bones on the diagonal of the matrices.
    """

    directions: Any
    stiffness: Any
    across: Any
    information: Any


@kernel
def add_bones(prior, alive, paths, terms, rhs):
    """Write the directions and the stiffness of bones, and add the negative gradient of their length errors.

    A bone far from its length is down-weighted (Geman and McClure). The second derivative of the squared error across a
    bone is its stiffness times the relative excess of its length. Gauss-Newton steps, which leave it out, overshoot
    where a bone is shorter than the errors of its ends, such as those of a face, and alternate between two solutions.
    Bones that are too short would have a negative one, with which the system might not be positive definite.

    Args:
        prior: BonePrior.
        alive: shape (keypoint, frame), bool: where paths are defined.
        paths: shape (keypoint, frame, 3).
        terms: BoneTerms; all but the information are written.
        rhs: shape (keypoint, block, 3 * BLOCK), added to.
    """
    bones, lengths, full_stiffness, reach_squared = prior
    directions, stiffness = terms.directions, terms.stiffness
    frames = paths.shape[1]
    pull = np.empty(BLOCK)
    for n in range(bones.shape[0]):
        one = bones[n, 0]
        other = bones[n, 1]
        for b in range(directions.shape[1]):
            for j in range(BLOCK):
                f = min(b * BLOCK + j, frames - 1)
                x = paths[one, f, 0] - paths[other, f, 0]
                y = paths[one, f, 1] - paths[other, f, 1]
                z = paths[one, f, 2] - paths[other, f, 2]
                length = math.sqrt(x * x + y * y + z * z)
                scale = 1.0 / length if length > 0.0 else 0.0
                error = length - lengths[n]
                relative = error * error / reach_squared[n]
                weight = 1.0 / (1.0 + (relative if relative == relative else 0.0))
                present = alive[one, f] and alive[other, f] and f == b * BLOCK + j
                w = full_stiffness[n] * weight * weight if present else 0.0
                stiffness[n, b, j] = w
                terms.across[n, b, j] = w * error * scale if error > 0.0 else 0.0
                pull[j] = w * error if w > 0.0 else 0.0
                directions[n, b, j] = scale * x
                directions[n, b, BLOCK + j] = scale * y
                directions[n, b, 2 * BLOCK + j] = scale * z
            for i in range(3):
                for j in range(BLOCK):
                    step = pull[j] * directions[n, b, i * BLOCK + j]
                    rhs[one, b, i * BLOCK + j] -= step
                    rhs[other, b, i * BLOCK + j] += step


@inline
def _message(total, direction, stiffness, out):
    """Compute the information a bone transfers from its far end: along the bone, reduced by its length variance.

    Args:
        total: shape (6, BLOCK): information at the far end.
        direction: shape (3 * BLOCK,).
        stiffness: shape (BLOCK,).
        out: shape (6, BLOCK), written.
    """
    for j in range(BLOCK):
        trace = total[0, j] + total[3, j] + total[5, j]
        ridge = _RELATIVE_RIDGE * trace
        xx = total[0, j] + ridge
        yy = total[3, j] + ridge
        zz = total[5, j] + ridge
        min_pivot = _MIN_PIVOT * (xx + yy + zz) + 1e-300
        d0 = max(xx, min_pivot)
        l1 = total[1, j] / d0
        l2 = total[2, j] / d0
        d1 = max(yy - l1 * total[1, j], min_pivot)
        e = total[4, j] - l1 * total[2, j]
        l3 = e / d1
        d2 = max(zz - l2 * total[2, j] - l3 * e, min_pivot)
        x = direction[j]
        y = direction[BLOCK + j]
        z = direction[2 * BLOCK + j]
        y1 = y - l1 * x
        y2 = z - l2 * x - l3 * y1
        variance = 1.0 / stiffness[j] + x * x / d0 + y1 * y1 / d1 + y2 * y2 / d2
        gain = 1.0 / variance if (trace > 0.0) & (stiffness[j] > 0.0) else 0.0
        out[0, j] = gain * x * x
        out[1, j] = gain * x * y
        out[2, j] = gain * x * z
        out[3, j] = gain * y * y
        out[4, j] = gain * y * z
        out[5, j] = gain * z * z


@kernel
def propagate_bone_information(bones, tree_order, information, terms):
    """Propagate information along bones, frame by frame, from everything beyond them to each keypoint.

    Two sweeps over a forest of bones, exact for a single frame (J. Pearl, "Reverend Bayes on inference engines", 1982):
    towards the root each bone passes on the information of its subtree, then outwards that of everything else.

    Args:
        bones: shape (bone, 2), int64: keypoints.
        tree_order: shape (tree bone, 2), int64: bones of the forest, those nearest to a root first, and which of their
            ends, 0 or 1, is the outer one.
        information: shape (keypoint, block, 6 * BLOCK): of each frame.
        terms: BoneTerms; the information added by bones is written.
    """
    directions, stiffness, _, bone_information = terms
    inward = np.empty((tree_order.shape[0], 6, BLOCK))
    total = np.empty((6, BLOCK))
    outward = np.empty((6, BLOCK))
    for b in range(information.shape[1]):
        for k in range(information.shape[0]):
            for i in range(6 * BLOCK):
                bone_information[k, b, i] = 0.0
        for step in range(2 * tree_order.shape[0]):
            towards_root = step < tree_order.shape[0]
            n = tree_order.shape[0] - 1 - step if towards_root else step - tree_order.shape[0]
            bone = tree_order[n, 0]
            outer = bones[bone, tree_order[n, 1]]
            inner = bones[bone, 1 - tree_order[n, 1]]
            origin = outer if towards_root else inner
            target = inner if towards_root else outer
            for i in range(6):
                for j in range(BLOCK):
                    known = 0.0 if towards_root else inward[n, i, j]
                    total[i, j] = (
                        information[origin, b, i * BLOCK + j] + bone_information[origin, b, i * BLOCK + j] - known
                    )
            _message(total, directions[bone, b], stiffness[bone, b], outward)
            for i in range(6):
                for j in range(BLOCK):
                    bone_information[target, b, i * BLOCK + j] += outward[i, j]
                    inward[n, i, j] = outward[i, j]
