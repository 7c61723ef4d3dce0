"""How well refined cameras are known, from how differently parts of the recording would have moved them.

Errors of neighbouring frames are alike, and so may be all errors of one keypoint. The covariance is therefore that of
scores summed over stretches of time and over keypoints, each taken as one draw (cluster-robust, in two ways: Cameron,
Gelbach & Miller 2011), between inverses of the curvature (Huber 1967): nothing is assumed of the size of the noise.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.adjust import Adjusted
from posefuse.calibration.gauge import Gauge
from posefuse.calibration.normal import Normal
from posefuse.calibration.parameters import Freedom
from posefuse.calibration.sightings import Sightings

STRETCHES = 30
_FEWEST = 5
_RANK = 1e-11


@dataclass(frozen=True, eq=False)
class Certainty:
    """How well the cameras' numbers are known.

    Attributes:
        covariance: shape (view * 9, view * 9), zero for what is not free.
        undetermined: shape (view * 9,): the direction nothing in the data determines, or None where all is determined.
    """

    covariance: np.ndarray
    undetermined: np.ndarray | None

    def block(self, view: int) -> np.ndarray:
        """Shape (9, 9): the covariance of one camera's numbers."""
        at = slice(view * 9, view * 9 + 9)
        return self.covariance[at, at]


def certainty(adjusted: Adjusted, sightings: Sightings, freedom: Freedom, gauge: Gauge) -> Certainty:
    """The covariance of the cameras' numbers in a chosen world.

    Args:
        adjusted: where the adjustment came to, in that world.
        sightings: what it was made from.
        freedom: what was free to change.
        gauge: the world.
    """
    columns, rows = freedom.columns, adjusted.rows
    size = freedom.free.size
    if not len(columns):
        return Certainty(np.zeros((size, size)), None)
    normal = Normal.of(rows, sightings, len(adjusted.rig), rows.curvature)
    reduced = normal.reduced(columns)
    # Radians, metres and parts of a focal length, made alike.
    unit = 1.0 / np.sqrt(np.maximum(np.diag(reduced.matrix), 1e-300))
    allowed = _orthogonal(gauge.constraint[columns] * unit[:, None])
    values, vectors = np.linalg.eigh(allowed.T @ (reduced.matrix * unit * unit[:, None]) @ allowed)
    undetermined = None
    if values[0] < _RANK * values[-1]:
        undetermined = np.zeros(size)
        undetermined[columns] = allowed @ vectors[:, 0]
    inverse = (vectors / np.maximum(values, _RANK * values[-1])) @ vectors.T
    allowed = allowed * unit[:, None]
    spread = allowed @ inverse @ allowed.T
    covariance = np.zeros((size, size))
    covariance[np.ix_(columns, columns)] = spread @ _meat(normal.scores(columns, reduced), sightings) @ spread
    return Certainty(covariance, undetermined)


def _orthogonal(constraint: np.ndarray) -> np.ndarray:
    """A basis of what is orthogonal to the columns."""
    n, k = constraint.shape
    if k == 0:
        return np.eye(n)
    left, values, _ = np.linalg.svd(constraint, full_matrices=True)
    rank = int((values > 1e-9 * values[0]).sum())
    return left[:, rank:]


def _meat(scores: np.ndarray, sightings: Sightings) -> np.ndarray:
    """The covariance of the sum of the scores, errors of one stretch of time or of one keypoint being one draw."""
    span = int(sightings.frame.max()) + 1
    stretch = sightings.frame * min(STRETCHES, span) // span
    of_time = _summed(scores, stretch)
    of_keypoints = _summed(scores, sightings.keypoint)
    if of_keypoints is None or of_time is None:
        return of_time if of_time is not None else _square(scores)
    both = _summed(scores, stretch * (int(sightings.keypoint.max()) + 1) + sightings.keypoint)
    assert both is not None
    # A keypoint adds what its errors have in common over the recording; where that is less than chance it adds none.
    values, vectors = np.linalg.eigh(_symmetric(of_keypoints - both))
    return of_time + (vectors * np.maximum(values, 0.0)) @ vectors.T


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)


def _square(scores: np.ndarray) -> np.ndarray:
    return scores.T @ scores


def _summed(scores: np.ndarray, cluster: np.ndarray) -> np.ndarray | None:
    """Squares of the sums over clusters; None where there are too few of them to tell."""
    _, index = np.unique(cluster, return_inverse=True)
    count = int(index.max()) + 1
    if count < _FEWEST:
        return None
    sums = np.zeros((count, scores.shape[1]))
    np.add.at(sums, index, scores)
    return _square(sums) * count / (count - 1)
