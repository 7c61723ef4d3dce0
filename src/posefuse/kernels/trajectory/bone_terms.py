"""Bones in the trajectory system: their terms, the information they transfer, and the solve with bones.

Bones couple two keypoints. They are stored separately from the band, as one direction and one stiffness per bone and
frame. The first axis of the other arrays is the keypoint, the second the frame.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel, vectorized
from posefuse.kernels.trajectory.band import invert_3, solve_path

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
def _multiply_bones(bone_terms, first_bone, end_bone, vectors, out):
    """Add the product of the terms of some bones with vectors: the ends are coupled along the bone and across it."""
    for n in range(first_bone, end_bone):
        b = bone_terms.components.bones[n]
        one = vectors[bone_terms.bones[b, 0]]
        other = vectors[bone_terms.bones[b, 1]]
        one_out = out[bone_terms.bones[b, 0]]
        other_out = out[bone_terms.bones[b, 1]]
        for f in range(vectors.shape[1]):
            across = bone_terms.across[b, f]
            x = bone_terms.directions[b, f, 0]
            y = bone_terms.directions[b, f, 1]
            z = bone_terms.directions[b, f, 2]
            u = one[f, 0] - other[f, 0]
            v = one[f, 1] - other[f, 1]
            w = one[f, 2] - other[f, 2]
            along = (bone_terms.stiffness[b, f] - across) * (x * u + y * v + z * w)
            u = along * x + across * u
            v = along * y + across * v
            w = along * z + across * w
            one_out[f, 0] += u
            one_out[f, 1] += v
            one_out[f, 2] += w
            other_out[f, 0] -= u
            other_out[f, 1] -= v
            other_out[f, 2] -= w


@vectorized
def _subtract_information(information, vector, of_band, out):
    """Compute ``out = of_band - information vector`` of one path, shape (frame, 3)."""
    for f in range(vector.shape[0]):
        for i in range(3):
            out[f, i] = of_band[f, i] - (
                information[f, i, 0] * vector[f, 0]
                + information[f, i, 1] * vector[f, 1]
                + information[f, i, 2] * vector[f, 2]
            )


@vectorized
def _combine(first_factor, first, second_factor, second):
    """Compute ``second = first_factor first + second_factor second``, shape (frame, 3)."""
    for f in range(first.shape[0]):
        for i in range(3):
            second[f, i] = first_factor * first[f, i] + second_factor * second[f, i]


@vectorized
def _fill(value, out):
    """Set all elements to a value; a slice assignment does the same but takes seconds to compile."""
    for f in range(out.shape[0]):
        for i in range(3):
            out[f, i] = value


@vectorized
def _inner(first, second):
    """Return the inner product of two arrays of shape (frame, 3)."""
    total = 0.0
    for f in range(first.shape[0]):
        for i in range(3):
            total += first[f, i] * second[f, i]
    return total


class Components(NamedTuple):
    """Groups of keypoints that bones connect.

    Attributes:
        keypoints: keypoints of all groups, one group after the other.
        bones: bones of all groups, one group after the other.
        ends: shape (group, 2), int64: ends of the group's keypoints and of its bones in these.
    """

    keypoints: Any
    bones: Any
    ends: Any


class BoneTerms(NamedTuple):
    """Coupling of keypoints by bones.

    Attributes:
        components: Components.
        bones: shape (bone, 2), int64: keypoints.
        directions: shape (bone, frame, 3).
        stiffness: shape (bone, frame): inverse variance of the length; 0 where the bone is absent.
        across: shape (bone, frame): stiffness against the rotation of the bone, at most that of the length.
        information: shape (keypoint, frame, 3, 3): stands in for the bones on the diagonal of the band.
    """

    components: Any
    bones: Any
    directions: Any
    stiffness: Any
    across: Any
    information: Any


class PathFactor(NamedTuple):
    """Factors of the matrices of all paths: views, smoothness, and the bone information.

    Attributes:
        lower: from :func:`posefuse.kernels.trajectory.band.factor_paths`.
        inverse: likewise.
    """

    lower: Any
    inverse: Any


class Stopping(NamedTuple):
    """When conjugate gradients stop.

    Attributes:
        max_iterations: largest number of iterations.
        tolerance: norm of the preconditioned residual, relative to that at the start.
        negligible: the same norm per coordinate, in standard deviations of the paths.
    """

    max_iterations: Any
    tolerance: Any
    negligible: Any


class _Vectors(NamedTuple):
    """Vectors of conjugate gradients, each of shape (keypoint, frame, 3).

    Attributes:
        residual: right-hand side minus product of the matrix and the steps.
        preconditioned: solution of the paths' matrices for the residual.
        direction: search direction.
        of_band: product of the paths' matrices and the search direction.
        product: product of the whole matrix and the search direction.
    """

    residual: Any
    preconditioned: Any
    direction: Any
    of_band: Any
    product: Any


@vectorized
def _precondition(factor, keypoints, first, end, vectors):
    """Solve the paths of some keypoints separately; return the squared norm of the preconditioned residual."""
    total = 0.0
    for n in range(first, end):
        k = keypoints[n]
        for f in range(vectors.residual.shape[1]):
            for i in range(3):
                vectors.preconditioned[k, f, i] = vectors.residual[k, f, i]
        solve_path(factor.lower[k], factor.inverse[k], vectors.preconditioned[k])
        total += _inner(vectors.residual[k], vectors.preconditioned[k])
    return total


@vectorized
def _multiply_component(bone_terms, group, direction_weight, vectors):
    """Update the search direction of a group of keypoints and its products; return its squared norm.

    The paths' matrices times the preconditioned residual is the residual, so the product with the search direction
    follows from the previous one without the matrices.
    """
    components = bone_terms.components
    first, first_bone = (components.ends[group - 1, 0], components.ends[group - 1, 1]) if group > 0 else (0, 0)
    for n in range(first, components.ends[group, 0]):
        k = components.keypoints[n]
        _combine(1.0, vectors.preconditioned[k], direction_weight, vectors.direction[k])
        _combine(1.0, vectors.residual[k], direction_weight, vectors.of_band[k])
        _subtract_information(bone_terms.information[k], vectors.direction[k], vectors.of_band[k], vectors.product[k])
    _multiply_bones(bone_terms, first_bone, components.ends[group, 1], vectors.direction, vectors.product)
    total = 0.0
    for n in range(first, components.ends[group, 0]):
        k = components.keypoints[n]
        total += _inner(vectors.direction[k], vectors.product[k])
    return total


@kernel
def solve_with_bones(factor, bone_terms, rhs, stopping, steps):
    """Solve jointly for the paths of each group that bones connect, with preconditioned conjugate gradients.

    The method is that of Hestenes & Stiefel 1952. The preconditioner solves every path separately, with the bone
    information on its diagonal. Its norm is the squared step in standard deviations of the paths.

    Args:
        factor: PathFactor.
        bone_terms: BoneTerms.
        rhs: shape (keypoint, frame, 3): right-hand side on input, residual on output.
        stopping: Stopping.
        steps: shape (keypoint, frame, 3), written.

    Returns:
        Largest number of iterations of a group.
    """
    vectors = _Vectors(rhs, np.empty(rhs.shape), np.empty(rhs.shape), np.empty(rhs.shape), np.empty(rhs.shape))
    keypoints, _, ends = bone_terms.components
    most = 0
    for group in range(ends.shape[0]):
        first = ends[group - 1, 0] if group > 0 else 0
        end = ends[group, 0]
        for n in range(first, end):
            k = keypoints[n]
            _fill(0.0, vectors.direction[k])
            _fill(0.0, vectors.of_band[k])
            _fill(0.0, steps[k])
        negligible = stopping.negligible * stopping.negligible * 3.0 * (end - first) * rhs.shape[1]
        norm = previous = limit = 0.0
        for iteration in range(stopping.max_iterations + 1):
            previous, norm = norm, _precondition(factor, keypoints, first, end, vectors)
            if iteration == 0:
                limit = max(stopping.tolerance * stopping.tolerance * norm, negligible)
            if iteration == stopping.max_iterations or (iteration > 0 and not norm > limit) or not norm > 0.0:
                break
            most = max(most, iteration + 1)
            squared = _multiply_component(bone_terms, group, norm / previous if iteration > 0 else 0.0, vectors)
            step_length = norm / squared
            for n in range(first, end):
                k = keypoints[n]
                _combine(step_length, vectors.direction[k], 1.0, steps[k])
                _combine(-step_length, vectors.product[k], 1.0, rhs[k])
    return most


@kernel
def add_bone_gradient(bones, directions, bone_stiffness, length_error, rhs):
    """Add the negative gradient of the length errors to both ends of each bone; shape (keypoint, frame, 3)."""
    for b in range(bones.shape[0]):
        for f in range(rhs.shape[1]):
            for i in range(3):
                step = bone_stiffness[b, f] * length_error[b, f] * directions[b, f, i]
                rhs[bones[b, 0], f, i] -= step
                rhs[bones[b, 1], f, i] += step
