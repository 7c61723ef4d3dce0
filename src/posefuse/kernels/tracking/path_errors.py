"""Innovations of detection errors that are correlated from frame to frame.

An innovation is the error of a keypoint in a view minus what the error in the frame before predicts, in units of its
standard deviation: ``own * error - before * previous error``. Innovations are independent.
"""

import math
from typing import Any, NamedTuple

from posefuse.kernels.jit import kernel


class Innovations(NamedTuple):
    """Factors of the errors in the innovations.

    Attributes:
        own: shape (frame, view, keypoint): factor of the error of each frame, 1/px; 0 without a detection.
        before: shape (frame, view, keypoint): factor of the error of the frame before, 1/px; 0 if it does not enter.
    """

    own: Any
    before: Any


@kernel
def weigh_errors(linear, correlation, out):
    """Write the innovations for estimates of poses.

    An error far beyond the usual ones belongs to a frame of its own; a correlation with it would shift the others. So
    outliers are hardly correlated: the correlation is multiplied by the fourth root of the ratio of the square roots of
    the weights.

    Args:
        linear: LinearObservations.
        correlation: shape (frame,): of the errors of each frame and the frame before.
        out: Innovations, written.
    """
    frames, views, keypoints = linear.precision.shape
    for t in range(frames):
        for v in range(views):
            for k in range(keypoints):
                own, link = linear.precision[t, v, k], 0.0
                last = linear.precision[t - 1, v, k] if t > 0 else 0.0
                if own > 0.0 and last > 0.0:
                    ratio = linear.weight[t, v, k] / linear.weight[t - 1, v, k]
                    link = correlation[t] * math.sqrt(math.sqrt(min(ratio, 1.0 / ratio)))
                scale = 1.0 / math.sqrt(1.0 - link * link)
                out.own[t, v, k] = scale * own
                out.before[t, v, k] = scale * link * last


@kernel
def weigh_lasting_errors(linear, correlation, inflation, out):
    """Write the innovations for uncertainties of poses.

    A miss interrupts an error but does not end it: for poses that change slowly, the next detection is no independent
    measurement. Without a detection in the frame before, an error with the correlation r to the last one has the
    (1 - r) / (1 + r)-fold information, as for constant poses. Consecutive detections have the harmonic mean of their
    precisions: an outlier and those beside it then do not measure each other's errors.

    Args:
        linear: LinearObservations.
        correlation: shape (frame,): of the errors of each frame and the frame before.
        inflation: variance of the errors over that of the weighted ones.
        out: Innovations, written.
    """
    frames, views, keypoints = linear.precision.shape
    scale = 1.0 / math.sqrt(inflation)
    for v in range(views):
        for k in range(keypoints):
            r = 0.0
            for t in range(frames):
                r *= correlation[t]
                own = linear.precision[t, v, k]
                last = linear.precision[t - 1, v, k] if t > 0 else 0.0
                out.own[t, v, k] = 0.0
                out.before[t, v, k] = 0.0
                if own > 0.0:
                    if last > 0.0:
                        r = correlation[t]
                        mean = 2.0 * own * last / (own + last)
                        out.own[t, v, k] = scale * mean / math.sqrt(1.0 - r * r)
                        out.before[t, v, k] = r * out.own[t, v, k]
                    else:
                        out.own[t, v, k] = scale * own * math.sqrt((1.0 - r) / (1.0 + r))
                    r = 1.0
