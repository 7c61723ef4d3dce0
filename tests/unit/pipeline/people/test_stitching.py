"""Stitching of tracks cut at window borders."""

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from posefuse.model.track_events import Event
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.people.stitching import same_people, stitch
from posefuse.pipeline.people.windows import TrackedWindow, TrackingWindow
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.properties import examples

SKELETON = shipped_skeleton("body_20")
VIEWS = 3


def crowd_tracks(seed: int, n_frames: int, people: int) -> Tracks:
    """Return people who enter one after the other, are detected in some views, and stay or leave."""
    rng = np.random.default_rng(seed)
    order = np.argsort(rng.random((n_frames, VIEWS, people)), axis=2).transpose(0, 2, 1)
    detection = np.where(rng.random(order.shape) < 0.7, order, -1).astype(np.int32)
    state = np.full((n_frames, people), TrackState.ACTIVE, dtype=np.int8)
    comes = np.sort(rng.integers(0, n_frames - 25, people))
    comes[0] = 0
    for p in range(people):
        goes = int(rng.integers(comes[p] + 20, n_frames + 1))
        state[: comes[p], p] = state[goes:, p] = TrackState.ABSENT
        detection[comes[p], p, 0] = order[comes[p], p, 0]
    state = state[:, np.argsort(comes, kind="stable")]
    detection[state == TrackState.ABSENT] = -1
    return Tracks(tuple(f"person_{p + 1}" for p in range(people)), detection, state)


def track_window(tracks: Tracks, window: TrackingWindow, rng: np.random.Generator) -> TrackedWindow:
    """Return the tracks of a window as a tracker would: people present, in order of appearance, with new names."""
    part = tracks.frames(window.first, window.last)
    state, detection = np.asarray(part.state), np.asarray(part.detection)
    present = [p for p in range(state.shape[1]) if (state[:, p] != TrackState.ABSENT).any()]
    present.sort(key=lambda p: (int(np.argmax(state[:, p] != TrackState.ABSENT)), p))
    detection = np.where(rng.random(detection.shape) < 0.05, -1, detection)[:, present]
    names = tuple(f"person_{i + 1}" for i in range(len(present)))
    first = [int(np.argmax(state[:, p] != TrackState.ABSENT)) + window.first for p in present]
    events = tuple(
        Event(number, 0.1 * number, name, "confirmed", f"beside {names[0]}")
        for name, number in zip(names, first, strict=True)
    )
    lengths = np.array(present, dtype=float)[:, None]
    return TrackedWindow(window, Tracks(names, detection, state[:, present]), events, SKELETON, lengths, lengths)


def no_bodies(window: int) -> tuple:
    raise AssertionError(f"bodies of window {window} are not needed")


@given(st.integers(0, 10**6), st.integers(60, 200), st.integers(1, 5), st.integers(1, 4))
@examples(60)
def test_tracks_cut_at_window_borders_are_stitched(seed, n_frames, people, number):
    tracks, rng = crowd_tracks(seed, n_frames, people), np.random.default_rng(seed)
    bounds = np.linspace(0, n_frames, number + 1).astype(int).tolist()
    windows = [
        TrackingWindow(max(bounds[i] - 12, 0), bounds[i], bounds[i + 1], min(bounds[i + 1] + 12, n_frames))
        for i in range(number)
    ]
    actual = stitch([track_window(tracks, each, rng) for each in windows], np.arange(n_frames), no_bodies)
    assert actual.recording_tracks.person_ids == tracks.person_ids
    np.testing.assert_array_equal(actual.recording_tracks.state, tracks.state)
    where = np.asarray(actual.recording_tracks.detection) >= 0
    np.testing.assert_array_equal(
        np.asarray(actual.recording_tracks.detection)[where], np.asarray(tracks.detection)[where]
    )
    born = {event.person: event.number for event in actual.events}
    first = np.argmax(np.asarray(tracks.state) != TrackState.ABSENT, axis=0).tolist()
    assert {name: number for name, number in born.items() if number in first} == dict(
        zip(tracks.person_ids, first, strict=True)
    )
    np.testing.assert_array_equal(actual.shape_m[:, 0], np.arange(people))


def test_tracks_with_different_detections_are_not_matched(tmp_path: Path):
    tracks = crowd_tracks(1, 60, 1)
    before = track_window(tracks, TrackingWindow(0, 0, 30, 40), np.random.default_rng(0))
    after = track_window(tracks, TrackingWindow(20, 30, 60, 60), np.random.default_rng(1))
    assert same_people(before, after) == {0: 0}
    moved = np.where(np.asarray(after.tracks.detection) >= 0, np.asarray(after.tracks.detection) + 1, -1)
    other = TrackedWindow(
        after.window, Tracks(after.tracks.person_ids, moved.astype(np.int32), after.tracks.state), (), SKELETON,
        after.shape_m, after.shape_sd_m,
    )  # fmt: skip
    assert same_people(before, other) == {}
    assert stitch([before, other], np.arange(60), no_bodies).recording_tracks.person_ids == ("person_1", "person_2")
