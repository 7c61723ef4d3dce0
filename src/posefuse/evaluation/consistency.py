"""Consistency of errors with covariances: NEES, NIS, coverage of the 68 and 95 % regions."""

import math
from dataclasses import dataclass

import numpy as np

REGIONS = (0.68, 0.95)


@dataclass(frozen=True)
class Consistency:
    """Statistics of normalized squared errors. NaN without errors.

    Attributes:
        dof: degrees of freedom of an error, 3 for a position: the expected mean.
        n: number of errors.
        mean: mean of the normalized squares: NEES (positions) or NIS (innovations). Above dof: overconfident.
        median: median, robust against gross errors; expected 2.37 for positions.
        covered_68: fraction inside the 68 % region.
        covered_95: fraction inside the 95 % region.
    """

    dof: int
    n: int
    mean: float
    median: float
    covered_68: float
    covered_95: float


def region(share: float, dof: int) -> float:
    """Return the squared radius of the region with a given probability under a Gaussian (chi-square quantile)."""
    from scipy.special import gammaincinv  # slow to import, and --help imports this module

    return 2.0 * float(gammaincinv(0.5 * dof, share))


def normalized_squares(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return squared errors normalized by their covariance (squared Mahalanobis distances).

    Args:
        errors: shape (..., n).
        covariances: shape (..., n, n), in the errors' unit squared.

    Returns:
        Shape (...), NaN where an error or covariance is missing, or a covariance is not positive definite.
    """
    usable = np.isfinite(errors).all(axis=-1) & np.isfinite(covariances).all(axis=(-1, -2))
    found = np.full(usable.shape, np.nan)
    matrices = covariances[usable]
    # Compare the smallest eigenvalue with the trace: an absolute limit would depend on the unit.
    size = np.trace(matrices, axis1=-2, axis2=-1)
    positive = (size > 0) & (np.linalg.eigvalsh(matrices)[..., 0] > 1e-12 * size) if len(matrices) else size > 0
    squares = np.full(len(matrices), np.nan)
    kept = errors[usable][positive]
    squares[positive] = (kept * np.linalg.solve(matrices[positive], kept[..., None])[..., 0]).sum(axis=-1)
    found[usable] = squares
    return found


def consistency(squares: np.ndarray, dof: int) -> Consistency:
    """Return the statistics of normalized squares (any shape, NaN ignored) with ``dof`` degrees of freedom."""
    flat = squares[np.isfinite(squares)]
    if not flat.size:
        return Consistency(dof, 0, math.nan, math.nan, math.nan, math.nan)
    inside = [float((flat <= region(share, dof)).mean()) for share in REGIONS]
    return Consistency(dof, int(flat.size), float(flat.mean()), float(np.median(flat)), inside[0], inside[1])


def nis(innovations: np.ndarray, covariances: np.ndarray) -> Consistency:
    """Return the consistency of a filter's innovations with their predicted covariances.

    Args:
        innovations: shape (..., n), NaN without a measurement.
        covariances: shape (..., n, n): J P J^T + R.
    """
    return consistency(normalized_squares(innovations, covariances), innovations.shape[-1])
