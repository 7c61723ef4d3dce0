"""Steps of the paths in a round, and the factors of their covariances.

Arrays in blocks are described in :mod:`posefuse.kernels.trajectory.blocks`.
"""

import math

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import inline, kernel


@kernel
def take_steps(paths, steps, longest, moved):
    """Move paths by steps no longer than the linear range: a diverging point would corrupt the following rounds.

    Args:
        paths: shape (keypoint, frame, 3).
        steps: shape (keypoint, block, 3 * BLOCK).
        longest: maximum length of a step; may be inf.
        moved: shape (keypoint, frame, 3), written.
    """
    for k in range(paths.shape[0]):
        for f in range(paths.shape[1]):
            own = steps[k, f // BLOCK]
            j = f % BLOCK
            x = own[j]
            y = own[BLOCK + j]
            z = own[2 * BLOCK + j]
            share = min(1.0, longest / max(math.sqrt(x * x + y * y + z * z), 1e-300))
            moved[k, f, 0] = paths[k, f, 0] + x * share
            moved[k, f, 1] = paths[k, f, 1] + y * share
            moved[k, f, 2] = paths[k, f, 2] + z * share


@kernel
def frame_leverages(covariance, information, leverage):
    """Compute the covariance of paths relative to that of the points of single frames, a third of the trace of both.

    Args:
        covariance: shape (keypoint, frame, 3, 3), of the paths.
        information: shape (keypoint, block, 6 * BLOCK), of the frames.
        leverage: shape (keypoint, frame), written.
    """
    for k in range(covariance.shape[0]):
        for f in range(covariance.shape[1]):
            p = covariance[k, f]
            own = information[k, f // BLOCK]
            j = f % BLOCK
            diagonal = p[0, 0] * own[j] + p[1, 1] * own[3 * BLOCK + j] + p[2, 2] * own[5 * BLOCK + j]
            mixed = p[0, 1] * own[BLOCK + j] + p[0, 2] * own[2 * BLOCK + j] + p[1, 2] * own[4 * BLOCK + j]
            leverage[k, f] = (diagonal + 2.0 * mixed) / 3.0


@inline
def _between(table, n, share):
    """Interpolate linearly between entry ``n`` of a table and the next."""
    return table[n] + share * (table[n + 1] - table[n])


@kernel
def limited_factors(shares, grid, single, log_gain, leverage, factor):
    """Compute the factors of covariances, see :class:`posefuse.trajectory.error_spectrum.ErrorSpectrum`.

    Args:
        shares: shape (3, n): assumed variance of a path relative to that of a frame, and what errors and motion
            contribute to the actual one, relative to it.
        grid: shape (n,), evenly spaced: logarithms of the gain for which they are given.
        single: shape (keypoint,): variance of the actual errors relative to the assumed one.
        log_gain: shape (keypoint, frame).
        leverage: shape (keypoint, frame).
        factor: shape (keypoint, frame), written.
    """
    last = grid.shape[0] - 1
    per_unit = last / (grid[last] - grid[0])
    for k in range(factor.shape[0]):
        for f in range(factor.shape[1]):
            place = (min(max(log_gain[k, f], grid[0]), grid[last]) - grid[0]) * per_unit
            n = min(int(place), last - 1)
            share = place - n
            motion = _between(shares[2], n, share)
            usual = single[k] * _between(shares[1], n, share) + motion
            # Errors of a mean are no larger than those of its frames, and paths lose as much motion as usual.
            limit = (single[k] + motion * _between(shares[0], n, share)) / max(leverage[k, f], 1e-9)
            factor[k, f] = usual if usual <= limit else limit
