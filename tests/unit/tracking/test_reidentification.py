"""Re-identification of lost tracks."""

from dataclasses import replace

import numpy as np

from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track
from posefuse.tracking.records import Observation, Track
from posefuse.tracking.reidentification import find_lost_track, population_is_known, position_log_odds
from posefuse.tracking.settings import TrackerSettings
from tests.unit.tracking.mice import SETTINGS, standing
from tests.unit.tracking.test_track_initiation import fit_motionless_body, settings_with


def tracked_person(last_seen_s: float, state: TrackState = TrackState.ACTIVE) -> Track:
    track = new_track(1, 0.0, LifecycleThresholds(3.0, -2.0, 6.0))
    track.last_seen_s, track.state, track.established = last_seen_s, state, True
    return track


def returns(track: Track, settings: TrackerSettings, at_m: float = 0.01) -> bool:
    """Return whether a person first seen at 0.8 s, and now at 1 s, is re-identified at a distance."""
    fitted = standing(np.array([at_m, 0.0, 0.0]))
    return find_lost_track([track], standing(np.zeros(3)), fitted, seen(fitted), 0.8, 1.0, settings) is not None


def seen(body: State) -> Observation:
    """Return the detections of a body at 1 s in all views."""
    projected = ProjectedBodies.of(body, SETTINGS.cameras, SETTINGS.body)
    pixels = projected.pixels[0]
    rows, certain = np.zeros(len(pixels), dtype=np.int64), np.ones(pixels.shape[:2])
    points, covariance = projected.points_m[0], projected.covariance_m2[0]
    return Observation(1.0, 0, pixels, certain, rows, points, covariance, body.root[0], 10.0, 1.0)


def test_unsupported_track_can_be_reidentified_before_it_is_lost() -> None:
    assert returns(tracked_person(0.7), SETTINGS)
    assert returns(tracked_person(0.85), SETTINGS)
    assert not returns(tracked_person(0.95), SETTINGS)
    assert not returns(tracked_person(0.7), SETTINGS, at_m=0.4)


def test_closed_population_has_no_new_identities() -> None:
    closed = replace(SETTINGS, options=replace(SETTINGS.options, population=1))
    track = tracked_person(0.0, TrackState.LOST)
    assert population_is_known([track], closed)
    assert not population_is_known([track], SETTINGS)
    assert not population_is_known([replace(track, established=False)], closed)
    assert not returns(track, SETTINGS, at_m=5.0)
    assert returns(track, closed, at_m=5.0)


def odds_of_position(off_m: float, absent_s: float) -> float:
    """Return the log odds of a place off the prediction of a person who stood still when lost."""
    settings = settings_with()
    lost = fit_motionless_body(settings, np.arange(0.0, 1.0, 0.04))
    fitted = select_states(lost, [0])
    fitted.root[0, 0] += off_m
    predict_people(np.array([absent_s]), settings.motion, lost)
    return float(position_log_odds(lost, np.array([absent_s]), fitted, settings)[0])


def test_place_far_off_the_prediction_shows_another_person() -> None:
    """A place within reach of the top speed is no evidence: few people move that fast."""
    assert odds_of_position(0.1, 0.5) > 2.0
    assert odds_of_position(1.8, 0.5) < -1.8
    assert odds_of_position(1.8, 4.0) > odds_of_position(1.8, 0.5)
    assert odds_of_position(8.0, 0.5) == -np.inf
