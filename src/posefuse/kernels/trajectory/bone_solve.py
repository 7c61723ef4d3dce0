"""Joint solve for the paths of keypoints that bones connect, with preconditioned conjugate gradients.

Arrays of numbers per keypoint or bone and frame are in blocks, see :mod:`posefuse.kernels.trajectory.blocks`.
"""

from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import disjoint, kernel, subroutine, vectorized
from posefuse.kernels.trajectory.band import LANES, REACH, gather_vector, scatter_vector, solve_tile


class Groups(NamedTuple):
    """Groups of keypoints that bones connect; keypoints without bones are one group.

    Attributes:
        tiles: shape (tile, LANES), int64: keypoints of all groups, one group after the other; -1 where a lane is not
            used.
        bones: shape (bone,), int64: bones of all groups, one group after the other.
        ends: shape (group, 2), int64: ends of the group's tiles and of its bones in these.
    """

    tiles: Any
    bones: Any
    ends: Any


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


class Vectors(NamedTuple):
    """Vectors of conjugate gradients, each of shape (keypoint, block, 3 * BLOCK); the padding of blocks stays 0.

    Attributes:
        residual: right-hand side on input; right-hand side minus product of the matrix and the steps.
        steps: solution.
        preconditioned: solution of the paths' matrices for the residual.
        direction: search direction.
        of_band: product of the paths' matrices and the search direction.
        product: product of the whole matrix and the search direction.
        tile: shape (REACH + frame + REACH, 3 * LANES): vector of a tile.
    """

    residual: Any
    steps: Any
    preconditioned: Any
    direction: Any
    of_band: Any
    product: Any
    tile: Any

    @classmethod
    def of(cls, rhs: np.ndarray, frames: int) -> "Vectors":
        """Return the vectors for a right-hand side, which is overwritten; all others are 0."""
        steps, preconditioned, direction, of_band, product = (np.zeros(rhs.shape) for _ in range(5))
        tile = np.zeros((frames + 2 * REACH, 3 * LANES))
        return cls(rhs, steps, preconditioned, direction, of_band, product, tile)


@disjoint
def _combine(first_factor, first, second_factor, second):
    """Compute ``second = first_factor first + second_factor second``, shape (block, 3 * BLOCK)."""
    for b in range(first.shape[0]):
        for j in range(3 * BLOCK):
            second[b, j] = first_factor * first[b, j] + second_factor * second[b, j]


@vectorized
def _inner(first, second):
    """Return the inner product of two arrays of shape (block, 3 * BLOCK)."""
    total = 0.0
    for b in range(first.shape[0]):
        for j in range(3 * BLOCK):
            total += first[b, j] * second[b, j]
    return total


@disjoint
def _subtract_information(information, vector, of_band, out):
    """Compute ``out = of_band - information vector`` of one path."""
    for b in range(vector.shape[0]):
        own = information[b]
        x = vector[b]
        y = of_band[b]
        z = out[b]
        for j in range(BLOCK):
            x0 = x[j]
            x1 = x[BLOCK + j]
            x2 = x[2 * BLOCK + j]
            z[j] = y[j] - (own[j] * x0 + own[BLOCK + j] * x1 + own[2 * BLOCK + j] * x2)
            z[BLOCK + j] = y[BLOCK + j] - (own[BLOCK + j] * x0 + own[3 * BLOCK + j] * x1 + own[4 * BLOCK + j] * x2)
            z[2 * BLOCK + j] = y[2 * BLOCK + j] - (
                own[2 * BLOCK + j] * x0 + own[4 * BLOCK + j] * x1 + own[5 * BLOCK + j] * x2
            )


@disjoint
def _couple(direction, stiffness, across, one, other, one_out, other_out):
    """Add the product of the terms of a bone, along it and across it, with the vectors of its ends."""
    for b in range(one.shape[0]):
        d = direction[b]
        w = stiffness[b]
        rest = across[b]
        p = one[b]
        q = other[b]
        p_out = one_out[b]
        q_out = other_out[b]
        for j in range(BLOCK):
            x = d[j]
            y = d[BLOCK + j]
            z = d[2 * BLOCK + j]
            u = p[j] - q[j]
            v = p[BLOCK + j] - q[BLOCK + j]
            s = p[2 * BLOCK + j] - q[2 * BLOCK + j]
            along = (w[j] - rest[j]) * (x * u + y * v + z * s)
            u = along * x + rest[j] * u
            v = along * y + rest[j] * v
            s = along * z + rest[j] * s
            p_out[j] += u
            p_out[BLOCK + j] += v
            p_out[2 * BLOCK + j] += s
            q_out[j] -= u
            q_out[BLOCK + j] -= v
            q_out[2 * BLOCK + j] -= s


