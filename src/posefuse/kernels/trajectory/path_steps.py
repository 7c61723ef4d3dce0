"""Steps of the paths after a solve of the trajectory system."""

import math

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import kernel


@kernel
def move_paths(paths, steps, max_step, moved):
    """Take steps of limited length, because a point that diverges would corrupt the following rounds.

    Args:
        paths: shape (keypoint, frame, 3).
        steps: shape (keypoint, block, 3 * BLOCK): see :mod:`posefuse.kernels.trajectory.blocks`.
        max_step: largest length.
        moved: shape (keypoint, frame, 3), written.
    """
    for k in range(paths.shape[0]):
        for f in range(paths.shape[1]):
            own = steps[k, f // BLOCK]
            j = f % BLOCK
            x = own[j]
            y = own[BLOCK + j]
            z = own[2 * BLOCK + j]
            scale = min(1.0, max_step / max(math.sqrt(x * x + y * y + z * z), 1e-300))
            moved[k, f, 0] = paths[k, f, 0] + scale * x
            moved[k, f, 1] = paths[k, f, 1] + scale * y
            moved[k, f, 2] = paths[k, f, 2] + scale * z


@kernel
def compute_leverage(covariance, information, leverage):
    """Compute a third of the trace of covariance times information: the share of a frame in its point.

    Args:
        covariance: shape (keypoint, frame, 3, 3).
        information: shape (keypoint, block, 6 * BLOCK): see :mod:`posefuse.kernels.trajectory.blocks`.
        leverage: shape (keypoint, frame), written.
    """
    for k in range(leverage.shape[0]):
        for f in range(leverage.shape[1]):
            own = information[k, f // BLOCK]
            j = f % BLOCK
            total = covariance[k, f, 0, 0] * own[j]
            total += covariance[k, f, 1, 1] * own[3 * BLOCK + j] + covariance[k, f, 2, 2] * own[5 * BLOCK + j]
            mixed = covariance[k, f, 0, 1] * own[BLOCK + j] + covariance[k, f, 0, 2] * own[2 * BLOCK + j]
            leverage[k, f] = (total + 2.0 * (mixed + covariance[k, f, 1, 2] * own[4 * BLOCK + j])) / 3.0
