"""Content of checkpoints: values come back as they were, arrays are shared on the way, and damage is found."""

import io
from collections import deque
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.io.part_content import Packed, compressed, copied, packed, unpacked
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import StrategyName, TrackerOptions
from posefuse.pipeline.people.track_recording import first_tracker
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from tests.properties import examples

TYPES = ("<f8", "<f4", "<i8", "|u1", "|b1")


def arrays(rng: np.random.Generator, size: int) -> dict[str, np.ndarray]:
    """Return arrays of all types, orders and strides."""
    numbers = rng.integers(0, 200, (size, 3))
    found = {name: numbers.astype(name) for name in TYPES}
    floats = found["<f8"]
    return {**found, "fortran": np.asfortranarray(floats), "strided": floats[::2, 1:], "empty": floats[:0]}


def written(content: Packed) -> bytes:
    file = io.BytesIO()
    content.write(file, {"key": "k"})
    return file.getvalue()


@given(seed=st.integers(0, 2**31), size=st.sampled_from([0, 1, 3001, 40_000]))
@examples(8)
def test_values_are_read_as_they_were(seed, size):
    value = arrays(np.random.default_rng(seed), size)
    content, kept = compressed(value)
    fields, again = Packed.read(io.BytesIO(written(content)))
    assert fields["key"] == "k"
    for found in (kept, again.unpacked()):
        assert list(found) == list(value)
        for name, array in value.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)


def test_large_arrays_are_shared_and_copies_are_not():
    numbers = np.zeros(100_000)
    _, shared = compressed(numbers)
    _, own = copied(numbers)
    numbers[:] = 1.0
    assert (shared == 1.0).all()
    assert (own == 0.0).all()


def test_arrays_that_are_read_can_be_changed():
    array = Packed.read(io.BytesIO(written(compressed(np.zeros(100_000))[0])))[1].unpacked()
    array += 1.0
    assert (array == 1.0).all()


@given(content=st.binary(max_size=300), width=st.sampled_from([1, 2, 4, 8, 16]))
@examples(60)
def test_bytes_of_any_length_and_width_round_trip(content, width):
    assert bytes(unpacked(packed(memoryview(content), width), len(content), width)) == content
    with pytest.raises((ValueError, EOFError)):
        unpacked(packed(memoryview(content), width), len(content) + 1, width)


def test_smooth_numbers_take_less_space_by_their_width():
    smooth = np.linspace(1.0, 2.0, 20_000)
    assert len(packed(smooth.data.cast("B"), 8)) < 0.8 * len(packed(smooth.data.cast("B"), 1))


@pytest.mark.parametrize("at", [0.0, 0.2, 0.5, 0.9])
def test_damage_is_found(at):
    whole = bytearray(written(compressed(arrays(np.random.default_rng(0), 30_000))[0]))
    whole[int(at * len(whole))] ^= 1
    with pytest.raises((ValueError, KeyError, TypeError)):
        Packed.read(io.BytesIO(bytes(whole)))
    with pytest.raises((ValueError, KeyError, TypeError)):
        Packed.read(io.BytesIO(bytes(whole[:-1])))


def test_queues_of_doubtful_identities_are_stored():
    value = {"person_1": deque([(1, np.arange(3.0))], maxlen=2)}
    same = compressed(value)[0].unpacked()
    assert same["person_1"].maxlen == 2
    np.testing.assert_array_equal(same["person_1"][0][1], np.arange(3.0))


@pytest.mark.parametrize("strategy", get_args(StrategyName))
@pytest.mark.parametrize("proposals", [True, False])
def test_trackers_of_all_strategies_are_stored(strategy, proposals):
    scene = simulate_crowd(CrowdOptions("crowd", people=1, cameras=4, duration_s=1.0, seed=3))
    specification = replace(TrackerOptions().specification, pair_proposals=proposals)
    tracker_options = TrackerOptions(strategy=strategy, specification=specification)
    options = Options(people="many", noise_scale_px=14.0, tracker=tracker_options)
    tracker, same = first_tracker(scene.rig, scene.detections, options), None
    for i in range(scene.detections.n_frames):
        frame = Frame.of(scene.detections, i)
        if i == 5:
            same = compressed(tracker)[0].unpacked()
        found = tracker.process(frame)
        if same is not None:
            copy = same.process(frame).people
            assert [each.name for each in copy.people] == [each.name for each in found.people.people]
            for one, other in zip(copy.people, found.people.people, strict=True):
                np.testing.assert_array_equal(one.points_m, other.points_m)
    assert tracker.tracks
