"""Velocities follow from the frames around each sample."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.joint.velocities import support_frames


@pytest.mark.parametrize("period_s", [0.04, 0.05])
@pytest.mark.parametrize("stride", [1, 2, 5, 12])
def test_velocities_do_not_depend_on_the_distance_of_the_samples(walk, stride, period_s):
    """A movement of 1 Hz loses a quarter of its velocity over 0.4 s, and clocks seem that much less certain.

    The slowest view may have a longer period than the moments at which points are estimated.
    """
    recording = replace(walk[0], period_s=period_s)
    frames = np.arange(0, len(recording.time_s), stride)
    support = support_frames(recording, frames)
    time_s = recording.moments_s[support.frames]
    wave = np.sin(2 * np.pi * time_s)[:, None, None]
    slopes = support.slopes(wave, time_s)[support.good, 0, 0]
    expected = 2 * np.pi * np.cos(2 * np.pi * time_s[support.center][support.good])
    assert len(slopes) >= len(frames) - 4
    assert (slopes @ expected) / (expected @ expected) == pytest.approx(1.0, abs=0.05)
    assert np.array_equal(support.frames[support.center], frames)


def test_velocities_do_not_span_gaps_or_ends(walk):
    recording = replace(walk[0], runs=(np.arange(len(walk[0].time_s)) >= 10).astype(int))
    frames = np.array([0, 5, 9, 10, 14, len(recording.time_s) - 1])
    support = support_frames(recording, frames)
    assert support.good.tolist() == [False, True, False, False, True, False]
    slopes = support.slopes(np.ones((len(support.frames), 1, 3)), recording.moments_s[support.frames])
    assert np.array_equal(slopes, np.zeros((6, 1, 3)))
    values = np.full((len(support.frames), 1, 3), np.nan)
    assert np.array_equal(support.slopes(values, recording.moments_s[support.frames]), np.zeros((6, 1, 3)))
