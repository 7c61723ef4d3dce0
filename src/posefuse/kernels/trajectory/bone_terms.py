"""Bones in the trajectory system: their terms, the information they transfer, and the solve with bones.

Bones couple two keypoints. They are stored separately from the band, as one direction and one stiffness per bone and
frame. The first axis of the other arrays is the keypoint, the second the frame.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel, vectorized
from posefuse.kernels.trajectory.band import invert_3, multiply_path, solve_path

_RELATIVE_RIDGE = 1e-7
"""Unobserved directions of a point get this fraction of its information."""


@kernel
def bone_directions(bones, lengths, paths, directions, length_error):
    """Compute the directions of bones, from the second end to the first, and the errors of their lengths.

    Args:
        bones: shape (bone, 2), int64: keypoints.
        lengths: shape (bone,).
        paths: shape (keypoint, frame, 3).
        directions: shape (bone, frame, 3), written.
        length_error: shape (bone, frame), written: current minus nominal length.
    """
    for b in range(bones.shape[0]):
        first_end = paths[bones[b, 0]]
        second_end = paths[bones[b, 1]]
        for f in range(paths.shape[1]):
            x = first_end[f, 0] - second_end[f, 0]
            y = first_end[f, 1] - second_end[f, 1]
            z = first_end[f, 2] - second_end[f, 2]
            length = math.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 0.0
            directions[b, f, 0] = scale * x
            directions[b, f, 1] = scale * y
            directions[b, f, 2] = scale * z
            length_error[b, f] = length - lengths[b]


@vectorized
def _add_message(information, direction, bone_stiffness, scratch, out):
    """Add the information a bone transfers from its far end: along the bone, reduced by its length variance."""
    trace = information[0, 0] + information[1, 1] + information[2, 2]
    if not (trace > 0.0 and bone_stiffness > 0.0):
        return
    for i in range(3):
        for j in range(3):
            scratch[0, i, j] = information[i, j]
        scratch[0, i, i] += _RELATIVE_RIDGE * trace
    invert_3(scratch[0], scratch[1])
    variance = 1.0 / bone_stiffness
    for i in range(3):
        for j in range(3):
            variance += direction[i] * scratch[1, i, j] * direction[j]
    for i in range(3):
        for j in range(3):
            out[i, j] += direction[i] * direction[j] / variance


@kernel
def propagate_bone_information(
    bones, tree_order, directions, bone_stiffness, information, bone_information, inward_messages
):
    """Propagate information along bones, frame by frame, from everything beyond them to each keypoint.

    Two sweeps over a forest of bones, exact for a single frame (J. Pearl, "Reverend Bayes on inference engines", 1982):
    towards the root each bone passes on the information of its subtree, then outwards that of everything else.

    Args:
        bones: shape (bone, 2), int64: keypoints.
        tree_order: shape (tree bone, 2), int64: bones of the forest, those nearest to a root first, and which of their
            ends, 0 or 1, is the outer one.
        directions: shape (bone, frame, 3).
        bone_stiffness: shape (bone, frame): inverse variance of the length of the bone in a frame; 0 where it is
            absent.
        information: shape (keypoint, frame, 3, 3): information of each frame.
        bone_information: shape (keypoint, frame, 3, 3), written: information added by bones.
        inward_messages: shape (tree bone, 3, 3), scratch.
    """
    scratch = np.empty((2, 3, 3))
    total = np.empty((3, 3))
    bone_information[:] = 0.0
    for f in range(information.shape[1]):
        for n in range(tree_order.shape[0] - 1, -1, -1):
            b = tree_order[n, 0]
            outer = bones[b, tree_order[n, 1]]
            inner = bones[b, 1 - tree_order[n, 1]]
            for i in range(3):
                for j in range(3):
                    total[i, j] = information[outer, f, i, j] + bone_information[outer, f, i, j]
                    inward_messages[n, i, j] = 0.0
            _add_message(total, directions[b, f], bone_stiffness[b, f], scratch, inward_messages[n])
            for i in range(3):
                for j in range(3):
                    bone_information[inner, f, i, j] += inward_messages[n, i, j]
        for n in range(tree_order.shape[0]):
            b = tree_order[n, 0]
            outer = bones[b, tree_order[n, 1]]
            inner = bones[b, 1 - tree_order[n, 1]]
            for i in range(3):
                for j in range(3):
                    total[i, j] = (
                        information[inner, f, i, j] + bone_information[inner, f, i, j] - inward_messages[n, i, j]
                    )
            _add_message(total, directions[b, f], bone_stiffness[b, f], scratch, bone_information[outer, f])


@kernel
def add_to_diagonal(information, band):
    """Add information of single frames, shape (keypoint, frame, 3, 3), to the bands."""
    for k in range(band.shape[0]):
        for f in range(band.shape[1]):
            for i in range(3):
                for j in range(3):
                    band[k, f, 0, i, j] += information[k, f, i, j]


@vectorized
def _multiply_bones(bones, directions, bone_stiffness, vectors, out):
    """Add the product of the bone terms with vectors: the ends are coupled along the direction of the bone."""
    for b in range(bones.shape[0]):
        first_end = bones[b, 0]
        second_end = bones[b, 1]
        for f in range(vectors.shape[1]):
            w = bone_stiffness[b, f]
            if w == 0.0:
                continue
            separation = 0.0
            for i in range(3):
                separation += directions[b, f, i] * (vectors[first_end, f, i] - vectors[second_end, f, i])
            for i in range(3):
                step = w * separation * directions[b, f, i]
                out[first_end, f, i] += step
                out[second_end, f, i] -= step


@vectorized
def _multiply_views(band, bone_information, vector, out):
    """Multiply one path's vector with its band, without the bone information on the diagonal."""
    multiply_path(band, vector, out)
    for f in range(vector.shape[0]):
        for i in range(3):
            for j in range(3):
                out[f, i] -= bone_information[f, i, j] * vector[f, j]


