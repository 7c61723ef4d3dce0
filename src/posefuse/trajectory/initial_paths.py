"""Initial paths: measured points that are consistent with their neighbors in time, interpolated in between."""

import numpy as np

from posefuse.kernels.trajectory.running_median import running_median
from posefuse.trajectory.observations import PersonObservations

_WINDOW_S = 0.2
_MIN_WINDOW = 5
_MAX_DEVIATION = 6.0
"""In median deviations from the median of the neighbors; no point of a smooth path deviates more."""


def initial_paths(observed: PersonObservations) -> tuple[np.ndarray, np.ndarray]:
    """Return the initial paths, shape (keypoint, frame, 3), and view weights, (keypoint, frame, view)."""
    paths = interpolate_missing(observed.points_m, observed.time_s)
    window = max(_MIN_WINDOW, 2 * round(0.5 * _WINDOW_S / observed.step_s) + 1)
    median = np.empty(paths.shape)
    running_median(paths, window, median)
    deviation = np.linalg.norm(observed.points_m - median, axis=-1)
    valid_frames = np.isfinite(deviation)
    typical = np.array(
        [
            np.median(own[own_there]) if own_there.any() else 0.0
            for own, own_there in zip(deviation, valid_frames, strict=True)
        ]
    )
    # At the ends the median lags behind by the motion in half a window.
    steps = np.linalg.norm(np.diff(median, axis=1), axis=-1)
    motion = np.median(steps, axis=1) * (window // 2) if steps.shape[1] else np.zeros(len(deviation))
    consistent = valid_frames & (deviation <= (_MAX_DEVIATION * typical + 2.0 * motion)[:, None])
    paths = interpolate_missing(np.where(consistent[..., None], observed.points_m, np.nan), observed.time_s)
    return paths, np.where(observed.agreed & consistent[..., None] & np.isfinite(observed.sigma_px), 1.0, 0.0)


def interpolate_missing(points_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Interpolate missing points (keypoint, frame, 3) linearly in time, or extend the nearest one.

    A keypoint without any point starts at the median of all others.
    """
    out = points_m.copy()
    valid = np.asarray(np.isfinite(points_m).all(axis=-1))
    for k in np.flatnonzero(~valid.all(axis=1)):
        there, missing = np.flatnonzero(valid[k]), np.flatnonzero(~valid[k])
        if not len(there):
            out[k] = np.median(points_m[valid], axis=0) if valid.any() else 0.0
            continue
        known_s, known_m, asked_s = time_s[there], points_m[k, there], time_s[missing]
        for i in range(3):
            out[k, missing, i] = np.interp(asked_s, known_s, known_m[:, i])
    return out
