"""Coincidences of two views are not confirmed, and occluded people keep their tracks."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from posefuse.kernels.tracking.projection import project_people
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.specification import SpecificationOptions
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.camera_monitor import is_occluded
from posefuse.tracking.records import People
from posefuse.tracking.tracker import ArticulatedTracker

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 5)
EVERY = tuple(range(5))
DT_S = 0.04
FIRM_S = 0.6


def tracker_with(preset: str = "posefuse", **changed: Any) -> ArticulatedTracker:
    """Return a tracker with a strategy, and with other options of the strategy `specification`."""
    specification = replace(SpecificationOptions(), **changed)
    options = Options(tracker=TrackerOptions(strategy=preset, specification=specification))  # pyright: ignore[reportArgumentType]
    return tracker_of(RIG, SKELETON, default_noise(RIG, options), options)


def standing_px(tracker: ArticulatedTracker, x_m: float = 0.1) -> np.ndarray:
    """Return the pixels of an upright person close to the center, shape (view, keypoint, 2)."""
    tree = tracker.settings.tree
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [x_m, 0.2, 0.95]
    body = initial_state(tree, points, np.asarray(tree.shape_m), tree.shape_covariance, tracker.settings.options.motion)
    projected = ProjectedBodies.allocate(1, len(RIG), len(SKELETON))
    project_people(tracker.settings.cameras, tracker.settings.body, body, projected.arrays)
    return projected.pixels[0]


def frame_of(number: int, shown: np.ndarray, views: tuple[int, ...], rng: np.random.Generator) -> Frame:
    """Return one detection with 1 px noise in each of some views, ascending."""
    pixels = shown[list(views)] + rng.normal(0.0, 1.0, (len(views), *shown.shape[1:]))
    return Frame(
        pixels,
        np.ones(pixels.shape[:2]),
        np.array(views, dtype=np.int64),
        np.full(len(views), -1),
        np.full(len(RIG), number * DT_S),
        np.ones(len(RIG), dtype=bool),
        number,
    )


def track_intervals(tracker: ArticulatedTracker, intervals: list[tuple[float, tuple[int, ...]]]) -> list[People]:
    """Return the people of each frame while views show a person for given durations."""
    rng, shown, results = np.random.default_rng(0), standing_px(tracker), []
    for seconds, views in intervals:
        results += [tracker.update(frame_of(len(results) + i, shown, views, rng)) for i in range(round(seconds / DT_S))]
    return results


def active_s(results: list[People]) -> float:
    return DT_S * sum(any(p.state == TrackState.ACTIVE for p in people.people) for people in results)


def test_two_of_five_views_do_not_confirm_a_track():
    assert active_s(track_intervals(tracker_with(), [(3.0, (0, 2))])) == 0.0


def test_three_views_confirm_a_track_within_0_2_s():
    assert active_s(track_intervals(tracker_with(), [(1.0, (0, 2, 3))])) > 0.8


def test_two_views_alone_confirm_a_track_after_1_s():
    tracker = tracker_with()
    others = np.array([False, True, False, True, True])
    rng, shown = np.random.default_rng(0), standing_px(tracker)
    began = None
    for i in range(50):
        frame = frame_of(i, shown, (0, 2), rng)
        results = tracker.update(replace(frame, recorded=~others))
        if began is None and any(p.state == TrackState.ACTIVE for p in results.people):
            began = i * DT_S
    assert began == pytest.approx(1.0, abs=0.1)


def test_established_track_survives_in_one_view():
    results = track_intervals(tracker_with(), [(FIRM_S, EVERY), (2.0, (1,)), (0.4, EVERY)])
    assert active_s(results) > FIRM_S + 2.0
    assert {p.name for people in results for p in people.people if p.state == TrackState.ACTIVE} == {"person_1"}


def test_unestablished_track_terminates_in_one_view():
    """The track lasts at most ten frames in one view after its confirmation in three."""
    tracker = tracker_with()
    rng, shown, i = np.random.default_rng(0), standing_px(tracker), 0
    while not tracker.tracks:
        tracker.update(frame_of(i, shown, (0, 2, 3), rng))
        i += 1
    left = [tracker.update(frame_of(i + j, shown, (2,), rng)) for j in range(20)]
    assert active_s(left) <= 10 * DT_S
    assert not tracker.tracks
    assert "coincidence" in " ".join(event.why for people in left for event in people.events)


def test_specification_establishes_every_track():
    tracker = tracker_with("specification")
    track_intervals(tracker, [(0.4, EVERY)])
    assert all(track.established for track in tracker.tracks)
    assert tracker.tracks


def displaced_after_loss(tracker: ArticulatedTracker) -> list[tuple[int, str, str]]:
    """Return the events after a person stands still, is not seen for 0.5 s, and appears 0.5 m aside."""
    results = track_intervals(tracker, [(0.6, EVERY), (0.5, ())])
    assert [track.state for track in tracker.tracks] == [TrackState.LOST]
    shown, rng, first = standing_px(tracker, 0.6), np.random.default_rng(1), len(results)
    found = [tracker.update(frame_of(first + i, shown, EVERY, rng)) for i in range(10)]
    return [(event.number - first, event.what, event.person) for people in found for event in people.events]


def test_specification_reacquires_a_lost_track_by_a_proposal_in_the_same_frame():
    """Detections 0.5 m from the prediction do not match it; their proposal does."""
    on = displaced_after_loss(tracker_with("specification", persistent_velocities=False))
    assert on == [(0, "reacquired", "person_1")]
    off = tracker_with("specification", persistent_velocities=False, same_frame_reacquisition=False)
    ((frame, what, person),) = displaced_after_loss(off)
    assert (what, person) == ("reidentified", "person_1")
    assert frame >= 3
    assert [track.name for track in off.tracks] == ["person_1"]


@pytest.mark.parametrize("limit_m2", [50.0, None])
def test_specification_terminates_an_uncertain_lost_track(limit_m2: float | None):
    """The uncertainty of a velocity that persists exceeds tau_P about 2 s after the last detection."""
    tracker = tracker_with("specification", terminate_variance_m2=limit_m2, terminate_outside_after_s=None)
    track_intervals(tracker, [(0.6, EVERY), (3.0, ())])
    assert len(tracker.tracks) == (limit_m2 is None)


def test_specification_terminates_a_lost_track_outside_the_volume():
    """A predicted person who leaves all images, upward at 4 m/s, is terminated; who stays inside is not."""
    for after_s, remains in ((1.0, 0), (None, 1)):
        tracker = tracker_with("specification", terminate_variance_m2=None, terminate_outside_after_s=after_s)
        track_intervals(tracker, [(0.6, EVERY)])
        tracker.state.velocity[0] = 0.0
        tracker.state.velocity[0, 2] = 4.0
        shown, rng = standing_px(tracker), np.random.default_rng(0)
        for i in range(100):
            tracker.update(frame_of(15 + i, shown, (), rng))
        assert len(tracker.tracks) == remains
    still = tracker_with("specification", terminate_variance_m2=None)
    track_intervals(still, [(0.6, EVERY)])
    still.state.velocity[0] = 0.0
    for i in range(100):
        still.update(frame_of(15 + i, standing_px(still), (), np.random.default_rng(0)))
    assert len(still.tracks) == 1


def test_specification_tracks_views_that_differ_in_time():
    """Motion, lengths and updates also apply where each view has its own time."""
    tracker, rng = tracker_with("specification"), np.random.default_rng(0)
    shown = standing_px(tracker)
    for i in range(30):
        frame = frame_of(i, shown, EVERY, rng)
        tracker.update(replace(frame, time_s=frame.time_s + 0.004 * np.arange(len(RIG))))
    assert [track.state for track in tracker.tracks] == [TrackState.ACTIVE]
    points = tracker.confirmed.projected(tracker.settings.cameras, tracker.settings).pixels[0]
    assert np.nanmedian(np.linalg.norm(points - shown, axis=-1)) < 5.0


def test_other_detections_occlude_and_own_ones_do_not():
    rng, shown = np.random.default_rng(0), standing_px(tracker_with())
    frame = frame_of(0, shown, EVERY, rng)
    core = shown[:, [SKELETON.index(name) for name in SKELETON.core]]
    empty, rows = np.full(5, -1), np.array([0, -1, 2, -1, -1])
    np.testing.assert_array_equal(is_occluded(core, empty, frame, 0.5), np.ones(5, dtype=bool))
    np.testing.assert_array_equal(is_occluded(core, rows, frame, 0.5), rows < 0)
    aside = core + np.array([400.0, 0.0])
    assert not is_occluded(aside, empty, frame, 0.5).any()
    assert not is_occluded(core, empty, frame_of(0, np.full_like(shown, np.nan), EVERY, rng), 0.5).any()
