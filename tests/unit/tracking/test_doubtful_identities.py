"""Names of lost people that new people received are corrected."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.people import tracker_for
from benchmarks.reacquisition import room, with_gaps

from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.options.tracking_stages import ReidentificationOptions
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.recorder import Recorder
from posefuse.tracking.doubtful_identities import Correction, Doubts, begin_doubt, resolve_doubts
from posefuse.tracking.history import History
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track
from posefuse.tracking.records import Candidate, Observation
from posefuse.tracking.reidentification import Reidentification
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_initiation import fit_body
from posefuse.tracking.track_set import TrackSet
from tests.unit.tracking.test_track_initiation import settings_with, standing_still

TIMES_S = np.arange(2.0, 3.6, 0.1)
"""Times at which the re-acquired person is seen; the person was lost at 0 s."""


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    return settings_with()


def person(settings: TrackerSettings, seed: int, size: float) -> list[Observation]:
    """Return observations with errors of a person of a size."""
    rng = np.random.default_rng(seed)
    seen = standing_still(settings, TIMES_S, size)
    return [replace(each, keypoints_px=each.keypoints_px + rng.normal(0.0, 2.0, (4, 20, 2))) for each in seen]


def tracked(settings: TrackerSettings, n: int) -> TrackSet:
    """Return tracks of people of the tree's size, whose lengths are known."""
    tracks, tree = TrackSet.empty(settings), settings.tree
    state = fit_body(standing_still(settings, np.zeros(1)), settings)[0]
    for number in range(1, n + 1):
        track = new_track(number, 0.0, LifecycleThresholds(3.0, -2.0, 6.0))
        track.known_shape, track.last_seen_s = (tree.shape_m.copy(), np.diag((0.01 * tree.shape_m) ** 2)), 0.0
        tracks.append(track, state, settings)
    tracks.n_created = n
    return tracks


def resolve(
    settings: TrackerSettings, tracks: TrackSet, sizes: list[float], position: float = 0.0
) -> tuple[list[Correction], Doubts]:
    """Return the corrections after the first track was re-acquired in doubt; sizes are those of the people it shows."""
    doubts: Doubts = {}
    tracks.tracks[0].state = TrackState.LOST
    begin_doubt(doubts, tracks, Reidentification(0, "", position=position), person(settings, 0, 1.0)[0], settings)
    tracks.tracks[0].state = TrackState.ACTIVE
    for number, size in enumerate(sizes, start=1):
        for each in doubts.values():
            one = each.candidates.setdefault(number, replace(each.candidates[1]))
            one.observations = type(one.observations)(person(settings, number, size), maxlen=100)
    return resolve_doubts(doubts, tracks, TIMES_S[-1], settings), doubts


def test_own_lengths_leave_the_name(settings: TrackerSettings) -> None:
    tracks = tracked(settings, 1)
    corrections, doubts = resolve(settings, tracks, [1.0])
    assert corrections == []
    assert list(doubts) == ["person_1"]
    assert [track.name for track in tracks.tracks] == ["person_1"]


@pytest.mark.parametrize("size", [0.9, 1.1])
def test_other_lengths_give_a_new_name_and_lose_the_person_again(settings: TrackerSettings, size: float) -> None:
    tracks = tracked(settings, 1)
    known = tracks.tracks[0].known_shape
    assert known is not None
    corrections, doubts = resolve(settings, tracks, [size])
    assert [(each.swap.numbers, each.names) for each in corrections] == [((1, 2), ("person_2", "person_1"))]
    assert corrections[0].swap.since_s == pytest.approx(TIMES_S[0], abs=1e-3)
    assert not doubts
    now = [(track.number, track.name, track.state) for track in tracks.tracks]
    assert now == [(1, "person_2", TrackState.ACTIVE), (2, "person_1", TrackState.LOST)]
    assert tracks.tracks[1].known_shape is known
    assert tracks.state.free.tolist() == [1, 1]
    np.testing.assert_allclose(tracks.state.shape[0].sum() / known[0].sum(), size, atol=0.06)


def test_later_person_with_better_lengths_receives_the_name(settings: TrackerSettings) -> None:
    tracks = tracked(settings, 2)
    corrections, _ = resolve(settings, tracks, [1.05, 1.0])
    assert [(each.swap.numbers, each.names) for each in corrections] == [((1, 2), ("person_2", "person_1"))]
    assert [track.name for track in tracks.tracks] == ["person_2", "person_1"]


def test_place_that_identifies_the_person_leaves_no_doubt(settings: TrackerSettings) -> None:
    assert resolve(settings, tracked(settings, 1), [1.1], position=4.0) == ([], {})


def test_candidates_have_a_next_check(settings: TrackerSettings) -> None:
    tracks = tracked(settings, 1)
    doubts = resolve(settings, tracks, [1.0])[1]
    assert isinstance(doubts["person_1"].candidates[1], Candidate)
    assert resolve_doubts(doubts, tracks, TIMES_S[-1], settings) == []
    assert doubts["person_1"].candidates[1].next_check_s > TIMES_S[-1] - TIMES_S[0]


def test_newcomer_with_the_name_of_a_lost_person_is_renamed_from_the_first_frame() -> None:
    """The third person appears 2 s after the first one was lost, and is taken for that one for 1.2 s."""
    scene, gaps = with_gaps(room(3, 5), "new", 5)
    tracker = tracker_for(scene, TrackerOptions(reidentification=ReidentificationOptions(min_log_odds=-3.0)))
    recorder, n = Recorder(History(tracker.settings)), gaps[0].stop + 10
    names: list[set[str]] = []
    for i in range(n):
        result = tracker.process(Frame.of(scene.detections, i))
        recorder.add(tracker, result)
        names.append({each.name for each in result.people.people if each.state == TrackState.ACTIVE})
    assert "identities_swapped" in {event.what for event in recorder.events}
    offsets = np.asarray(scene.detections.offsets)[: 5 * n + 1]
    people = recorder.close((), offsets, 5)
    rows = people.recording_tracks.rows(scene.detections.frames(0, n))
    named = [
        {
            people.recording_tracks.person_ids[p]
            for _, p, v in np.argwhere(rows >= 0)
            if scene.owner[rows[_, p, v]] == own
        }
        for own in range(3)
    ]
    assert [len(each) for each in named] == [1, 1, 1]
    assert len(set.union(*named)) == 3
