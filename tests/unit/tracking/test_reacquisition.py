"""Lost people are re-acquired by the proposals of one or two frames."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.kernels.tracking.records import State
from posefuse.model.detections import Detections
from posefuse.model.tracks import TrackState
from posefuse.synthetic.crowds import CrowdScene
from posefuse.tracking.body_states import join_states
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track
from posefuse.tracking.reacquisition import find_reacquired_tracks
from posefuse.tracking.records import TentativeTrack, Track
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_initiation import fit_body
from tests.unit.tracking.stage_runs import (
    active_people,
    clean_scene,
    errors_m,
    events_of,
    frames_and_views,
    run_without,
    select_rows,
    true_points_m,
)
from tests.unit.tracking.test_track_initiation import settings_with, standing_still

START, STOP = 45, 70
"""Frames without detections of the first person."""
BACK_IN = (1, 3)
"""Views that show the person afterwards."""


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    return clean_scene(people=2, duration_s=3.4)


def with_gap(scene: CrowdScene, stop: int) -> Detections:
    """Return the detections without those of the first person in a gap, after which two views show the person."""
    frame, view = frames_and_views(scene.detections)
    gone = (frame >= START) & ((frame < stop) | ~np.isin(view, BACK_IN))
    return select_rows(scene.detections, ~((scene.owner == 0) & gone))


@pytest.mark.parametrize("stop", [START + 10, START + 13, STOP])
def test_person_is_reacquired_within_one_frame_of_two_views(scene: CrowdScene, stop: int) -> None:
    results = run_without(scene, detections=with_gap(scene, stop))
    truth = true_points_m(scene)[:, 0]
    name = next(name for name in active_people(results[START - 1]) if errors_m(results, name, truth)[START - 1] < 0.2)
    errors = errors_m(results, name, truth)
    assert [event.what for event in events_of(results) if event.person == name][-2:] == ["lost", "reacquired"]
    assert np.isnan(errors[stop - 1])
    assert np.nanmax(errors[stop + 1 :]) < 0.3
    assert np.isfinite(errors[stop + 1 :]).all()


def lost_track(number: int) -> Track:
    track = new_track(number, 0.0, LifecycleThresholds(3.0, -2.0, 6.0))
    track.last_seen_s, track.state, track.established = 0.0, TrackState.LOST, True
    return track


def tentative_at(settings: TrackerSettings, off_m: float = 0.0, log_odds: float = 10.0) -> TentativeTrack:
    """Return a tentative track of one frame, 0.5 s after the loss of the person."""
    observation = standing_still(settings, np.array([0.5]))[0]
    points_m = observation.points_m + np.array([off_m, 0.0, 0.0])
    pixels = np.stack([camera.project(points_m)[0] for camera in settings.rig.cameras])
    return TentativeTrack(1, [replace(observation, points_m=points_m, keypoints_px=pixels, log_odds=log_odds)])


def found(settings: TrackerSettings, *tentative: TentativeTrack, n_lost: int = 1) -> list[tuple[int, TentativeTrack]]:
    state: State = fit_body(tentative_at(settings).observations, settings)[0]
    lost = state if n_lost == 1 else join_states(state, state)
    tracks = [lost_track(number) for number in range(1, n_lost + 1)]
    return [(match.track, each) for match, each in find_reacquired_tracks(tracks, lost, list(tentative), settings)]


def test_nearest_proposal_continues_the_track() -> None:
    settings = settings_with()
    far, near = tentative_at(settings, 0.8), tentative_at(settings, 0.05)
    assert found(settings, far, near) == [(0, near)]


def test_proposal_beyond_reach_continues_no_track() -> None:
    settings = settings_with()
    options = settings.options
    reach_m = options.reidentification.reach_m + 0.5 * options.motion.top_speed_m_s
    assert found(settings, tentative_at(settings, reach_m + 0.2)) == []


def test_unlikely_proposal_continues_no_track() -> None:
    settings = settings_with()
    assert found(settings, tentative_at(settings, log_odds=-20.0)) == []


def test_proposal_between_two_equal_tracks_waits_for_confirmation() -> None:
    settings = settings_with()
    assert found(settings, tentative_at(settings), n_lost=2) == []
