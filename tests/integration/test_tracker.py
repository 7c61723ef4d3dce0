"""Properties of the tracker in any scene: determinism, invariance and frame rates."""

import pickle
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse import Options
from posefuse.errors import DetectionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.pipeline.track_live import Tracker
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.options import CLEAN
from posefuse.tracking.records import People, Person

SECONDS, PEOPLE = 4.0, 3


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    """Return 100 frames of three people with all detector errors."""
    return simulate_crowd(CrowdOptions(people=PEOPLE, duration_s=SECONDS, seed=1))


@pytest.fixture(scope="module")
def tracked(scene: CrowdScene) -> list[People]:
    return run(scene.rig, frames_of(scene.detections))


def frames_of(detections: Detections) -> list[Frame]:
    return [Frame.of(detections, i) for i in range(detections.n_frames)]


def run(rig: CameraRig, frames: Iterable[Frame], options: TrackerOptions | None = None) -> list[People]:
    tracker = Tracker(rig, "body_20", Options(tracker=options or TrackerOptions()))
    return [tracker.update(frame) for frame in frames]


def events_of(results: Sequence[People]) -> list[Event]:
    return [event for people in results for event in people.events]


def people_in_state(people: People, state: TrackState = TrackState.ACTIVE) -> dict[str, Person]:
    return {person.name: person for person in people.people if person.state == state}


def assert_same_people(results: Sequence[People], others: Sequence[People], within_m: float) -> None:
    """Assert equal names and states, with points within a tolerance."""
    for one, other in zip(results, others, strict=True):
        assert [(p.name, p.state) for p in one.people] == [(p.name, p.state) for p in other.people]
        for first, second in zip(one.people, other.people, strict=True):
            np.testing.assert_allclose(first.points_m, second.points_m, rtol=0, atol=within_m)


def reordered(frame: Frame, order: Sequence[int]) -> Frame:
    """Return the views in another order: the new view ``i`` is the old ``order[i]``."""
    rows = np.concatenate([frame.rows_of(view) for view in order]).astype(int)
    return replace(
        frame,
        keypoints_px=frame.keypoints_px[rows],
        confidence=frame.confidence[rows],
        view=np.repeat(np.arange(len(order)), [len(frame.rows_of(view)) for view in order]),
        track_ids=frame.track_ids[rows],
        time_s=frame.time_s[list(order)],
        recorded=frame.recorded[list(order)],
    )


def without_rows(frame: Frame, keep: np.ndarray) -> Frame:
    return replace(
        frame,
        keypoints_px=frame.keypoints_px[keep],
        confidence=frame.confidence[keep],
        view=frame.view[keep],
        track_ids=frame.track_ids[keep],
    )


def with_ghost(frame: Frame, view: int, shift_px: float) -> Frame:
    """Add a false detection to a view: its first one, shifted."""
    rows = frame.rows_of(view)
    if not len(rows):
        return frame
    after = int(rows[-1]) + 1
    moved = frame.keypoints_px[rows[0]] + np.array([shift_px, 0.0])
    return replace(
        frame,
        keypoints_px=np.insert(frame.keypoints_px, after, moved, axis=0),
        confidence=np.insert(frame.confidence, after, frame.confidence[rows[0]], axis=0),
        view=np.insert(frame.view, after, view),
        track_ids=np.insert(frame.track_ids, after, -1),
    )


def moved_rig(rig: CameraRig, new_from_old: np.ndarray) -> CameraRig:
    """Return the cameras of the same images in other world coordinates."""
    back = np.linalg.inv(new_from_old)
    return replace(
        rig, cameras=tuple(replace(c, camera_from_world=c.camera_from_world @ back) for c in rig.cameras), up_axis=None
    )


def test_every_person_is_confirmed_once(scene: CrowdScene, tracked: list[People]) -> None:
    truth = np.asarray(scene.truth.layers["measured"].points_m)
    actual = people_in_state(tracked[-1])
    assert len(actual) == PEOPLE
    apart = [
        np.nanmean(np.linalg.norm(truth[-1] - person.points_m, axis=-1), axis=-1).min() for person in actual.values()
    ]
    assert max(apart) < 0.1
    assert [e.what for e in events_of(tracked)].count("confirmed") == PEOPLE


def test_same_frames_give_the_same_bytes(scene: CrowdScene, tracked: list[People]) -> None:
    again = run(scene.rig, frames_of(scene.detections))
    assert [pickle.dumps(people) for people in tracked] == [pickle.dumps(people) for people in again]


