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
        recent: shape (4, 6 * LANES): memory for the solution of a tile.
    """

    residual: Any
    steps: Any
    preconditioned: Any
    direction: Any
    of_band: Any
    product: Any
    tile: Any
    recent: Any

    @classmethod
    def of(cls, rhs: np.ndarray, frames: int) -> "Vectors":
        """Return the vectors for a right-hand side, which is overwritten; all others are 0."""
        steps, preconditioned, direction, of_band, product = (np.zeros(rhs.shape) for _ in range(5))
        tile = np.zeros((frames + 2 * REACH, 3 * LANES))
        return cls(rhs, steps, preconditioned, direction, of_band, product, tile, np.empty((4, 6 * LANES)))


@disjoint
def _take(vectors, out):
    """Copy the vectors of a path, shape (block, 3 * BLOCK)."""
    for b in range(vectors.shape[0]):
        for j in range(3 * BLOCK):
            out[b, j] = vectors[b, j]


@disjoint
def _add_inner(first, second, sums):
    """Add the inner products of the vectors of a block, shape (3 * BLOCK,), to those of each frame in it."""
    for j in range(BLOCK):
        sums[j] += first[j] * second[j] + first[BLOCK + j] * second[BLOCK + j]
        sums[j] += first[2 * BLOCK + j] * second[2 * BLOCK + j]


@vectorized
def _total(sums):
    """Return the sum over the frames of a block, and set their sums to 0."""
    total = 0.0
    for j in range(BLOCK):
        total += sums[j]
    for j in range(BLOCK):
        sums[j] = 0.0
    return total


@disjoint
def _turn(preconditioned, residual, information, weight, direction, of_band, product):
    """Update the search direction of a block of a path, and write its product with the matrix without bones.

    Args:
        preconditioned: shape (3 * BLOCK,), as all vectors.
        residual: likewise.
        information: shape (6 * BLOCK,).
        weight: of the previous direction.
        direction: in and out.
        of_band: in and out: product of the path's matrix and the direction.
        product: written: the same minus the product of the information and the direction.
    """
    for j in range(BLOCK):
        x = preconditioned[j] + weight * direction[j]
        y = preconditioned[BLOCK + j] + weight * direction[BLOCK + j]
        z = preconditioned[2 * BLOCK + j] + weight * direction[2 * BLOCK + j]
        direction[j] = x
        direction[BLOCK + j] = y
        direction[2 * BLOCK + j] = z
        u = residual[j] + weight * of_band[j]
        v = residual[BLOCK + j] + weight * of_band[BLOCK + j]
        w = residual[2 * BLOCK + j] + weight * of_band[2 * BLOCK + j]
        of_band[j] = u
        of_band[BLOCK + j] = v
        of_band[2 * BLOCK + j] = w
        xy = information[BLOCK + j]
        xz = information[2 * BLOCK + j]
        yz = information[4 * BLOCK + j]
        product[j] = u - (information[j] * x + xy * y + xz * z)
        product[BLOCK + j] = v - (xy * x + information[3 * BLOCK + j] * y + yz * z)
        product[2 * BLOCK + j] = w - (xz * x + yz * y + information[5 * BLOCK + j] * z)


@disjoint
def _couple(direction, stiffness, across, one, other, one_out, other_out):
    """Add the product of a block's terms of a bone, along it and across it, with the vectors of its ends."""
    for j in range(BLOCK):
        x = direction[j]
        y = direction[BLOCK + j]
        z = direction[2 * BLOCK + j]
        rest = across[j]
        u = one[j] - other[j]
        v = one[BLOCK + j] - other[BLOCK + j]
        w = one[2 * BLOCK + j] - other[2 * BLOCK + j]
        along = (stiffness[j] - rest) * (x * u + y * v + z * w)
        u = along * x + rest * u
        v = along * y + rest * v
        w = along * z + rest * w
        one_out[j] += u
        one_out[BLOCK + j] += v
        one_out[2 * BLOCK + j] += w
        other_out[j] -= u
        other_out[BLOCK + j] -= v
        other_out[2 * BLOCK + j] -= w


