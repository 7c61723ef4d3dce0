"""Running medians of paths."""

import numpy as np

from posefuse.kernels.jit import inline, kernel


@inline
def _mirrored(f, frames):
    """Return the frame that stands for frame ``f`` beyond the ends: time runs backward there."""
    period = max(2 * (frames - 1), 1)
    f = abs(f) % period
    return f if f < frames else period - f


@inline
def _exchange(values, old, new):
    """Replace a value in a sorted array by another."""
    last = values.shape[0] - 1
    n = 0
    while n < last and values[n] != old:
        n += 1
    while n < last and values[n + 1] < new:
        values[n] = values[n + 1]
        n += 1
    while n > 0 and values[n - 1] > new:
        values[n] = values[n - 1]
        n -= 1
    values[n] = new


@kernel
def running_median(paths, window, out):
    """Compute the median of each coordinate over the frames around each frame.

    Args:
        paths: shape (keypoint, frame, 3), finite.
        window: number of frames, odd; beyond the ends, paths are mirrored at the first and at the last frame.
        out: shape (keypoint, frame, 3), written.
    """
    frames = paths.shape[1]
    half = window // 2
    values = np.empty(window)
    for k in range(paths.shape[0]):
        for i in range(3):
            for n in range(window):
                new = paths[k, _mirrored(n - half, frames), i]
                m = n
                while m > 0 and values[m - 1] > new:
                    values[m] = values[m - 1]
                    m -= 1
                values[m] = new
            for f in range(frames):
                out[k, f, i] = values[half]
                old = paths[k, _mirrored(f - half, frames), i]
                _exchange(values, old, paths[k, _mirrored(f + 1 + half, frames), i])
