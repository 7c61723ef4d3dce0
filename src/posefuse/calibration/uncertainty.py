"""Estimate the covariance of refined cameras from the variation between parts of the recording.

Errors of neighboring frames are correlated, and so may be all errors of one keypoint. The covariance is a sandwich
(Huber 1967): between inverses of the curvature stands the covariance of scores summed over periods of time and over
keypoints, each a cluster (two-way cluster-robust: Cameron, Gelbach and Miller 2011). It does not depend on the assumed
noise.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.adjust import Adjustment
from posefuse.calibration.gauge import Gauge
from posefuse.calibration.normal_equations import NormalEquations
from posefuse.calibration.parameters import FreeParameters
from posefuse.calibration.point_observations import PointObservations

MAX_PERIODS = 30
_MIN_CLUSTERS = 5
_RANK_TOLERANCE = 1e-11


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Hold the covariance of the camera parameters.

    Attributes:
        covariance: shape (view * 9, view * 9), zero for parameters that are not free.
        undetermined: shape (view * 9,): direction that the data do not determine, or None.
    """

    covariance: np.ndarray
    undetermined: np.ndarray | None

    def block(self, view: int) -> np.ndarray:
        """Return the covariance of one camera's parameters, shape (9, 9)."""
        at = slice(view * 9, view * 9 + 9)
        return self.covariance[at, at]


def estimate_uncertainty(
    adjustment: Adjustment, observations: PointObservations, free: FreeParameters, gauge: Gauge
) -> Uncertainty:
    """Estimate the covariance of the camera parameters in a chosen world.

    Args:
        adjustment: result of the adjustment, in that world.
        observations: its observations.
        free: its free parameters.
        gauge: the world.
    """
    columns, rows = free.columns, adjustment.rows
    size = free.free.size
    if not len(columns):
        return Uncertainty(np.zeros((size, size)), None)
    normal = NormalEquations.of(rows, observations, len(adjustment.rig), rows.curvature)
    reduced = normal.reduced(columns)
    # Scale radians, meters and relative focal lengths to comparable units.
    unit = 1.0 / np.sqrt(np.maximum(np.diag(reduced.matrix), 1e-300))
    allowed = _orthogonal(gauge.constraint[columns] * unit[:, None])
    values, vectors = np.linalg.eigh(allowed.T @ (reduced.matrix * unit * unit[:, None]) @ allowed)
    undetermined = None
    if values[0] < _RANK_TOLERANCE * values[-1]:
        undetermined = np.zeros(size)
        undetermined[columns] = allowed @ vectors[:, 0]
    inverse = (vectors / np.maximum(values, _RANK_TOLERANCE * values[-1])) @ vectors.T
    allowed = allowed * unit[:, None]
    spread = allowed @ inverse @ allowed.T
    covariance = np.zeros((size, size))
    covariance[np.ix_(columns, columns)] = (
        spread @ _score_covariance(normal.scores(columns, reduced), observations) @ spread
    )
    return Uncertainty(covariance, undetermined)


def _orthogonal(constraint: np.ndarray) -> np.ndarray:
    """Return a basis of the orthogonal complement of the columns."""
    n, k = constraint.shape
    if k == 0:
        return np.eye(n)
    left, values, _ = np.linalg.svd(constraint, full_matrices=True)
    rank = int((values > 1e-9 * values[0]).sum())
    return left[:, rank:]


def _score_covariance(scores: np.ndarray, observations: PointObservations) -> np.ndarray:
    """Return the covariance of the sum of the scores, clustered by period of time and by keypoint."""
    span = int(observations.frame.max()) + 1
    period = observations.frame * min(MAX_PERIODS, span) // span
    of_time = cluster_covariance(scores, period)
    of_keypoints = cluster_covariance(scores, observations.keypoint)
    if of_keypoints is None or of_time is None:
        return of_time if of_time is not None else _square(scores)
    both = cluster_covariance(scores, period * (int(observations.keypoint.max()) + 1) + observations.keypoint)
    assert both is not None
    # Keypoints add their common errors over the recording, unless these are smaller than expected by chance.
    values, vectors = np.linalg.eigh(_symmetric(of_keypoints - both))
    return of_time + (vectors * np.maximum(values, 0.0)) @ vectors.T


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    """Return the symmetric part of a matrix."""
    return 0.5 * (matrix + matrix.T)


def _square(scores: np.ndarray) -> np.ndarray:
    """Return the sum of outer products of the rows."""
    return scores.T @ scores


def cluster_covariance(scores: np.ndarray, cluster: np.ndarray) -> np.ndarray | None:
    """Return the covariance of the sum from sums over clusters; None if there are too few clusters."""
    _, index = np.unique(cluster, return_inverse=True)
    count = int(index.max()) + 1
    if count < _MIN_CLUSTERS:
        return None
    sums = np.zeros((count, scores.shape[1]))
    np.add.at(sums, index, scores)
    return _square(sums) * count / (count - 1)