def test_pickled_tracker_resumes(scene: CrowdScene, tracked: list[People]) -> None:
    tracker = Tracker(scene.rig, "body_20")
    frames = frames_of(scene.detections)
    # At frame 2 some people are still tentative.
    for stop, start in ((2, 0), (50, 2), (len(frames), 50)):
        for i in range(start, stop):
            # Not to the last bit: with a cold cache and two test processes it has differed by a rounding error.
            assert_same_people([tracker.update(frames[i])], [tracked[i]], 1e-9)
        tracker = pickle.loads(pickle.dumps(tracker))


def test_result_is_independent_of_the_camera_order(scene: CrowdScene, tracked: list[People]) -> None:
    order = [3, 0, 4, 2, 1]
    rig = replace(scene.rig, cameras=tuple(scene.rig.cameras[v] for v in order))
    others = run(rig, [reordered(frame, order) for frame in frames_of(scene.detections)])
    assert_same_people(tracked, others, 1e-6)
    for one, other in zip(tracked, others, strict=True):
        for first, second in zip(one.people, other.people, strict=True):
            np.testing.assert_array_equal(first.used[order], second.used)


def test_result_moves_with_the_world(scene: CrowdScene, tracked: list[People]) -> None:
    turn = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix()
    move = np.array([12.0, -7.0, 3.0])
    new_from_old = np.eye(4)
    new_from_old[:3, :3], new_from_old[:3, 3] = turn, move
    others = run(moved_rig(scene.rig, new_from_old), frames_of(scene.detections))
    expected = [
        replace(people, people=tuple(replace(p, points_m=p.points_m @ turn.T + move) for p in people.people))
        for people in tracked
    ]
    assert_same_people(expected, others, 2e-3)


def test_track_events_do_not_depend_on_the_frame_rate() -> None:
    """One of two people leaves at 10.7 s and is back at 15.7 s; the order of names does not matter."""
    slow, fast = events_by_person(25.0), events_by_person(100.0)
    assert [[what for what, _ in life] for life in slow] == [[what for what, _ in life] for life in fast]
    assert [what for what, _ in slow[0]] == ["confirmed"]
    assert [what for what, _ in slow[1]] in (["confirmed", "lost", "reidentified"], ["confirmed", "lost", "reacquired"])
    for one, other in zip(slow, fast, strict=True):
        np.testing.assert_allclose([at_s for _, at_s in one], [at_s for _, at_s in other], rtol=0, atol=0.1)


def events_by_person(rate_hz: float) -> list[list[tuple[str, float]]]:
    """Return the events of each person, fewest first."""
    options = CrowdOptions("leave", duration_s=22.0, rate_hz=rate_hz, seed=0, detector=CLEAN, faults=NO_FAULTS)
    made = simulate_crowd(options)
    results = run(made.rig, frames_of(made.detections)[int(9.5 * rate_hz) : int(17.0 * rate_hz)])
    actual: dict[str, list[tuple[str, float]]] = {}
    for event in events_of(results):
        actual.setdefault(event.person, []).append((event.what, event.time_s))
    return sorted(actual.values(), key=len)


def test_empty_frame_is_a_missing_detection_of_all_tracks(scene: CrowdScene) -> None:
    frames = frames_of(scene.detections)
    tracker = Tracker(scene.rig, "body_20")
    before = [tracker.update(frame) for frame in frames[:40]][-1]
    nothing = without_rows(frames[40], np.zeros(len(frames[40].view), dtype=bool))
    empty = tracker.update(nothing)
    assert list(people_in_state(empty)) == list(people_in_state(before))
    for name, person in people_in_state(empty).items():
        assert (person.rows == -1).all()
        assert not person.used.any()
        assert person.log_odds < people_in_state(before)[name].log_odds
        was = people_in_state(before)[name].covariance_m2[:, (0, 3, 5)].sum(axis=1)
        assert np.nanmean(person.covariance_m2[:, (0, 3, 5)].sum(axis=1)) > np.nanmean(was)


def test_tracker_accepts_empty_frames(scene: CrowdScene) -> None:
    frames = frames_of(scene.detections)[:30]
    results = run(scene.rig, [without_rows(f, np.zeros(len(f.view), dtype=bool)) for f in frames])
    assert all(not people.people and not people.events for people in results)