@vectorized
def _combine(first_factor, first, second_factor, second):
    """Compute ``second = first_factor first + second_factor second``."""
    for k in range(first.shape[0]):
        for f in range(first.shape[1]):
            for i in range(3):
                second[k, f, i] = first_factor * first[k, f, i] + second_factor * second[k, f, i]


@vectorized
def _copy(first, second):
    """Compute ``second = first``; a slice assignment does the same but takes seconds to compile."""
    for k in range(first.shape[0]):
        for f in range(first.shape[1]):
            for i in range(3):
                second[k, f, i] = first[k, f, i]


@vectorized
def _fill(value, out):
    """Set all elements to a value."""
    for k in range(out.shape[0]):
        for f in range(out.shape[1]):
            for i in range(3):
                out[k, f, i] = value


@vectorized
def _inner(first, second):
    """Return the inner product."""
    total = 0.0
    for k in range(first.shape[0]):
        for f in range(first.shape[1]):
            for i in range(3):
                total += first[k, f, i] * second[k, f, i]
    return total


class BoneTerms(NamedTuple):
    """Coupling of keypoints by bones.

    Attributes:
        bones: shape (bone, 2), int64: keypoints.
        directions: shape (bone, frame, 3).
        stiffness: shape (bone, frame): inverse variance of the length; 0 where the bone is absent.
        information: shape (keypoint, frame, 3, 3): stands in for the bones on the diagonal of the band.
    """

    bones: Any
    directions: Any
    stiffness: Any
    information: Any


class PathFactor(NamedTuple):
    """Matrices of all paths and their factors.

    Attributes:
        band: shape (keypoint, frame, REACH + 1, 3, 3): views, smoothness, and the bone information.
        lower: from :func:`posefuse.kernels.trajectory.band.factor_paths`.
        inverse: likewise.
    """

    band: Any
    lower: Any
    inverse: Any


@kernel
def solve_with_bones(factor, bone_terms, rhs, max_iterations, tolerance, steps):
    """Solve jointly for all paths, which bones couple, with preconditioned conjugate gradients.

    The method is that of Hestenes & Stiefel 1952. The preconditioner solves every path separately, with the bone
    information on its diagonal.

    Args:
        factor: PathFactor.
        bone_terms: BoneTerms.
        rhs: shape (keypoint, frame, 3): right-hand side on input, residual on output.
        max_iterations: maximum number of conjugate gradient iterations.
        tolerance: norm of the preconditioned residual, relative to that at the start.
        steps: shape (keypoint, frame, 3), written.

    Returns:
        Number of iterations.
    """
    band, lower, inverse = factor
    bones, directions, bone_stiffness, bone_information = bone_terms
    keypoints = rhs.shape[0]
    z = np.empty(rhs.shape)
    search_direction = np.empty(rhs.shape)
    product = np.empty(rhs.shape)
    _fill(0.0, search_direction)
    _fill(0.0, steps)
    preconditioned_norm = initial_norm = 0.0
    for n in range(max_iterations + 1):
        _copy(rhs, z)
        for k in range(keypoints):
            solve_path(lower[k], inverse[k], z[k])
        previous, preconditioned_norm = preconditioned_norm, _inner(rhs, z)
        initial_norm = preconditioned_norm if n == 0 else initial_norm
        if n == max_iterations or not preconditioned_norm > tolerance * tolerance * initial_norm:
            return n
        direction_weight = preconditioned_norm / previous if n > 0 else 0.0
        _combine(1.0, z, direction_weight, search_direction)
        for k in range(keypoints):
            _multiply_views(band[k], bone_information[k], search_direction[k], product[k])
        _multiply_bones(bones, directions, bone_stiffness, search_direction, product)
        step_length = preconditioned_norm / _inner(search_direction, product)
        _combine(step_length, search_direction, 1.0, steps)
        _combine(-step_length, product, 1.0, rhs)
    return max_iterations


@kernel
def add_bone_gradient(bones, directions, bone_stiffness, length_error, rhs):
    """Add the negative gradient of the length errors to both ends of each bone; shape (keypoint, frame, 3)."""
    for b in range(bones.shape[0]):
        for f in range(rhs.shape[1]):
            for i in range(3):
                step = bone_stiffness[b, f] * length_error[b, f] * directions[b, f, i]
                rhs[bones[b, 0], f, i] -= step
                rhs[bones[b, 1], f, i] += step
