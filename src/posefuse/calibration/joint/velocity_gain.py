"""Ratio of true velocities to measured ones."""

import numpy as np

from posefuse.calibration.joint.equations import Rows
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.triangulated import triangulate
from posefuse.calibration.joint.velocities import support_frames

_MAX_PHASE = 1.2


def velocity_gain(recording: JointRecording, rows: Rows, parameters: JointParameters) -> float:
    """Return the factor by which true velocities exceed the measured ones, at least 1.

    The slope of a clock's score is a product of the measured and the true velocity. With a difference of reach r, a
    movement of frequency f has ``sin(x) / x`` of its velocity, x = 2 pi f r. With a reach of 2 r, it has ``cos(x)``
    times that, so the ratio of both velocities shows the loss. Errors are subtracted from both.

    Args:
        recording: the keypoints.
        rows: residuals and derivatives at the estimate.
        parameters: the estimate.
    """
    if rows.velocity_noise == 0.0:
        return 1.0
    moments_s = recording.moments_s
    origin_s = 0.5 * (moments_s[rows.frames[0]] + moments_s[rows.frames[-1]])
    velocities, slopes = [], []
    for spans in (1, 2):
        support = support_frames(recording, rows.frames, spans)
        time_s = moments_s[support.frames] - origin_s
        observed = triangulate(recording, support.frames, time_s, parameters, rows.scale)
        velocities.append(support.slopes(observed.points_m, time_s).reshape(-1, 3))
        slopes.append(support.slopes(observed.scores(), time_s).reshape(*rows.seen.shape, 2))
    known = velocities[0].any(axis=1) & velocities[1].any(axis=1) & (rows.seen.sum(axis=1) > 1)
    changed = known[:, None] & rows.seen & slopes[0].any(axis=-1) & slopes[1].any(axis=-1)
    if not changed.any():
        return 1.0
    short, wide = ((rows.by_point[known] @ v[known][:, None, :, None])[..., 0] for v in velocities)
    first, second = (s[changed] for s in slopes)
    noise = 3.0 * rows.velocity_noise
    own = np.square(short).sum() / known.sum() - noise
    shared = (short * wide).sum() / known.sum() - noise * (first * second).sum() / np.square(first).sum()
    x = np.arccos(np.clip(shared / max(own, 1e-12), np.cos(_MAX_PHASE), 1.0))
    return float(1.0 / np.sinc(x / np.pi))