@subroutine
def _advance(factor, tiles, vectors, out):
    """Add a multiple of vectors of the keypoints of some tiles."""
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0:
                _combine(factor, vectors[k], 1.0, out[k])


@subroutine
def _accept(tiles, vectors):
    """Accept the separate solutions of some tiles as steps, except where they are undefined."""
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0 and _inner(vectors.residual[k], vectors.preconditioned[k]) > 0.0:
                _combine(1.0, vectors.preconditioned[k], 0.0, vectors.steps[k])


@vectorized
def _precondition(factor, tiles, vectors):
    """Solve the paths of some tiles separately; return the squared norm of the preconditioned residual."""
    total = 0.0
    tile = vectors.tile
    frames = tile.shape[0] - 2 * REACH
    for t in range(tiles.shape[0]):
        gather_vector(vectors.residual, tiles[t], frames, tile)
        solve_tile(factor[t], tile)
        scatter_vector(tile, tiles[t], frames, vectors.preconditioned)
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0:
                total += _inner(vectors.residual[k], vectors.preconditioned[k])
    return total


@vectorized
def _multiply(bones, terms, tiles, group_bones, direction_weight, vectors):
    """Update the search direction of a group and its products; return its squared norm.

    The paths' matrices times the preconditioned residual is the residual, so the product with the search direction
    follows from the previous one without the matrices.
    """
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0:
                _combine(1.0, vectors.preconditioned[k], direction_weight, vectors.direction[k])
                _combine(1.0, vectors.residual[k], direction_weight, vectors.of_band[k])
                _subtract_information(
                    terms.information[k], vectors.direction[k], vectors.of_band[k], vectors.product[k]
                )
    for n in range(group_bones.shape[0]):
        b = group_bones[n]
        one = bones[b, 0]
        other = bones[b, 1]
        _couple(
            terms.directions[b],
            terms.stiffness[b],
            terms.across[b],
            vectors.direction[one],
            vectors.direction[other],
            vectors.product[one],
            vectors.product[other],
        )
    total = 0.0
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0:
                total += _inner(vectors.direction[k], vectors.product[k])
    return total


@kernel
def solve_with_bones(factor, groups, bones, terms, stopping, vectors):
    """Solve jointly for the paths of each group that bones connect.

    The method is that of Hestenes & Stiefel 1952. The preconditioner solves every path separately, with the bone
    information on its diagonal. Its norm is the squared step in standard deviations of the paths.

    Args:
        factor: factors of the matrices of all paths: views, smoothness, and the bone information; from
            :func:`posefuse.kernels.trajectory.band.factor_paths`.
        groups: Groups.
        bones: shape (bone, 2), int64: keypoints.
        terms: BoneTerms.
        stopping: Stopping.
        vectors: Vectors of the right-hand side; the steps are written.

    Returns:
        Largest number of iterations of a group.
    """
    tiles, all_bones, ends = groups
    frames = factor.shape[1] - 2 * REACH
    most = 0
    first = first_bone = 0
    for group in range(ends.shape[0]):
        own = tiles[first : ends[group, 0]]
        own_factor = factor[first : ends[group, 0]]
        group_bones = all_bones[first_bone : ends[group, 1]]
        first = ends[group, 0]
        first_bone = ends[group, 1]
        if group_bones.shape[0] == 0:
            # The solutions of the paths' matrices are those of the system.
            _precondition(own_factor, own, vectors)
            _accept(own, vectors)
            most = max(most, 1)
            continue
        n_keypoints = 0
        for t in range(own.shape[0]):
            for j in range(LANES):
                n_keypoints += 1 if own[t, j] >= 0 else 0
        negligible = stopping.negligible * stopping.negligible * 3.0 * n_keypoints * frames
        norm = previous = limit = 0.0
        for iteration in range(stopping.max_iterations + 1):
            previous, norm = norm, _precondition(own_factor, own, vectors)
            if iteration == 0:
                limit = max(stopping.tolerance * stopping.tolerance * norm, negligible)
            if iteration == stopping.max_iterations or (iteration > 0 and not norm > limit) or not norm > 0.0:
                break
            most = max(most, iteration + 1)
            squared = _multiply(bones, terms, own, group_bones, norm / previous if iteration > 0 else 0.0, vectors)
            _advance(norm / squared, own, vectors.direction, vectors.steps)
            _advance(-norm / squared, own, vectors.product, vectors.residual)
    return most
