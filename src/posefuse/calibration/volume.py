"""Accuracy of triangulated points that follows from the covariance of the cameras: first-order propagation."""

from itertools import product

import numpy as np

from posefuse.calibration.normal_equations import residual_rows
from posefuse.model.calibration_summary import VolumeAccuracy
from posefuse.model.cameras import CameraRig

_MIN_VIEWS = 2
_STEPS = (-1.0, -0.5, 0.0, 0.5, 1.0)
_QUANTILES = (0.05, 0.95)
_POSE_AND_LENS = 18


def volume_accuracy(rig: CameraRig, covariance: np.ndarray, targets_m: np.ndarray) -> VolumeAccuracy:
    """Return the accuracy of points in the volume that the targets filled.

    A point X is triangulated from the views that see it by least squares, X(p) = argmin sum |project(X, p) - x|^2, so
    dX = -(Jx' Jx)^-1 Jx' Jp dp for a change dp of the parameters of all cameras.

    Args:
        rig: the calibrated cameras.
        covariance: shape (view, P, view, P), with at least 18 parameters of each camera: rotation about its own axes
            (rad), center (m), fx, fy, cx, cy (px), and eight distortion coefficients; 0 for fixed ones.
        targets_m: shape (..., 3): places of the target in the world, NaN where unknown.
    """
    targets = targets_m.reshape(-1, 3)
    targets = targets[np.isfinite(targets).all(axis=1)]
    n_views = len(rig)
    joint = covariance[:, :_POSE_AND_LENS, :, :_POSE_AND_LENS].reshape(n_views * _POSE_AND_LENS, -1)
    middle, ends, grid = _grid(targets)
    everything = np.concatenate([middle[None], ends, grid])
    change, views = _point_changes(rig, everything)
    seen = views >= _MIN_VIEWS
    n_other = 1 + len(ends)
    inside = seen[n_other:]
    relative = _without_rigid_motion(grid[inside], change[n_other:][inside])
    sd = _worst_sds(relative, joint)
    return VolumeAccuracy(
        middle_m=middle,
        middle_sd_m=float(_worst_sds(change[:1], joint)[0]) if seen[0] else float("nan"),
        relative_sd_m=float(np.sqrt(np.mean(sd**2))) if len(sd) else float("nan"),
        length_sd=_length_sd(everything[1:n_other], change[1:n_other], seen[1:n_other], joint),
        distance_m=_distance(rig, middle),
        points_m=grid[inside],
        sd_m=sd,
        n_views=views[n_other:][inside],
    )


def _grid(targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middle of the targets (3,), two points on each principal axis (6, 3), and a grid over the volume."""
    mean = targets.mean(axis=0)
    axes = np.linalg.svd(targets - mean, full_matrices=False)[2]
    along = (targets - mean) @ axes.T
    low, high = np.quantile(along, _QUANTILES, axis=0)
    middle, half = mean + (low + high) / 2 @ axes, (high - low) / 2
    ends = np.array([middle + sign * 0.5 * half[i] * axes[i] for i in range(3) for sign in (-1.0, 1.0)])
    grid = np.array([middle + (np.array(steps) * half) @ axes for steps in product(_STEPS, repeat=3)])
    return middle, ends, grid


def _distance(rig: CameraRig, middle: np.ndarray) -> float:
    return float(np.median([np.linalg.norm(camera.center_m - middle) for camera in rig.cameras]))


def _point_changes(rig: CameraRig, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of triangulated points by all parameters, and the number of views of each point.

    Returns:
        Derivatives, shape (point, 3, view * 18), 0 for points that fewer than two views see; counts, shape (point,).
    """
    n, n_views = len(points), len(rig)
    out = np.zeros((n, 3, n_views, _POSE_AND_LENS))
    pixels = rig.project(points)
    sizes = np.array([camera.size_px for camera in rig.cameras])
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -0.5) & (pixels < sizes - 0.5)).all(axis=-1)
    counts = inside.sum(axis=1)
    inside &= (counts >= _MIN_VIEWS)[:, None]
    point, view = np.nonzero(inside)
    rows = residual_rows(rig, view, pixels[point, view], points[point], np.ones(len(point)))
    by_camera = np.concatenate([rows.by_pose, rows.by_lens], axis=2)
    squares = np.zeros((n, 3, 3))
    np.add.at(squares, point, rows.by_point.transpose(0, 2, 1) @ rows.by_point)
    squares[counts < _MIN_VIEWS] = np.eye(3)
    out[point, :, view] = -np.linalg.inv(squares)[point] @ rows.by_point.transpose(0, 2, 1) @ by_camera
    return out.reshape(n, 3, -1), counts


def _without_rigid_motion(points: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return the changes without the translation and rotation that fit those of all points best."""
    x, y, z = (points - points.mean(axis=0)).T if len(points) else np.empty((3, 0))
    zero = np.zeros(len(points))
    turns = np.stack([np.stack(row, axis=-1) for row in ((zero, z, -y), (-z, zero, x), (y, -x, zero))], axis=1)
    basis = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)
    fit = np.linalg.lstsq(basis.reshape(-1, 6), change.reshape(-1, change.shape[2]), rcond=None)[0]
    return change - basis @ fit


def _worst_sds(change: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """Return the standard deviation of each point in the worst direction, shape (point,)."""
    covariance = change @ joint @ change.transpose(0, 2, 1)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))


def _length_sd(ends: np.ndarray, change: np.ndarray, seen: np.ndarray, joint: np.ndarray) -> float:
    """Return the largest standard deviation of the lengths between pairs of points, as a share of the length."""
    shares = []
    for a in range(0, len(ends), 2):
        length = float(np.linalg.norm(ends[a + 1] - ends[a]))
        if seen[a] and seen[a + 1] and length > 0.0:
            by_camera = (ends[a + 1] - ends[a]) / length @ (change[a + 1] - change[a])
            shares.append(float(np.sqrt(max(by_camera @ joint @ by_camera, 0.0))) / length)
    return max(shares, default=float("nan"))
