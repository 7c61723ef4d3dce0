"""Similar errors of keypoints that are close to each other.

Detectors place joints by what each view shows of a body, and lenses are not exactly known: errors of keypoints of one
view are similar within some 30 cm of a person. Such errors bend the shape of a body in a view, which turns and shifts
cameras more than independent errors do. Their share follows from the residuals of the recording.
"""

import numpy as np

from posefuse.calibration.joint.equations import Rows
from posefuse.calibration.joint.noise_law import SLOW_S

_REACH = 0.18
"""Distance at which the correlation of similar errors is 1 / e, relative to the longest distance of two keypoints."""
_MIN_SHARE, _MAX_SHARE = 0.03, 0.9
_MIN_LEFT = 0.1


def error_mixing(rows: Rows, people: np.ndarray) -> np.ndarray | None:
    """Return a root of the correlation of the errors of different columns, None if they are independent.

    Args:
        rows: residuals.
        people: shape (column,), int: person of each column.

    Returns:
        Shape (column, column): its product with its transpose is the correlation.
    """
    kernel = _closeness(rows.points_m, people)
    share = _share(rows, kernel)
    if share < _MIN_SHARE:
        return None
    values, vectors = np.linalg.eigh((1.0 - share) * np.eye(len(kernel)) + share * kernel)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _closeness(points_m: np.ndarray, people: np.ndarray) -> np.ndarray:
    """Return the correlation of similar errors, shape (column, column); 0 between different people."""
    out = np.eye(len(people))
    for person in np.unique(people):
        own = np.flatnonzero(people == person)
        out[np.ix_(own, own)] = similarity(points_m[:, own], _REACH)
    np.fill_diagonal(out, 1.0)
    return out


def similarity(points_m: np.ndarray, reach: float) -> np.ndarray:
    """Return how close the keypoints of a body are: 1 at one place, 0 far away; shape (keypoint, keypoint).

    Args:
        points_m: shape (sample, keypoint, 3), NaN where unknown.
        reach: distance at which the similarity is exp(-1), as a share of the longest distance in the body.
    """
    apart = np.full((points_m.shape[1], points_m.shape[1]), np.inf)
    for a in range(len(apart)):
        distances = np.linalg.norm(points_m - points_m[:, a : a + 1], axis=-1)
        known = np.isfinite(distances).any(axis=0)
        apart[a, known] = np.nanmedian(distances[:, known], axis=0)
    longest = apart[np.isfinite(apart)].max(initial=0.0)
    return np.exp(-np.square(apart / (reach * longest))) if longest > 0.0 else np.eye(len(apart))


def _share(rows: Rows, kernel: np.ndarray) -> float:
    """Return the share of the variance of errors that is similar, less its standard deviation."""
    n_samples, n_columns = rows.points_m.shape[:2]
    left = np.sqrt(np.clip(1.0 - rows.leverage(), _MIN_LEFT, 1.0))
    scores = np.where(rows.seen[..., None], rows.scores / left[..., None], 0.0)
    squared, count = np.square(scores).sum(axis=(0, 2)), 2.0 * rows.seen.sum(axis=0)
    scores /= np.sqrt(np.maximum(squared / np.maximum(count, 1.0), 1e-12))[:, None]
    streams = scores.reshape(n_samples, n_columns, -1)
    seen = np.repeat(rows.seen.reshape(n_samples, n_columns, -1), 2, axis=-1).astype(float)
    products, pairs = (np.einsum("tae,tbe->ab", x, x, optimize=True) for x in (streams, seen))
    upper = np.triu(kernel, 1)
    weight = float((upper**2 * pairs).sum())
    if weight <= 0.0:
        return 0.0
    periods = 1.0 + float(rows.time_s[-1] - rows.time_s[0]) / SLOW_S
    sd = np.sqrt(n_samples / (weight * periods))
    return float(np.clip((upper * products).sum() / weight - sd, 0.0, _MAX_SHARE))
