"""Points of some frames, triangulated from all views at given poses and clocks."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.joint.noise_law import STUDENT_T_DOF
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.recording import JointRecording
from posefuse.kernels.calibration.joint import linear_points, refine_points

_POINT_STEPS = 3


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Hold observations of all views at the same times, and the points that fit them best.

    Attributes:
        xy: shape (frame, column, view, 2): x/z and y/z, NaN where missing.
        sigma: shape (frame, column, view): noise in that plane, 0 where missing.
        points_m: shape (frame, column, 3), NaN where unknown.
        cameras: rotations, shape (view, 3, 3), and centers, shape (view, 3).
    """

    xy: np.ndarray
    sigma: np.ndarray
    points_m: np.ndarray
    cameras: tuple[np.ndarray, np.ndarray]

    def scores(self) -> np.ndarray:
        """Return residuals times weights, shape (frame, column, view * 2), NaN where a view observes no point."""
        out = np.empty(self.xy.shape)
        for v, (rotation, center) in enumerate(zip(*self.cameras, strict=True)):
            local = (self.points_m - center) @ rotation.T
            with np.errstate(divide="ignore", invalid="ignore"):
                out[:, :, v] = (self.xy[:, :, v] - local[..., :2] / local[..., 2:]) / self.sigma[:, :, v, None]
        return (out * student_t_weights(out)[..., None]).reshape(*out.shape[:2], -1)


def student_t_weights(residual: np.ndarray) -> np.ndarray:
    """Return the Student-t weights of residuals in units of the noise, of the shape without the last axis."""
    return (STUDENT_T_DOF + 2.0) / (STUDENT_T_DOF + np.einsum("...k,...k->...", residual, residual))


def triangulate(
    recording: JointRecording,
    frames: np.ndarray,
    time_s: np.ndarray,
    parameters: JointParameters,
    scale: np.ndarray,
    start_m: np.ndarray | None = None,
) -> Triangulated:
    """Triangulate the points of some frames.

    Args:
        recording: the keypoints.
        frames: shape (frame,): indices of frames, ascending.
        time_s: shape (frame,): their times since the moment at which the offsets hold.
        parameters: poses and clocks.
        scale: shape (view,): noise of each view as a multiple of the expected noise.
        start_m: shape (frame, column, 3): starting points; by default the linear solution.
    """
    xy, sigma = recording.at(frames, parameters.offset_s + time_s[:, None] * parameters.drift)
    shape, n_views = xy.shape[:2], recording.n_views
    xy, sigma = parameters.without_lens(xy, sigma)
    sigma = np.where(np.isfinite(sigma), sigma * scale, 0.0)
    points = np.full((*shape, 3), np.nan) if start_m is None else start_m.copy()
    cameras = np.ascontiguousarray(parameters.rotation), np.ascontiguousarray(parameters.center_m)
    flat = xy.reshape(-1, n_views, 2), sigma.reshape(-1, n_views), points.reshape(-1, 3)
    linear_points(flat[0], *cameras, flat[2])
    refine_points(flat[0], flat[1], *cameras, STUDENT_T_DOF, _POINT_STEPS, flat[2])
    return Triangulated(xy, sigma, points, cameras)
