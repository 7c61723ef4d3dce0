"""Velocities of sampled points: symmetric differences over the frames around each sample.

A symmetric difference is uncorrelated with the error at its center. It attenuates a movement of frequency f by
``sin(2 pi f reach) / (2 pi f reach)``. The information about clocks is a product of the attenuated and the true
velocity, but the equations contain the attenuated one twice. Its reach is therefore short and does not depend on the
distance of the samples.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.joint.recording import JointRecording

_REACH_S, _ROUNDING = 0.1, 1e-3


@dataclass(frozen=True, eq=False)
class Support:
    """Hold the frames from which points and velocities of the sampled frames follow.

    Attributes:
        frames: shape (support,): indices of frames, ascending.
        before: shape (sample,): positions in ``frames`` of the frames before the samples.
        center: shape (sample,): positions of the samples.
        after: shape (sample,): positions of the frames after the samples.
        good: shape (sample,), bool: whether both neighbors exist without a gap.
    """

    frames: np.ndarray
    before: np.ndarray
    center: np.ndarray
    after: np.ndarray
    good: np.ndarray

    def slopes(self, values: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        """Return the derivatives by time at the samples, 0 where unknown.

        Args:
            values: shape (support, column, coordinate).
            time_s: shape (support,).
        """
        apart = np.where(self.good, time_s[self.after] - time_s[self.before], 1.0)
        slope = (values[self.after] - values[self.before]) / apart[:, None, None]
        return np.where(self.good[:, None, None] & np.isfinite(slope), slope, 0.0)


def support_frames(recording: JointRecording, frames: np.ndarray, spans: int = 1) -> Support:
    """Return the sampled frames with the neighbors that determine their velocities.

    Args:
        recording: the keypoints.
        frames: shape (sample,): indices of frames, ascending.
        spans: reach of the differences, as a multiple of the usual one.
    """
    moments_s, runs = recording.moments_s, recording.runs
    step_s = float(np.median(np.diff(moments_s))) if len(moments_s) > 1 else recording.period_s
    reach = spans * max(1, int(_REACH_S / step_s + _ROUNDING))
    before, after = np.maximum(frames - reach, 0), np.minimum(frames + reach, len(moments_s) - 1)
    apart = moments_s[after] - moments_s[before]
    good = (np.abs(apart - 2 * reach * step_s) < 0.5 * step_s) & (runs[before] == runs[after])
    before, after = np.where(good, before, frames), np.where(good, after, frames)
    every = np.unique(np.concatenate([before, frames, after]))
    before, center, after = (np.searchsorted(every, at) for at in (before, frames, after))
    return Support(every, before, center, after, good)
