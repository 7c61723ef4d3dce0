"""Predict left-out views: whether the points of the other views fit a view better at its corrected times."""

from dataclasses import replace

import numpy as np

from posefuse.calibration.joint.noise_law import STUDENT_T_DOF
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.triangulated import triangulate
from posefuse.calibration.joint.velocities import support_frames

_MIN_PREDICTED = 30


def gain_by_offsets(
    recording: JointRecording,
    frames: np.ndarray,
    parameters: JointParameters,
    scale: np.ndarray,
    offset_s: np.ndarray,
) -> np.ndarray:
    """Return by how much the time offset of each view reduces the loss of its prediction, shape (view,).

    Each view is predicted by the points of the others. The points are moved along their velocities, and the view's own
    keypoints stay the same: between frames, their errors would average out, which looks like a gain.

    Args:
        recording: the keypoints.
        frames: shape (sample,): frames to predict, ascending; others than those that the parameters were estimated
            from.
        parameters: poses and clocks, with the offsets of all views corrected.
        scale: shape (view,): noise of each view as a multiple of the expected noise.
        offset_s: shape (view,): the part of the time offset in question.

    Returns:
        Decrease of the mean Student-t loss; NaN where the other views predict too little.
    """
    out = np.full(recording.n_views, np.nan)
    support, moments_s = support_frames(recording, frames), recording.moments_s
    time_s = moments_s[support.frames] - 0.5 * (moments_s[frames[0]] + moments_s[frames[-1]])
    for view in range(recording.n_views):
        others = np.arange(recording.n_views) != view
        hidden = replace(recording, xy=np.where(others[:, None, None], recording.xy, np.nan))
        points = triangulate(hidden, support.frames, time_s, parameters, scale).points_m
        velocity = support.slopes(points, time_s)
        points = points[support.center]
        uncorrected = parameters.offset_s - np.where(others, 0.0, offset_s)
        shift_s = uncorrected + time_s[support.center, None] * parameters.drift
        xy, sigma = recording.at(frames, shift_s)
        xy, sigma = parameters.without_lens(xy, sigma)
        camera = parameters.rotation[view], parameters.center_m[view]
        before, after = (
            _loss(xy[:, :, view], scale[view] * sigma[:, :, view], *camera, points + late_s * velocity)
            for late_s in (0.0, float(offset_s[view]))
        )
        known = np.isfinite(before) & np.isfinite(after) & velocity.any(axis=-1)
        if known.sum() >= _MIN_PREDICTED:
            out[view] = float((before - after)[known].mean())
    return out


def _loss(
    xy: np.ndarray, sigma: np.ndarray, rotation: np.ndarray, center_m: np.ndarray, points_m: np.ndarray
) -> np.ndarray:
    """Return the Student-t loss of predicted keypoints, shape (sample, column), NaN where one is missing."""
    local = (points_m - center_m) @ rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        residual = (xy - local[..., :2] / local[..., 2:]) / sigma[..., None]
    return np.log1p(np.square(residual).sum(axis=-1) / STUDENT_T_DOF)
