"""A table of entries returns what was added, by track and in the order of the frames, also after it was pickled."""

import pickle
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from posefuse.arrays import kernel_array
from posefuse.kernels.tracking.history_rows import RowHeads, SeenPeople
from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.history_entries import Entries, EntryTable

POSE, SHAPE, VIEWS, KEYPOINTS = 5, 2, 3, 4
OWN = np.array([0, 2, 3])


def state_of(values: list[float], free: bool) -> State:
    people, size = len(values), 2 * POSE + SHAPE
    value = np.array(values)
    root = value[:, None] + np.arange(3)
    velocity = value[:, None] + np.arange(POSE)
    shape = value[:, None] + np.arange(SHAPE)
    turns, bones = np.ones((2, people, 1, 3, 3)) * value[:, None, None, None]
    factor = np.random.default_rng(int(1e3 * np.abs(value).sum())).normal(size=(people, size, size))
    covariance = factor @ factor.transpose(0, 2, 1)
    if not free:
        covariance[:, POSE : POSE + SHAPE] = 0.0
        covariance[:, :, POSE : POSE + SHAPE] = 0.0
    return State(root, turns, bones, shape, velocity, covariance, np.full(people, int(free)))


def seen_of(people: int) -> SeenPeople:
    """Return views of which the first shows nothing, and of which no detection shows keypoint 2 of the last person."""
    rng = np.random.default_rng(people)
    rows = np.array([[-1, 2 * p, 2 * p + 1] for p in range(people)])
    labels = np.tile(np.arange(KEYPOINTS), (people, VIEWS, 1))
    labels[-1, :, 2] = -1
    pixels = rng.uniform(0.0, 100.0, (2 * people, KEYPOINTS, 2))
    confidence = rng.uniform(0.0, 1.0, (2 * people, KEYPOINTS))
    used = rng.uniform(size=(people, VIEWS, KEYPOINTS)) > 0.5
    track = np.arange(people)
    return SeenPeople(rows, used, track, rows, labels, kernel_array(pixels), kernel_array(confidence), OWN)


def add(table: EntryTable, place: int, values: dict[int, float], **changes: Any) -> tuple[State, SeenPeople]:
    """Add a frame with a value of each track; lengths are free in odd frames, which changes the size of triangles."""
    numbers, people = np.array(list(values)), len(values)
    state, seen = state_of(list(values.values()), bool(place % 2)), seen_of(people)._replace(**changes)
    life = np.full(people, TrackState.ACTIVE, dtype=np.int8)
    heads = RowHeads(place, numbers, np.full(people, place == 10), life, 0.25 * numbers)
    table.add(heads, state, seen)
    return state, seen


def same(found: Entries, expected: Entries) -> None:
    for field in fields(Entries):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name), err_msg=field.name)


@pytest.mark.parametrize("frames", [6, 90])
def test_entries_are_those_that_were_added(frames):
    table, added = EntryTable(), {}
    for place in range(10, 10 + frames):
        added[place] = add(table, place, {7: place + 0.5, 3: place + 0.25})
    found = table.by_track(0, 1000)
    assert list(found) == [7, 3]
    for p, (number, entries) in enumerate(found.items()):
        assert entries.places.tolist() == list(range(10, 10 + frames))
        assert entries.fresh.tolist() == [True] + (frames - 1) * [False]
        assert (entries.life == TrackState.ACTIVE).all()
        assert (entries.missing_s == 0.25 * number).all()
        states = entries.state
        for i, (state, seen) in enumerate(added.values()):
            for mine, theirs in zip(states, state, strict=True):
                np.testing.assert_allclose(mine[i], theirs[p], rtol=1e-9)
            np.testing.assert_array_equal(entries.rows[i], seen.rows[p])
            np.testing.assert_array_equal(entries.used[i], seen.used[p])
            assert np.isnan(entries.keypoints_px[i, 0]).all()
            pixels, trust = seen.keypoints_px[seen.rows[p, 1:]][:, OWN], seen.confidence[seen.rows[p, 1:]][:, OWN]
            missing = [1] if p == 1 else []
            pixels[:, missing], trust[:, missing] = np.nan, np.nan
            np.testing.assert_array_equal(entries.keypoints_px[i, 1:], pixels.astype(np.float32))
            np.testing.assert_array_equal(entries.confidence[i, 1:], trust.astype(np.float32))


def test_people_whose_keypoints_are_not_kept_have_none():
    table = EntryTable()
    add(table, 10, {7: 1.5, 3: 2.5}, track=np.array([-1, 1]))
    found = table.by_track(0, 20)
    assert np.isnan(found[7].keypoints_px).all()
    assert np.isfinite(found[3].keypoints_px).any()


def test_later_entries_replace_earlier_ones_in_the_order_of_the_frames():
    table, expected = EntryTable(), EntryTable()
    for place in (12, 13, 14, 12, 11):
        add(table, place, {7: -1.0 if (place, len(table)) == (12, 3) else place})
    for place in (11, 12, 13, 14):
        add(expected, place, {7: -1.0 if place == 12 else place})
    same(table.by_track(0, 20)[7], expected.by_track(0, 20)[7])


def test_range_of_frames():
    table, short = EntryTable(), EntryTable()
    for place in range(10, 30):
        add(table, place, {7: place} if place < 20 else {7: place, 3: -place})
    for place in range(15, 18):
        add(short, place, {7: place})
    assert list(table.by_track(15, 18)) == [7]
    same(table.by_track(15, 18)[7], short.by_track(0, 100)[7])
    same(table.by_track(0, 100)[7].within(15, 18), short.by_track(0, 100)[7])
    assert EntryTable().by_track(0, 10) == {}


def test_pickled_table_continues_and_has_no_unused_rows():
    table, expected = EntryTable(), EntryTable()
    for place in range(10, 14):
        add(table, place, {7: place, 3: -place})
    content = pickle.dumps(table)
    assert len(content) < 8 * 1.3e3
    table = pickle.loads(content)
    for place in range(14, 18):
        add(table, place, {7: place, 3: -place})
    for place in range(10, 18):
        add(expected, place, {7: place, 3: -place})
    for number in (7, 3):
        same(table.by_track(0, 100)[number], expected.by_track(0, 100)[number])
    assert pickle.loads(pickle.dumps(EntryTable())).by_track(0, 1) == {}
