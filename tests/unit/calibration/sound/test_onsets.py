"""Onsets mark where sounds begin, whatever the microphone."""

import numpy as np

from posefuse.calibration.sound.onsets import STEP_S, find_onsets
from posefuse.model.sound import Sound
from tests.sounds import RATE_HZ


def bursts(gain: float) -> Sound:
    rng = np.random.default_rng(1)
    samples = 1e-3 * rng.standard_normal(4 * RATE_HZ)
    for time_s in (1.0, 2.5):
        at = round(time_s * RATE_HZ)
        samples[at : at + 800] += 0.3 * rng.standard_normal(800)
    return Sound("a", (gain * samples).astype(np.float32), RATE_HZ, 0.1)


def test_onsets_are_at_the_beginnings_of_sounds():
    onsets = find_onsets(bursts(1.0))
    times_s = onsets.start_s + STEP_S * np.arange(onsets.values.shape[1])
    strongest = times_s[np.sort(np.argsort(onsets.values.sum(axis=0))[-4:])]
    assert np.abs(strongest[:, None] - np.array([1.1, 2.6])).min(axis=1).max() < 0.025


def test_level_of_the_recording_does_not_matter():
    loud, soft = find_onsets(bursts(1.0)), find_onsets(bursts(0.01))
    np.testing.assert_allclose(loud.values, soft.values, atol=0.01)


def test_short_and_silent_sounds_have_no_onsets():
    assert find_onsets(Sound("a", np.zeros(100, np.float32), RATE_HZ)).values.shape[1] == 0
    assert not find_onsets(Sound("a", np.zeros(RATE_HZ, np.float32), RATE_HZ)).values.any()