def test_frames_out_of_order_are_refused(scene: CrowdScene) -> None:
    frames = frames_of(scene.detections)
    tracker = Tracker(scene.rig, "body_20")
    tracker.update(frames[5])
    for i in (5, 4):
        with pytest.raises(DetectionsError, match="Frames must be in order of time"):
            tracker.update(frames[i])
    assert tracker.update(frames[6]).number == 6


def test_frames_of_other_keypoints_or_cameras_are_refused(scene: CrowdScene) -> None:
    frame = Frame.of(scene.detections, 0)
    fewer = replace(frame, keypoints_px=frame.keypoints_px[:, :17], confidence=frame.confidence[:, :17])
    with pytest.raises(DetectionsError, match="17 keypoints"):
        Tracker(scene.rig, "body_20").update(fewer)
    with pytest.raises(DetectionsError, match="5 views"):
        Tracker(replace(scene.rig, cameras=scene.rig.cameras[:4]), "body_20").update(frame)


def test_no_detection_is_assigned_twice(scene: CrowdScene, tracked: list[People]) -> None:
    frames = frames_of(scene.detections)
    claimed = 0
    for frame, people in zip(frames, tracked, strict=True):
        rows = np.concatenate([person.rows[person.rows >= 0] for person in people.people] or [np.empty(0, int)])
        assert len(rows) == len(set(rows.tolist()))
        claimed += len(rows)
        for person in people.people:
            of_view = np.flatnonzero(person.rows >= 0)
            np.testing.assert_array_equal(frame.view[person.rows[of_view]], of_view)
            # A view without a detection of a person may share that of another one.
            others = np.isin(np.arange(len(person.rows)), frame.view[rows.astype(int)])
            assert not person.used[(person.rows < 0) & ~others].any()
    assert claimed > 0.8 * sum(len(frame.view) for frame in frames)


def test_number_of_people_is_limited(scene: CrowdScene) -> None:
    results = run(scene.rig, frames_of(scene.detections), TrackerOptions(max_people=2))
    most = [sum(p.state != TrackState.TENTATIVE for p in people.people) for people in results]
    assert max(most) == 2


def test_track_states_are_in_order(scene: CrowdScene) -> None:
    """All people are visible for 2 s and then gone."""
    frames = frames_of(scene.detections)
    frames = frames[:50] + [without_rows(f, np.zeros(len(f.view), dtype=bool)) for f in frames[50:]]
    results = run(scene.rig, frames)
    born = {e.person: e.number for e in events_of(results) if e.what == "confirmed"}
    assert len(born) == PEOPLE
    order = [TrackState.ACTIVE, TrackState.LOST]
    for name, number in born.items():
        states = [person.state for people in results for person in people.people if person.name == name]
        assert states == sorted(states, key=order.index)
        assert set(states) == set(order)
        assert len(states) == len(frames) - number
        at = people_in_state(results[number])[name].points_m
        before = [np.nanmean(np.linalg.norm(p.points_m - at, axis=-1)) for p in results[number - 1].people]
        tentative = [p.state == TrackState.TENTATIVE for p in results[number - 1].people]
        assert tentative[int(np.argmin(before))]
        assert min(before) < 0.3


def test_detections_of_a_single_view_start_no_track(scene: CrowdScene, tracked: list[People]) -> None:
    """A false detection in one view in all frames neither adds nor moves a person."""
    frames = [with_ghost(frame, 2, 400.0) for frame in frames_of(scene.detections)]
    others = run(scene.rig, frames)
    assert sum(len(frame.view) for frame in frames) == int(scene.detections.offsets[-1]) + len(frames)
    for one, other in zip(tracked, others, strict=True):
        assert list(people_in_state(one)) == list(people_in_state(other))
    alone = [only_view(frame, 2) for frame in frames]
    assert all(not people.people for people in run(scene.rig, alone))


def only_view(frame: Frame, view: int) -> Frame:
    """Return the frame with the detections of one view."""
    return without_rows(frame, frame.view == view)


