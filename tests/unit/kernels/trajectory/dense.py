"""Dense matrices of paths within the band, and their conversion to the layout of the kernels."""

import numpy as np

from posefuse.kernels.trajectory.band import FACTOR_ROWS, LANES, REACH, factor_paths
from posefuse.kernels.trajectory.blocks import to_blocks

UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])


def random_path(rng: np.random.Generator, frames: int, strength: float = 1e3) -> np.ndarray:
    """Return a matrix of frames with one view each, coupled by third differences that are this many times as strong."""
    rows = np.zeros((max(frames - REACH, 0), frames))
    for row in range(len(rows)):
        rows[row, row : row + 4] = (-1.0, 3.0, -3.0, 1.0)
    dense = strength * np.kron(rows.T @ rows, np.eye(3)) + 1e-6 * np.eye(3 * frames)
    for f in range(frames):
        view = rng.standard_normal((2, 3))
        dense[3 * f : 3 * f + 3, 3 * f : 3 * f + 3] += view.T @ view
    return dense


def block_of(dense: np.ndarray, f: int, m: int) -> np.ndarray:
    """Return the block that couples a frame with an earlier one."""
    return dense[3 * f : 3 * f + 3, 3 * (f - m) : 3 * (f - m) + 3]


def system_of(paths: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the diagonal and the coupling of dense matrices."""
    frames = len(paths[0]) // 3
    diagonal = np.array([[block_of(each, f, 0)[UPPER] for f in range(frames)] for each in paths])
    coupling = np.array(
        [[[block_of(each, f, m)[0, 0] if m <= f else 0.0 for m in (1, 2, 3)] for f in range(frames)] for each in paths]
    )
    return to_blocks(diagonal), to_blocks(coupling)


def tiles_of(order: list[int]) -> np.ndarray:
    """Return the tiles of one group of keypoints."""
    padded = np.full(-(-len(order) // LANES) * LANES, -1)
    padded[: len(order)] = order
    return padded.reshape(-1, LANES)


def factor_of(diagonal: np.ndarray, coupling: np.ndarray, tiles: np.ndarray, frames: int) -> np.ndarray:
    """Return the factors of a system."""
    factor = np.empty((len(tiles), frames + 2 * REACH, FACTOR_ROWS * LANES))
    factor_paths(diagonal, coupling, tiles, factor)
    return factor
