"""Structure of residuals over the image: the part that depends on the place, which a correct lens does not leave."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.calibration_summary import CameraSummary

COLUMNS, ROWS = 12, 8
_MIN_IMAGES = 3
"""Least number of images in a cell to judge its mean."""


@dataclass(frozen=True, eq=False)
class ResidualStructure:
    """Mean residuals of the cells of an image.

    Attributes:
        mean_px: shape (rows, columns, 2): mean residual of each cell, NaN with fewer than three images.
        systematic_px: root mean square of the mean residuals beyond their own noise, NaN without a known cell.
    """

    mean_px: np.ndarray
    systematic_px: float


def residual_structure(camera: CameraSummary, size_px: tuple[int, int]) -> ResidualStructure:
    """Return the mean residuals of a camera over its image, and their size beyond chance.

    The errors of one image are correlated, so each cell compares the means of its images.

    Args:
        camera: residuals of the camera.
        size_px: width and height of its images.
    """
    n_cells = ROWS * COLUMNS
    pairs, number = np.unique(
        np.stack([camera.cells(size_px, COLUMNS, ROWS), camera.image], axis=1), axis=0, return_inverse=True
    )
    means = np.zeros((len(pairs), 2))
    np.add.at(means, number, camera.residual_px)
    means /= np.bincount(number, minlength=len(pairs))[:, None]
    cell = pairs[:, 0]
    n = np.bincount(cell, minlength=n_cells)
    total, squares = np.zeros((n_cells, 2)), np.zeros((n_cells, 2))
    np.add.at(total, cell, means)
    mean = total / np.maximum(n, 1)[:, None]
    np.add.at(squares, cell, (means - mean[cell]) ** 2)
    known = n >= _MIN_IMAGES
    mean[~known] = np.nan
    excess = (mean**2 - squares / np.maximum(n * (n - 1), 1)[:, None]).sum(axis=1)
    systematic = float(np.sqrt(max(float(np.average(excess[known], weights=n[known])), 0.0))) if known.any() else np.nan
    return ResidualStructure(mean.reshape(ROWS, COLUMNS, 2), systematic)
