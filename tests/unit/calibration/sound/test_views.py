"""Views are synchronized together, and every view without evidence has a reason."""

import numpy as np
import pytest

from posefuse.calibration.sound.views import time_by_sound
from posefuse.model.sound import Sound
from posefuse.progress import Silent
from tests.sounds import RATE_HZ, Microphone, record, room_sound

STARTS_S = (2.0, 0.5, 6.2)


@pytest.fixture(scope="module")
def views() -> list[Sound]:
    """Three views of one room, one of another, one silent, and one without sound."""
    rng = np.random.default_rng(0)
    room, other = room_sound(30.0, rng), room_sound(30.0, rng)
    sounds = [
        Sound(f"cam{i}", record(room, start, 20.0, rng, Microphone()), RATE_HZ, start_s=-0.02 * i)
        for i, start in enumerate(STARTS_S)
    ]
    nothing = np.empty(0, dtype=np.float32)
    return [*sounds, Sound("elsewhere", record(other, 1.0, 20.0, rng), RATE_HZ),
            Sound("silent", nothing, RATE_HZ, problem="is silent"),
            Sound("mute", nothing, RATE_HZ, problem="has no sound track")]  # fmt: skip


@pytest.mark.parametrize("reference", [None, "cam0"])
def test_offsets_count_from_the_first_view_or_the_reference(views, reference):
    found = time_by_sound(views, reference, Silent())
    starts_s = np.array(STARTS_S) + 0.02 * np.arange(3)
    zero_s = starts_s[1] if reference is None else starts_s[0]
    assert [each.offset_s for each in found[:3]] == pytest.approx((starts_s - zero_s).tolist(), abs=0.005)
    assert all(each.is_decisive and "pieces of sound agree" in each.reason for each in found[:3])
    assert [each.drift_ppm for each in found[:3]] == [0.0] * 3


def test_views_without_evidence_have_one_sentence(views):
    found = {each.view: each for each in time_by_sound(views, None, Silent())}
    assert found["elsewhere"].reason == "The sound of elsewhere does not agree with that of any other view."
    assert found["silent"].reason == "silent is silent."
    assert found["mute"].reason == "mute has no sound track."
    assert not any(found[name].is_decisive for name in ("elsewhere", "silent", "mute"))


def test_one_sound_has_nothing_to_compare_with(views):
    alone, _ = time_by_sound([views[0], views[-1]], None, Silent())
    assert alone.reason == "No other view has sound to compare with: mute."
    (only,) = time_by_sound(views[:1], None, Silent())
    assert only.reason == "There is no other view."
    (short, _) = time_by_sound([Sound("a", np.ones(RATE_HZ, np.float32), RATE_HZ), views[0]], None, Silent())
    assert short.reason == "The sound of a is too short (1.0 s of 1.5 s)."


def test_delay_that_contradicts_the_others_is_left_out(views, monkeypatch):
    """A wrong delay between two of four views does not move the others."""
    from dataclasses import replace

    from posefuse.calibration.sound import views as module

    rng = np.random.default_rng(5)
    room = room_sound(30.0, rng)
    four = [Sound(f"cam{i}", record(room, 1.0 + i, 20.0, rng), RATE_HZ) for i in range(4)]
    measure = module.measure_delay

    def wrong(sounds, onsets):
        delay = measure(sounds, onsets)
        is_wrong = {sound.view for sound in sounds} == {"cam0", "cam3"}
        return replace(delay, offset_s=delay.offset_s + 0.5, chance=1e-8) if is_wrong and delay else delay

    monkeypatch.setattr(module, "measure_delay", wrong)
    found = time_by_sound(four, "cam0", Silent())
    assert [each.offset_s for each in found] == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=0.005)