@disjoint
def _move(factor, direction, product, steps, residual):
    """Move along the search direction of a path, all of shape (block, 3 * BLOCK)."""
    for b in range(direction.shape[0]):
        for j in range(3 * BLOCK):
            steps[b, j] += factor * direction[b, j]
            residual[b, j] -= factor * product[b, j]


@subroutine
def _advance(factor, tiles, vectors):
    """Move along the search direction of the keypoints of some tiles."""
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0:
                _move(factor, vectors.direction[k], vectors.product[k], vectors.steps[k], vectors.residual[k])


@subroutine
def _accept(tiles, vectors, sums):
    """Accept the separate solutions of some tiles as steps, except where they are undefined."""
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0:
                for b in range(vectors.residual.shape[1]):
                    _add_inner(vectors.residual[k, b], vectors.preconditioned[k, b], sums)
                if _total(sums) > 0.0:
                    _take(vectors.preconditioned[k], vectors.steps[k])


@subroutine
def _precondition(factor, tiles, vectors):
    """Solve the paths of some tiles separately."""
    tile = vectors.tile
    frames = tile.shape[0] - 2 * REACH
    for t in range(tiles.shape[0]):
        gather_vector(vectors.residual, tiles[t], frames, tile)
        solve_tile(factor[t], tile, vectors.recent)
        scatter_vector(tile, tiles[t], frames, vectors.preconditioned)


@subroutine
def _residual_norm(tiles, vectors, sums):
    """Return the squared norm of the preconditioned residual."""
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            k = tiles[t, j]
            if k >= 0:
                for b in range(vectors.residual.shape[1]):
                    _add_inner(vectors.residual[k, b], vectors.preconditioned[k, b], sums)
    return _total(sums)


@subroutine
def _multiply(bones, terms, tiles, group_bones, direction_weight, vectors, sums):
    """Update the search direction of a group and its products; return its squared norm.

    The paths' matrices times the preconditioned residual is the residual, so the product with the search direction
    follows from the previous one without the matrices. The vectors of all keypoints in a block fit in the cache.
    """
    directions, stiffness, across, information = terms
    residual, _, preconditioned, direction, of_band, product, _, _ = vectors
    for b in range(residual.shape[1]):
        for t in range(tiles.shape[0]):
            for j in range(LANES):
                k = tiles[t, j]
                if k >= 0:
                    _turn(
                        preconditioned[k, b],
                        residual[k, b],
                        information[k, b],
                        direction_weight,
                        direction[k, b],
                        of_band[k, b],
                        product[k, b],
                    )
        for n in range(group_bones.shape[0]):
            m = group_bones[n]
            one = bones[m, 0]
            other = bones[m, 1]
            _couple(
                directions[m, b],
                stiffness[m, b],
                across[m, b],
                direction[one, b],
                direction[other, b],
                product[one, b],
                product[other, b],
            )
        for t in range(tiles.shape[0]):
            for j in range(LANES):
                k = tiles[t, j]
                if k >= 0:
                    _add_inner(direction[k, b], product[k, b], sums)
    return _total(sums)


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
    sums = np.zeros(BLOCK)
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
            _accept(own, vectors, sums)
            most = max(most, 1)
            continue
        n_keypoints = 0
        for t in range(own.shape[0]):
            for j in range(LANES):
                n_keypoints += 1 if own[t, j] >= 0 else 0
        negligible = stopping.negligible * stopping.negligible * 3.0 * n_keypoints * frames
        norm = previous = limit = 0.0
        for iteration in range(stopping.max_iterations + 1):
            _precondition(own_factor, own, vectors)
            previous, norm = norm, _residual_norm(own, vectors, sums)
            if iteration == 0:
                limit = max(stopping.tolerance * stopping.tolerance * norm, negligible)
            if iteration == stopping.max_iterations or (iteration > 0 and not norm > limit) or not norm > 0.0:
                break
            most = max(most, iteration + 1)
            squared = _multiply(
                bones, terms, own, group_bones, norm / previous if iteration > 0 else 0.0, vectors, sums
            )
            _advance(norm / squared, own, vectors)
    return most
