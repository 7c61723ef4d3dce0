"""Offsets of recorded sounds are found to 5 ms, and unrelated sounds decide nothing."""

import numpy as np
import pytest

from posefuse.calibration.sound.delay import measure_delay
from posefuse.calibration.sound.onsets import find_onsets
from posefuse.model.sound import Sound
from tests.sounds import RATE_HZ, Microphone, record, room_sound


def delay_of(*sounds: Sound):
    return measure_delay((sounds[0], sounds[1]), (find_onsets(sounds[0]), find_onsets(sounds[1])))


def heard(sound: np.ndarray, start_s: float, duration_s: float, seed: int, microphone: Microphone) -> Sound:
    rng = np.random.default_rng(seed)
    return Sound("a", record(sound, start_s, duration_s, rng, microphone), RATE_HZ)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("duration_s", "microphone"),
    [(20.0, Microphone(10.0)), (20.0, Microphone(0.0)), (30.0, Microphone(-5.0)), (8.0, Microphone(20.0))],
)
def test_offsets_of_different_microphones_in_a_room_with_echo(seed, duration_s, microphone):
    sound = room_sound(duration_s + 6.0, np.random.default_rng(seed))
    late_s = 0.5 + 0.7131 * seed
    starts_s = (1.0, 1.0 + late_s)
    delay = delay_of(*(heard(sound, start, duration_s, 10 * seed + k, microphone) for k, start in enumerate(starts_s)))
    assert delay.is_decisive
    assert delay.offset_s == pytest.approx(late_s, abs=0.005)
    assert delay.sd_s < 0.005


def test_drift_of_the_sampling_clocks_is_measured():
    sound = room_sound(130.0, np.random.default_rng(3))
    first, second = heard(sound, 1.0, 120.0, 1, Microphone()), heard(sound, 3.0, 120.0, 2, Microphone(clock_ppm=60.0))
    delay = delay_of(first, second)
    # The second clock shows 60 ppm less time, so the view falls behind.
    assert delay.drift_ppm == pytest.approx(60.0, abs=5.0)
    assert delay.offset_s == pytest.approx(2.0 + 60e-6 * delay.middle_s, abs=0.005)


@pytest.mark.parametrize("duration_s", [3.0, 10.0, 40.0])
def test_unrelated_sounds_decide_nothing(duration_s):
    for seed in range(8):
        sounds = [room_sound(duration_s + 4.0, np.random.default_rng([seed, k])) for k in range(2)]
        delay = delay_of(*(heard(each, 1.0, duration_s, k, Microphone()) for k, each in enumerate(sounds)))
        assert delay is None or not delay.is_decisive


def test_periodic_sound_is_ambiguous():
    rng = np.random.default_rng(0)
    sound = np.zeros(40 * RATE_HZ)
    click = rng.standard_normal(300) * np.exp(-np.arange(300) / 60)
    for at in range(0, len(sound) - 400, RATE_HZ // 2):
        sound[at : at + 300] = click
    delay = delay_of(*(heard(sound, start, 25.0, k, Microphone(20.0)) for k, start in enumerate((1.0, 2.2))))
    assert not delay.is_decisive
    assert delay.rival_s is not None
    assert abs(delay.offset_s - delay.rival_s) % 0.5 == pytest.approx(0.0, abs=0.02)


def test_moving_source_widens_the_standard_deviation():
    """A person who walks from one camera to the other: the delay changes by 20 ms."""
    rng = np.random.default_rng(4)
    sound = room_sound(44.0, rng)
    times_s = np.arange(40 * RATE_HZ) / RATE_HZ + 1.0
    near = np.interp((times_s - 0.01 * np.sin(times_s)) * RATE_HZ, np.arange(len(sound)), sound)
    far = np.interp((times_s + 0.7 + 0.01 * np.sin(times_s)) * RATE_HZ, np.arange(len(sound)), sound)
    delay = delay_of(*(Sound("a", each.astype(np.float32), RATE_HZ) for each in (near, far)))
    assert delay.is_decisive
    assert delay.offset_s == pytest.approx(0.7, abs=0.02)


def test_too_little_shared_sound_is_no_delay():
    assert delay_of(*(Sound("a", np.ones(RATE_HZ, np.float32), RATE_HZ) for _ in range(2))) is None
