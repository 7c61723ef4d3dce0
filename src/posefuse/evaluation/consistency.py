"""Whether errors are as large as the covariances say: NEES, NIS, coverage of the 68 and 95 % regions."""

import math
from dataclasses import dataclass

import numpy as np

REGIONS = (0.68, 0.95)


@dataclass(frozen=True)
class Consistency:
    """Normalised squared errors against what they should be. NaN where none could be formed.

    Attributes:
        dof: numbers of an error, 3 for a position: the mean that a true covariance gives.
        n: how many errors.
        mean: of the normalised squares: NEES (of positions), NIS (of innovations). Above dof: overconfident.
        median: likewise, not moved by a few gross errors; 2.37 for positions.
        covered_68: share inside the 68 % region.
        covered_95: likewise 95 %.
    """

    dof: int
    n: int
    mean: float
    median: float
    covered_68: float
    covered_95: float


def region(share: float, dof: int) -> float:
    """Squared radius of the region that holds a share of a Gaussian, in units of its covariance (chi-square)."""
    from scipy.special import gammaincinv  # slow to import, and the command line's help imports this file

    return 2.0 * float(gammaincinv(0.5 * dof, share))


def normalised_squares(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Squared errors in units of their covariance.

    Args:
        errors: shape (..., n).
        covariances: shape (..., n, n), in the errors' unit squared.

    Returns:
        Shape (...), NaN where an error is missing, or a covariance is or is not positive definite.
    """
    usable = np.isfinite(errors).all(axis=-1) & np.isfinite(covariances).all(axis=(-1, -2))
    found = np.full(usable.shape, np.nan)
    matrices = covariances[usable]
    # The smallest eigenvalue against the trace: units, and so absolute limits, are the caller's.
    size = np.trace(matrices, axis1=-2, axis2=-1)
    positive = (size > 0) & (np.linalg.eigvalsh(matrices)[..., 0] > 1e-12 * size) if len(matrices) else size > 0
    squares = np.full(len(matrices), np.nan)
    kept = errors[usable][positive]
    squares[positive] = (kept * np.linalg.solve(matrices[positive], kept[..., None])[..., 0]).sum(axis=-1)
    found[usable] = squares
    return found


def consistency(squares: np.ndarray, dof: int) -> Consistency:
    """What normalised squares (any shape, NaN left out) of errors of ``dof`` numbers say."""
    flat = squares[np.isfinite(squares)]
    if not flat.size:
        return Consistency(dof, 0, math.nan, math.nan, math.nan, math.nan)
    inside = [float((flat <= region(share, dof)).mean()) for share in REGIONS]
    return Consistency(dof, int(flat.size), float(flat.mean()), float(np.median(flat)), inside[0], inside[1])


def nis(innovations: np.ndarray, covariances: np.ndarray) -> Consistency:
    """Consistency of a filter's innovations with their predicted covariances.

    Args:
        innovations: shape (..., n), NaN where there was no measurement.
        covariances: shape (..., n, n): J P J^T + R.
    """
    return consistency(normalised_squares(innovations, covariances), innovations.shape[-1])
