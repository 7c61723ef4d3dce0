"""Likelihoods of labels from leave-one-out residuals with heavy-tailed errors."""

import math
from typing import Any, NamedTuple

from posefuse.kernels.jit import inline, kernel

_MAX_SHARE = 0.99
"""Bound on a view's share in a point: at 1 the view alone determines it and carries no information."""

_MIN_DETERMINANT = 1e-9


class LabeledRows(NamedTuple):
    """Observations of one label, linearized at points.

    Attributes:
        residuals: shape (point, view, 2): in px, NaN where undefined.
        jacobians: shape (point, view, 2, 3): px per m, NaN where undefined.
        sigma: shape (point, view): standard deviations, in px.
    """

    residuals: Any
    jacobians: Any
    sigma: Any


@inline
def _spread(j, c):
    """Return the covariance of a projected point: xx, xy, yy; ``c`` has the rows xx, xy, xz, yy, yz, zz."""
    a0 = j[0, 0] * c[0] + j[0, 1] * c[1] + j[0, 2] * c[2]
    a1 = j[0, 0] * c[1] + j[0, 1] * c[3] + j[0, 2] * c[4]
    a2 = j[0, 0] * c[2] + j[0, 1] * c[4] + j[0, 2] * c[5]
    b0 = j[1, 0] * c[0] + j[1, 1] * c[1] + j[1, 2] * c[2]
    b1 = j[1, 0] * c[1] + j[1, 1] * c[3] + j[1, 2] * c[4]
    b2 = j[1, 0] * c[2] + j[1, 1] * c[4] + j[1, 2] * c[5]
    return (
        a0 * j[0, 0] + a1 * j[0, 1] + a2 * j[0, 2],
        a0 * j[1, 0] + a1 * j[1, 1] + a2 * j[1, 2],
        b0 * j[1, 0] + b1 * j[1, 1] + b2 * j[1, 2],
    )


@inline
def _inverse(xx, xy, yy):
    """Return the inverse of a symmetric matrix; large values if singular."""
    determinant = max(xx * yy - xy * xy, _MIN_DETERMINANT)
    return yy / determinant, -xy / determinant, xx / determinant


@inline
def _gain(xx, xy, yy, variance):
    """Return the inverse of what a residual retains of an error, for the covariance of its projected point."""
    xx, xy, yy = xx / variance, xy / variance, yy / variance
    largest = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
    bound = min(1.0, _MAX_SHARE / max(largest, 1e-12))
    return _inverse(1.0 - bound * xx, -bound * xy, 1.0 - bound * yy)


@kernel
def add_label_likelihoods(rows, rests_on, covariance, dof, total):
    """Add twice the log-likelihoods of a point's own label and of the other one to those of each view.

    Args:
        rows: LabeledRows of the point's own label and of the other one.
        rests_on: shape (point, view): 0 or 1 where the point rests on the observation of its own label or the other
            one, -1 where it rests on neither.
        covariance: shape (point, 6): of the points.
        dof: degrees of freedom of the Student-t distribution of the errors.
        total: shape (2, point, view), in and out; nothing is added for missing observations.
    """
    for p in range(rests_on.shape[0]):
        c = covariance[p]
        for v in range(rests_on.shape[1]):
            xx, xy, yy = _spread(rows[0].jacobians[p, v], c)
            if xx != xx:
                xx, xy, yy = _spread(rows[1].jacobians[p, v], c)
            dx = dy = 0.0
            sigma = rows[0].sigma[p, v]
            variance = sigma * sigma
            if rests_on[p, v] < 0:
                xx, xy, yy = _inverse(xx + variance, xy, yy + variance)
            else:
                # A single branch for both labels, whose records have one type.
                own = rests_on[p, v] == 0
                sigma = sigma if own else rows[1].sigma[p, v]
                u = rows[0].residuals[p, v, 0] if own else rows[1].residuals[p, v, 0]
                w = rows[0].residuals[p, v, 1] if own else rows[1].residuals[p, v, 1]
                variance = sigma * sigma
                xx, xy, yy = _gain(xx, xy, yy, variance)
                dx, dy = (xx - 1.0) * u + xy * w, xy * u + (yy - 1.0) * w
                xx, xy, yy = _inverse(variance * xx, variance * xy, variance * yy)
            for which in range(2):
                x = dx + (rows[0].residuals[p, v, 0] if which == 0 else rows[1].residuals[p, v, 0])
                y = dy + (rows[0].residuals[p, v, 1] if which == 0 else rows[1].residuals[p, v, 1])
                squared = x * x * xx + 2.0 * x * y * xy + y * y * yy
                cost = -(dof + 2.0) * math.log1p(squared / dof)
                if math.isfinite(cost):
                    total[which, p, v] += cost
