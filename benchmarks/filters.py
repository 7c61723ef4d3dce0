"""Filters tuned on the truth: the best that smoothing of 3D points alone can achieve.

Points have shape (frame, keypoint, 3), meters; missing points are NaN.
"""

import numpy as np
from scipy.signal import butter, sosfiltfilt

CUT_OFFS_HZ = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 15.0, 20.0)
DENSITIES = tuple(10.0 ** np.arange(1.0, 6.0, 0.5))
"""Spectral densities of white jerk, m^2 / s^5."""


def filled(points_m: np.ndarray) -> np.ndarray:
    """Interpolate gaps linearly and hold the ends; a keypoint without any point stays missing."""
    out = points_m.copy()
    frame = np.arange(len(out))
    for k in range(out.shape[1]):
        there = np.isfinite(out[:, k]).all(axis=1)
        if there.any() and not there.all():
            out[:, k] = np.stack([np.interp(frame, frame[there], out[there, k, axis]) for axis in range(3)], axis=1)
    return out


def butterworth(points_m: np.ndarray, rate_hz: float, cut_off_hz: float) -> np.ndarray:
    """Apply a zero-phase Butterworth filter of fourth order (second order, both directions) after filling gaps."""
    if cut_off_hz >= 0.5 * rate_hz or len(points_m) < 16:
        return filled(points_m)
    given = filled(points_m)
    there = np.isfinite(given).all(axis=(0, 2))
    sections = butter(2, cut_off_hz, fs=rate_hz, output="sos")
    given[:, there] = sosfiltfilt(sections, given[:, there], axis=0)
    return given


def smoother(
    points_m: np.ndarray, covariance_m2: np.ndarray, time_s: np.ndarray, density: float
) -> tuple[np.ndarray, np.ndarray]:
    """Smooth each keypoint with a white-jerk Kalman filter and a Rauch-Tung-Striebel smoother.

    Args:
        points_m: points; missing ones are predicted only.
        covariance_m2: shape (frame, keypoint, 3, 3): covariances of the points.
        time_s: shape (frame,).
        density: spectral density of the jerk, m^2 / s^5.

    Returns:
        Points and covariances between the first and the last point of each keypoint.
    """
    frames, keypoints, _ = points_m.shape
    there = np.asarray(np.isfinite(points_m).all(axis=-1) & np.isfinite(covariance_m2).all(axis=(-1, -2)))
    state, spread = np.zeros((keypoints, 9)), np.tile(np.diag(np.repeat([1e4, 1e4, 1e4], 3)), (keypoints, 1, 1))
    means, spreads = np.empty((frames, keypoints, 9)), np.empty((frames, keypoints, 9, 9))
    steps = np.diff(time_s, prepend=time_s[0])
    foretold = []
    for t in range(frames):
        move, noise = white_jerk(steps[t], density)
        state, spread = state @ move.T, move @ spread @ move.T + noise
        foretold.append((state, spread, move))
        state, spread = updated(state, spread, points_m[t], covariance_m2[t], there[t])
        means[t], spreads[t] = state, spread
    for t in range(frames - 2, -1, -1):
        ahead, ahead_spread, move = foretold[t + 1]
        gain = np.swapaxes(np.linalg.solve(ahead_spread, move @ spreads[t]), -1, -2)
        means[t] += (gain @ (means[t + 1] - ahead)[..., None])[..., 0]
        spreads[t] += gain @ (spreads[t + 1] - ahead_spread) @ np.swapaxes(gain, -1, -2)
    seen = np.logical_or.accumulate(there) & np.logical_or.accumulate(there[::-1])[::-1]
    return np.where(seen[..., None], means[..., :3], np.nan), spreads[..., :3, :3]


def updated(
    state: np.ndarray, spread: np.ndarray, point_m: np.ndarray, covariance_m2: np.ndarray, there: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Apply the Kalman update in Joseph form to the keypoints with a point."""
    state, spread = state.copy(), spread.copy()
    prior, noise = spread[there], covariance_m2[there]
    gain = np.swapaxes(np.linalg.solve(prior[:, :3, :3] + noise, prior[:, :3]), -1, -2)
    state[there] += (gain @ (point_m[there] - state[there, :3])[..., None])[..., 0]
    keep = np.tile(np.eye(9), (len(prior), 1, 1))
    keep[:, :, :3] -= gain
    spread[there] = keep @ prior @ np.swapaxes(keep, -1, -2) + gain @ noise @ np.swapaxes(gain, -1, -2)
    return state, spread


def white_jerk(step_s: float, density: float) -> tuple[np.ndarray, np.ndarray]:
    """Return transition and process noise, shape (9, 9), of position, velocity and acceleration over a step."""
    t = step_s
    move = np.array([[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]])
    noise = density * np.array(
        [[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]]
    )
    return np.kron(move, np.eye(3)), np.kron(noise, np.eye(3))
