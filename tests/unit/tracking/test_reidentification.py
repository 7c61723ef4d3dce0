"""Re-identification of lost tracks."""

from dataclasses import replace

import numpy as np

from posefuse.model.tracks import TrackState
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track
from posefuse.tracking.records import Track
from posefuse.tracking.reidentification import find_lost_track, population_is_known
from posefuse.tracking.settings import TrackerSettings
from tests.unit.tracking.mice import SETTINGS, standing


def tracked_person(last_seen_s: float, state: TrackState = TrackState.ACTIVE) -> Track:
    track = new_track(1, 0.0, LifecycleThresholds(3.0, -2.0, 6.0))
    track.last_seen_s, track.state, track.established = last_seen_s, state, True
    return track


def returns(track: Track, settings: TrackerSettings, at_m: float = 0.01) -> bool:
    """Return whether a person first seen at 0.8 s, and now at 1 s, is re-identified at a distance."""
    state = standing(np.zeros(3))
    actual = find_lost_track([track], state, state, np.array([at_m, 0.0, 0.0]), 0.8, 1.0, settings)
    return actual is not None


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
