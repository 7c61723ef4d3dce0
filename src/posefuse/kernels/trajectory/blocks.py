"""Arrays of paths in blocks of frames, so that operations on single frames become vector instructions.

An array of values per keypoint and frame has shape (keypoint, block, row * BLOCK): value ``row`` of frame ``f`` is at
``[k, f // BLOCK, row * BLOCK + f % BLOCK]``. Frames beyond the last are padding. Symmetric 3x3 matrices have six rows:
xx, xy, xz, yy, yz, zz.
"""

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK


def n_blocks(frames: int) -> int:
    """Return the number of blocks of this many frames."""
    return -(-frames // BLOCK)


def empty_blocks(n: int, frames: int, rows: int) -> np.ndarray:
    """Return an uninitialized array for ``n`` keypoints or bones."""
    return np.empty((n, n_blocks(frames), rows * BLOCK))


def to_blocks(values: np.ndarray) -> np.ndarray:
    """Convert an array of shape (n, frame, row) to blocks; the padding is 0."""
    n, frames, rows = values.shape
    padded = np.zeros((n, n_blocks(frames) * BLOCK, rows))
    padded[:, :frames] = values
    return np.ascontiguousarray(padded.reshape(n, -1, BLOCK, rows).swapaxes(2, 3)).reshape(n, -1, rows * BLOCK)


def from_blocks(values: np.ndarray, frames: int) -> np.ndarray:
    """Convert blocks to an array of shape (n, frame, row)."""
    n, blocks, size = values.shape
    rows = size // BLOCK
    return values.reshape(n, blocks, rows, BLOCK).swapaxes(2, 3).reshape(n, blocks * BLOCK, rows)[:, :frames]


def matrices_from_blocks(values: np.ndarray, frames: int) -> np.ndarray:
    """Convert blocks of symmetric matrices to an array of shape (n, frame, 3, 3)."""
    return from_blocks(values, frames)[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
