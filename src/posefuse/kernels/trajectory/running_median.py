"""Medians over windows of frames."""

import numpy as np

from posefuse.kernels.jit import kernel


@kernel
def running_median(values, window, medians):
    """Compute the median of the window around each frame; beyond the ends, the values are mirrored at the end.

    Args:
        values: shape (n, frame, component), finite.
        window: number of frames, odd.
        medians: the same shape, written.
    """
    frames = values.shape[1]
    half = window // 2
    period = max(2 * (frames - 1), 1)
    ordered = np.empty(window)
    for n in range(values.shape[0]):
        for i in range(values.shape[2]):
            for f in range(-window, frames):
                # The window gains frame f + half; for the first ones, it is not full yet.
                mirrored = (f + half) % period
                value = values[n, min(mirrored, period - mirrored) if frames > 1 else 0, i]
                size = min(f + window, window - 1)
                if f >= 0:
                    leaving = (f - half - 1) % period
                    lost = values[n, min(leaving, period - leaving) if frames > 1 else 0, i]
                    place = 0
                    while place < window - 1 and ordered[place] < lost:
                        place += 1
                    for m in range(place, window - 1):
                        ordered[m] = ordered[m + 1]
                place = size
                while place > 0 and ordered[place - 1] > value:
                    ordered[place] = ordered[place - 1]
                    place -= 1
                ordered[place] = value
                if f >= 0:
                    medians[n, f, i] = ordered[half]