@pytest.mark.long
def test_times_of_views_improve_the_result():
    """Five views are taken one fifth of a frame apart: their times improve the result."""
    rate_hz, fine = 10.0, 5
    scene = simulate_crowd(
        CrowdOptions(people=1, duration_s=5.0, rate_hz=rate_hz * fine, seed=3, detector=CLEAN, faults=NO_FAULTS)
    )
    truth = np.asarray(scene.truth.layers["measured"].points_m)[:, 0]
    fine_frames = frames_of(scene.detections)
    in_turn, at_once, last = [], [], []
    for first in range(0, len(fine_frames) - fine, fine):
        parts = [fine_frames[first + v] for v in range(fine)]
        people = [part.keypoints_px[part.rows_of(v)] for v, part in enumerate(parts)]
        trust = [part.confidence[part.rows_of(v)] for v, part in enumerate(parts)]
        times = [part.time_s[v] for v, part in enumerate(parts)]
        in_turn.append(Frame.of_people(people, trust, times, number=first))
        at_once.append(Frame.of_people(people, trust, times[-1], number=first))
        last.append(truth[first + fine - 1])

    def error_m(frames: list[Frame]) -> float:
        results = run(scene.rig, frames)
        off = [
            np.linalg.norm(person.points_m - other, axis=-1).mean()
            for people, other in zip(results, last, strict=True)
            for person in people_in_state(people).values()
        ]
        assert len(off) > 0.8 * len(frames)
        return float(np.mean(off))

    assert error_m(in_turn) < 0.8 * error_m(at_once)


def test_displaced_limb_is_reinitialized(scene):
    tracker = Tracker(scene.rig, "body_20")
    frames = frames_of(scene.detections)
    for frame in frames[:50]:
        tracker.update(frame)
    inner = tracker._tracker
    tree = inner.settings.tree
    elbow, wrist = tree.bones.index("left_elbow"), tree.bones.index("left_wrist")
    for bone in (elbow, wrist):
        inner.state.bones[0, bone] = (
            Rotation.from_euler("x", 170, degrees=True).as_matrix() @ inner.state.bones[0, bone]
        )
        column = 3 + 3 * len(tree.segments) + 2 * bone
        for each in (column, column + 1):
            inner.state.covariance[0, each] = inner.state.covariance[0, :, each] = 0.0
            inner.state.covariance[0, each, each] = 1e-7
    name = inner.tracks[0].name
    after = [tracker.update(frame) for frame in frames[50:90]]
    assert any(event.what == "limb_reinitialized" and event.person == name for event in events_of(after))
    truth = np.asarray(scene.truth.layers["measured"].points_m)[89]
    actual = people_in_state(after[-1])[name].points_m
    assert np.nanmin(np.linalg.norm(truth - actual, axis=-1).mean(axis=-1)) < 0.08


def test_silent_camera_and_its_return_are_reported(scene: CrowdScene) -> None:
    """The test covers a camera without frames and one without detections."""
    frames = frames_of(scene.detections)
    for gone in (without_view, dark):
        dark_frames = [gone(frame, 1) if 0.8 <= i / 25.0 < 3.4 else frame for i, frame in enumerate(frames)]
        output = [event for event in events_of(run(scene.rig, dark_frames)) if event.what.startswith("camera")]
        name = scene.rig.names[1]
        assert [(event.person, event.what) for event in output] == [(name, "camera_silent"), (name, "camera_back")]
        assert output[0].time_s == pytest.approx(2.8, abs=0.3)
        assert output[1].time_s == pytest.approx(3.6, abs=0.1)


def dark(frame: Frame, view: int) -> Frame:
    return without_rows(frame, frame.view != view)


def without_view(frame: Frame, view: int) -> Frame:
    recorded, time_s = frame.recorded.copy(), np.array(frame.time_s)
    recorded[view], time_s[view] = False, np.nan
    return replace(dark(frame, view), recorded=recorded, time_s=time_s)


_LIVE = """
import pickle, sys
import posefuse
with open(sys.argv[1], "rb") as file:
    rig, frames = pickle.load(file)
tracker = posefuse.Tracker(rig, "body_20")
for frame in frames:
    people = tracker.update(frame).people
unwanted = ("h5py", "numba.np.linalg", "pandas", "pyarrow", *(f"scipy.{each}" for each in (
    "fft", "interpolate", "linalg", "ndimage", "optimize", "signal", "sparse", "spatial", "special", "stats")))
print(len(people), [name for name in unwanted if name in sys.modules])
"""


def test_live_tracking_loads_neither_scipy_nor_compiler(scene, tracked, tmp_path):
    """They would take most of the time until the first frame. Numba itself loads the name scipy without its parts."""
    (tmp_path / "frames").write_bytes(pickle.dumps((scene.rig, frames_of(scene.detections))))
    command = [sys.executable, "-c", _LIVE, str(tmp_path / "frames")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"{len(tracked[-1].people)} []\n"
