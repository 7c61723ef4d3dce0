"""The history returns recorded states, and smoothing in blocks equals smoothing at once."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.errors import DetectionsError
from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.parallel import Jobs
from posefuse.tracking import history as history_module
from posefuse.tracking import smoothing as smoothing_module
from posefuse.tracking.body_states import empty_state, join_states, select_states
from posefuse.tracking.history import History
from posefuse.tracking.records import PastState, People, Person, TrackedFrame
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.smoothing import PeopleSmoother, SmoothedPerson
from posefuse.tracking.tempering import predict_states
from tests.unit.tracking.test_smoothing import DT_S, SKELETON, close, filtered, settings, times

__all__ = ["settings"]
VIEWS, KEYPOINTS = 3, len(SKELETON)


def person(name: str, life: TrackState, missing_s: float) -> Person:
    rows = np.arange(VIEWS)
    used = np.ones((VIEWS, KEYPOINTS), dtype=bool)
    return Person(name, life, np.empty((KEYPOINTS, 3)), np.empty((KEYPOINTS, 6)), rows, used, 1.0, missing_s)


def add_frame(history: History, frame: int, states: dict[str, State], past=None, lost=None, numbers=None) -> None:
    """Add a frame with the states of some people, past states of new ones, and the times for which others are lost."""
    everybody = empty_state(history.settings.tree)
    for state in states.values():
        everybody = join_states(everybody, state)
    lost = lost or {}
    results = [person(n, TrackState.LOST if n in lost else TrackState.ACTIVE, lost.get(n, 0.0)) for n in states]
    tracks = [SimpleNamespace(name=name, number=(numbers or {}).get(name, int(name[-1]))) for name in states]
    tracker = SimpleNamespace(tracks=tracks, state=everybody)
    people = People(10 + 2 * frame, DT_S * frame, tuple(reversed(results)), ())
    history.add(tracker, TrackedFrame(people, past or {}, ()))  # type: ignore[arg-type]


def history_of(settings: TrackerSettings, states: State, lost=None, has_past: bool = True) -> History:
    history = History(settings, has_past=has_past)
    for k in range(len(states.root)):
        past = {"person_1": []} if k == 0 else {}
        add_frame(
            history,
            k,
            {"person_1": select_states(states, [k])},
            past,
            {"person_1": lost[k]} if lost and k in lost else {},
        )
    return history


def smooth_until(history: History, stops: list[int]) -> list[SmoothedPerson]:
    smoother = PeopleSmoother(history)
    return [part for stop in stops for part in smoother.take(stop)]


def test_history_returns_what_it_recorded(settings, rng, monkeypatch):
    monkeypatch.setattr(history_module, "_BLOCK_S", 0.3)
    states = filtered(settings, 40, rng, kept_from=18)
    history = history_of(settings, states)
    (run,) = history.runs(0, 40)
    close(run.state, states, 0.0)
    assert run.fresh
    np.testing.assert_array_equal(run.places, np.arange(40))
    np.testing.assert_allclose(run.time_s, times(40))
    (part,) = history.runs(7, 21)
    close(part.state, select_states(states, np.arange(7, 21)), 0.0)
    assert not part.fresh
    assert history.place(10 + 2 * 7) == 7


def test_history_without_past_frames_keeps_fewer_in_memory(settings, rng, monkeypatch):
    """What is in memory is stored with every state of the tracking."""
    monkeypatch.setattr(history_module, "_BLOCK_S", 0.3)
    states = filtered(settings, 40, rng)
    sizes = []
    for has_past in (True, False):
        history = history_of(settings, states, has_past=has_past)
        sizes.append(len(pickle.dumps(history)))
        (run,) = history.runs(0, 40)
        close(run.state, states, 0.0)
    assert sizes[1] < 0.7 * sizes[0]


def test_frames_are_ordered_and_addressed_by_number(settings, rng):
    history = history_of(settings, filtered(settings, 3, rng))
    with pytest.raises(DetectionsError, match="in order"):
        add_frame(history, 1, {})
    with pytest.raises(DetectionsError, match="no frame 11"):
        history.place(11)


def test_history_holds_frames_before_confirmation(settings, rng):
    states = filtered(settings, 10, rng)
    history = History(settings)
    for k in range(6):
        add_frame(history, k, {})
    unseen = np.full((VIEWS, KEYPOINTS, 2), np.nan)
    past = [
        PastState(10 + 2 * k, DT_S * k, select_states(states, [k]), np.arange(VIEWS), unseen, unseen[..., 0])
        for k in (2, 3, 5)
    ]
    add_frame(history, 6, {"person_1": select_states(states, [6])}, {"person_1": past})
    (run,) = history.runs(0, 7)
    np.testing.assert_array_equal(run.places, np.arange(2, 7))
    np.testing.assert_array_equal(run.life, [TrackState.TENTATIVE] * 4 + [TrackState.ACTIVE])
    np.testing.assert_allclose(run.missing_s, [0.0, 0.0, DT_S, 0.0, 0.0], atol=1e-12)
    assert run.fresh
    assert (run.rows[2] == -1).all()
    close(select_states(run.state, [0, 1, 3]), select_states(states, [2, 3, 5]), 0.0)
    # In the frame without evidence they are where they were going.
    np.testing.assert_allclose(run.state.root[2], run.state.root[1], atol=0.2)
    assert np.trace(run.state.covariance[2]) > np.trace(run.state.covariance[1])


def test_run_ends_at_reinitialization_and_at_gaps(settings, rng):
    states = filtered(settings, 12, rng)
    history = History(settings)
    for k in range(12):
        past = {"person_1": []} if k in (0, 5) else {}
        add_frame(history, k, {} if k == 8 else {"person_1": select_states(states, [k])}, past)
    assert [run.places.tolist() for run in history.runs(0, 12)] == [[0, 1, 2, 3, 4], [5, 6, 7], [9, 10, 11]]


def test_history_follows_the_track_and_not_its_name(settings, rng):
    """A body keeps its own history after an identity swap."""
    states = filtered(settings, 12, rng)
    history = History(settings)
    for k in range(12):
        first, other = ("person_1", "person_2") if k < 6 else ("person_2", "person_1")
        others = select_states(states, [k])
        beside = others._replace(root=others.root + 2.0)
        add_frame(history, k, {first: others, other: beside}, numbers={first: 1, other: 2})
    one, two = history.runs(0, 12)
    assert (one.number, two.number) == (1, 2)
    np.testing.assert_array_equal(one.state.root, states.root)
    np.testing.assert_array_equal(two.state.root, states.root + 2.0)


def test_long_history_opens_one_file(settings, rng, monkeypatch):
    monkeypatch.setattr(history_module, "_BLOCK_S", 0.1)
    opened = []
    temporary = history_module.tempfile.TemporaryFile
    monkeypatch.setattr(
        history_module.tempfile, "TemporaryFile", lambda **named: opened.append(named) or temporary(**named)
    )
    states = filtered(settings, 40, rng)
    history = history_of(settings, states)
    close(history.runs(0, 40)[0].state, states, 0.0)
    assert len(opened) == 1


@pytest.mark.parametrize("stops", [[60, 120], [7, 30, 31, 95, 120]])
def test_smoothing_in_blocks_equals_smoothing_at_once(settings, rng, stops):
    """The blocks agree to 1e-6 m with a look-ahead of 2 s."""
    history = history_of(settings, filtered(settings, 120, rng, kept_from=70))
    (whole,) = smooth_until(history, [120])
    parts = smooth_until(history, stops)
    for name in ("root_m", "points_m", "shape_m", "directions", "shape_sd_m"):
        got = np.concatenate([getattr(part.body, name) for part in parts])
        np.testing.assert_allclose(got, getattr(whole.body, name), atol=1e-6, err_msg=name)
    got = np.concatenate([part.body.covariance_m2 for part in parts])
    np.testing.assert_allclose(got, whole.body.covariance_m2, atol=1e-8)


@pytest.mark.parametrize("start", [30, 100])
def test_smoothing_any_range_equals_smoothing_at_once(settings, rng, start):
    """The range agrees to 1e-5 m, also if it starts while the shape is estimated."""
    history = history_of(settings, filtered(settings, 200, rng, kept_from=50))
    (whole,) = smooth_until(history, [200])
    (part,) = PeopleSmoother(history, start, settings).take(start + 40)
    np.testing.assert_array_equal(part.places, np.arange(start, start + 40))
    second = whole.body.frames(start, start + 40)
    np.testing.assert_allclose(part.body.points_m, second.points_m, atol=1e-5)
    np.testing.assert_allclose(part.body.covariance_m2, second.covariance_m2, atol=1e-8)


@pytest.mark.parametrize("stops", [[40], [7, 40], [10, 20, 30, 40]])
def test_reading_in_advance_changes_nothing(settings, rng, monkeypatch, stops):
    monkeypatch.setattr(smoothing_module, "_MAX_FRAMES", 10)
    history = history_of(settings, filtered(settings, 40, rng, kept_from=18))
    whole, advance = PeopleSmoother(history), PeopleSmoother(history, jobs=Jobs(2))
    read = []
    packed_runs = History.packed_runs
    monkeypatch.setattr(History, "packed_runs", lambda self, *span: read.append(span) or packed_runs(self, *span))
    for stop in stops:
        for one, other in zip(whole.take(stop), advance.take(stop), strict=True):
            np.testing.assert_array_equal(one.places, other.places)
            np.testing.assert_array_equal(one.body.points_m, other.body.points_m)
            np.testing.assert_array_equal(one.body.covariance_m2, other.body.covariance_m2)
    if stops[0] % 10 == 0:
        assert {read.count(span) for span in read if span[1] - span[0] > 1} == {2}


def test_lag_of_the_whole_recording_equals_the_full_smoother(settings, rng):
    states = filtered(settings, 30, rng)
    full = smooth_until(history_of(settings, states), [30])
    options = replace(settings.options, smoother="lag", lag_s=10.0)
    lag = smooth_until(history_of(replace(settings, options=options), states), [30])
    assert len(lag) == 30
    np.testing.assert_allclose(np.concatenate([part.body.points_m for part in lag]), full[0].body.points_m, atol=1e-9)


def test_without_smoother_states_are_those_of_the_filter(settings, rng):
    states = filtered(settings, 30, rng)
    options = replace(settings.options, smoother="none")
    (part,) = smooth_until(history_of(replace(settings, options=options), states), [30])
    np.testing.assert_array_equal(part.body.root_m, states.root)


def test_short_losses_are_bridged_and_long_ones_are_not(settings, rng):
    states = filtered(settings, 40, rng)
    lost = {k: (k - 10) * 0.2 for k in range(10, 30)}
    long = smooth_until(history_of(settings, states, lost), [40])
    assert [(part.places[0], part.places[-1]) for part in long] == [(0, 20), (30, 39)]
    short = smooth_until(history_of(settings, states, {k: 0.1 for k in range(10, 30)}), [40])
    assert [len(part.places) for part in short] == [40]


@pytest.mark.parametrize(("smoother", "stops"), [("full", [5, 12]), ("lag", [12])])
def test_range_may_begin_with_a_reinitialization(settings, rng, smoother, stops):
    states = filtered(settings, 12, rng)
    history = History(replace(settings, options=replace(settings.options, smoother=smoother, lag_s=0.2)))
    for k in range(12):
        add_frame(history, k, {"person_1": select_states(states, [k])}, {"person_1": []} if k in (0, 5) else {})
    parts = smooth_until(history, stops)
    assert np.concatenate([part.places for part in parts]).tolist() == list(range(12))


def test_loss_is_bridged_across_a_reinitialization(settings, rng):
    """A track that is lost for 10 frames and restarts with other bone frames is smoothed as one."""
    states = filtered(settings, 40, rng)
    turn = Rotation.from_euler("z", rng.uniform(-3.0, 3.0, (len(settings.tree.bones), 1))).as_matrix()
    history, lone = History(settings), History(settings)
    now = select_states(states, [14])
    for k in range(40):
        if 15 <= k < 25:
            predict_states(now, np.array([DT_S]), settings)
        here = now if 15 <= k < 25 else select_states(states, [k])
        if k >= 25:
            here = here._replace(bones=here.bones @ turn)
        lost = {"person_1": DT_S * (k - 14)} if 15 <= k < 25 else {}
        add_frame(history, k, {"person_1": here}, {"person_1": []} if k in (0, 25) else {}, lost)
        if k < 25:
            add_frame(lone, k, {"person_1": here}, {"person_1": []} if k == 0 else {}, lost)
    before, after = smooth_until(history, [40])
    (alone,) = smooth_until(lone, [25])
    assert len(before.places) == 25
    gap_m = np.linalg.norm(after.body.points_m[0] - before.body.points_m[24], axis=-1)
    lone_gap_m = np.linalg.norm(after.body.points_m[0] - alone.body.points_m[24], axis=-1)
    assert gap_m.max() < 0.5 * lone_gap_m.max()
    spread = [body.covariance_m2[24][:, [0, 3, 5]].sum(axis=1) for body in (before.body, alone.body)]
    assert (spread[0] < spread[1]).all()
