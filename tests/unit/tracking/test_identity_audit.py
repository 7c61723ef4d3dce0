"""Audit of identities by bone lengths after close contact."""

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.crowd_options import NO_FAULTS
from posefuse.synthetic.crowds import CrowdScene, crowd_of_points
from posefuse.synthetic.figures import human
from posefuse.synthetic.options import CLEAN
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.walkers import meet
from posefuse.tracking.body_states import join_states
from posefuse.tracking.identity_audit import (
    AuditResult,
    Contact,
    audit_identities,
    drop_contacts,
    ordered_pair,
    update_contacts,
)
from posefuse.tracking.records import People
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import FrameOutcome
from tests.unit.tracking.stage_runs import (
    active_people,
    assert_equal_results,
    clean_scene,
    events_of,
    frames_and_views,
    run_without,
    select_rows,
    true_points_m,
)
from tests.unit.tracking.test_lifecycle import tracked_person
from tests.unit.tracking.test_track_initiation import settings_with, standing_still

NAMES = ("person_1", "person_2")
APART_S = 1.3
TIMES_S = np.arange(0.0, APART_S, 0.04)


def outcome_of(supported: np.ndarray, expected: np.ndarray, time_s: float, dt_s: float) -> FrameOutcome:
    """Return the outcome of a frame of which only the views matter."""
    nothing = np.empty(0)
    frame = Frame(np.empty((0, 1, 2)), np.empty((0, 1)), nothing, nothing, nothing, nothing)
    rows = np.where(supported, 0, -1)
    return FrameOutcome(frame, time_s, dt_s, rows, nothing, nothing, supported, expected)


def audit(settings: TrackerSettings, reference: tuple[float, float], shown: tuple[float, float]) -> AuditResult:
    """Return the audit of two people with known sizes and others observed since."""
    tracks, bodies = zip(*(tracked_person(settings, TrackState.ACTIVE) for _ in NAMES), strict=True)
    for track, name, size in zip(tracks, NAMES, reference, strict=True):
        track.name, track.shape_observed_s = name, settings.options.fix_shape_after_s
        track.known_shape = size * settings.tree.shape_m, np.diag((0.005 + 0.0 * settings.tree.shape_m) ** 2)
    contact = Contact(NAMES, 1.0, 0.0)
    for name, size in zip(NAMES, shown, strict=True):
        contact.observations[name] = deque(standing_still(settings, TIMES_S, size))
    return audit_identities({NAMES: contact}, list(tracks), join_states(*bodies), APART_S, settings)[0]


def test_different_bodies_are_distinguished():
    settings = settings_with()
    straight = audit(settings, (1.06, 0.98), (1.06, 0.98))
    crossed = audit(settings, (1.06, 0.98), (0.98, 1.06))
    assert (straight.swap, straight.is_clear) == (False, True)
    assert (crossed.swap, crossed.is_clear) == (True, True)
    assert crossed.log_odds == pytest.approx(-straight.log_odds)


@pytest.mark.parametrize("shown", [(1.0, 1.0), (1.06, 0.98)])
def test_equal_bodies_are_not_distinguished(shown):
    result = audit(settings_with(), (1.02, 1.02), shown)
    assert result.log_odds == pytest.approx(0.0, abs=1e-9)
    assert (result.swap, result.is_clear) == (False, False)


@pytest.mark.parametrize("larger", [0.01, 0.02, 0.03, 0.04, 0.06])
def test_identities_are_swapped_only_above_the_odds_threshold(larger):
    """The threshold is a likelihood ratio, which bounds the rate of errors."""
    result = audit(settings_with(), (1.0 + larger, 1.0), (1.0, 1.0 + larger))
    assert result.log_odds < 0.0
    assert result.swap == result.is_clear == (result.log_odds < -math.log(100.0))


def test_contact_with_a_terminated_track_is_dropped():
    settings = settings_with()
    track, body = tracked_person(settings, TrackState.ACTIVE)
    track.name = NAMES[0]
    reference: dict[tuple[str, str], Contact] = {NAMES: Contact(NAMES, 1.0, 0.0)}
    visible = np.zeros((1, len(settings.rig)), dtype=bool)
    update_contacts(reference, [track], body, outcome_of(visible, visible, 10.0, 0.04), settings.options.identity_audit)
    assert audit_identities(reference, [track], body, 10.0, settings) == []


@pytest.mark.parametrize("others", [0, 2])
def test_contacts_exist_only_for_people_who_were_close(others):
    """Other people far away do not matter."""
    settings = settings_with()
    tracks, bodies = zip(*(tracked_person(settings, TrackState.ACTIVE) for _ in range(2 + others)), strict=True)
    state = bodies[0]
    for k, (track, body) in enumerate(zip(tracks, bodies, strict=True)):
        track.name = f"person_{k + 1}"
        state = join_states(state, body) if k else body
    visible, reference = np.ones((len(tracks), len(settings.rig)), dtype=bool), {}
    alone = visible.copy()
    alone[0] = False
    for t, (apart_m, shown) in enumerate([(2.0, visible), (0.3, alone), (0.3, alone), (2.0, visible)]):
        state.root[:] = 10.0 * np.arange(len(tracks))[:, None]
        state.root[1] = state.root[0] + [apart_m, 0.0, 0.0]
        outcome = outcome_of(shown, visible, float(t), 0.1)
        update_contacts(reference, list(tracks), state, outcome, settings.options.identity_audit)
    assert list(reference) == [NAMES]
    assert reference[NAMES].merged_s == pytest.approx(0.2)
    assert reference[NAMES].separated_at_s == 3.0


def test_contacts_are_stored_under_ordered_names():
    pairs = [ordered_pair("b", "a"), ordered_pair("a", "c"), ordered_pair("c", "d")]
    assert pairs == [("a", "b"), ("a", "c"), ("c", "d")]
    reference = {pair: Contact(pair) for pair in pairs}
    drop_contacts(reference, ("d", "b"))
    assert list(reference) == [("a", "c")]


def places_exchanged(statures_m: tuple[float, float]) -> CrowdScene:
    """Return two people who meet and exchange places while all views show only the first of them.

    They are 0.3 m apart from 4.5 s to 5.3 s, exchange places at 4.8 s, and separate. The second person is not
    detected from 4.7 s to 4.95 s.
    """
    skeleton, rate_hz, duration_s = shipped_skeleton("body_20"), 25.0, 8.0
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    distance_m = (np.array([0.0, 2.5, 4.5, 5.3, 7.0, duration_s]), np.array([2.0, 2.0, 0.3, 0.3, 2.0, 2.0]))
    bearing = (np.array([0.0, duration_s]), np.array([0.3, 0.3]))
    walks = meet(distance_m, bearing, (20.0, 21.0), (0.0, 20.0), duration_s)
    figures = [human(stature_m) for stature_m in statures_m]
    before, after = (
        np.stack(
            [
                walk.positions(figure, time_s)[:, figure.columns(skeleton)]
                for walk, figure in zip(w, figures, strict=True)
            ],
            axis=1,
        )
        for w in (walks, walks[::-1])
    )
    points = np.where(time_s[:, None, None, None] < 4.8, before, after)
    scene = crowd_of_points(points, build_rig("ring", 5), skeleton, rate_hz, detector=CLEAN, faults=NO_FAULTS)
    shown_s = time_s[frames_and_views(scene.detections)[0]]
    visible = (scene.owner == 0) | (shown_s < 4.7) | (shown_s >= 4.95)
    return replace(scene, detections=select_rows(scene.detections, visible))


def owners(people: People, truth_m: np.ndarray) -> dict[str, int]:
    """Return the true person of each active track."""
    return {
        name: int(np.linalg.norm(truth_m - person.points_m, axis=-1).mean(axis=-1).argmin())
        for name, person in active_people(people).items()
    }


def test_stage_restores_identities_by_bone_lengths():
    """Without the stage the names stay at the places, so that they are those of the wrong people."""
    scene = places_exchanged((1.8, 1.65))
    truth = true_points_m(scene)
    on, off = run_without(scene), run_without(scene, "identity_audit")
    before = owners(on[50], truth[50])
    assert owners(off[50], truth[50]) == before
    assert owners(on[-1], truth[-1]) == before
    assert owners(off[-1], truth[-1]) == {name: 1 - owner for name, owner in before.items()}
    assert [event.what for event in events_of(on)] == ["confirmed", "confirmed", "identities_swapped"]
    assert [event.what for event in events_of(off)] == ["confirmed", "confirmed"]


def test_stage_reports_people_whom_bone_lengths_do_not_distinguish():
    scene = places_exchanged((1.74, 1.74))
    on, off = run_without(scene), run_without(scene, "identity_audit")
    assert [event.what for event in events_of(on)] == ["confirmed", "confirmed", "possible_identity_switch"]
    assert [event.what for event in events_of(off)] == ["confirmed", "confirmed"]


def test_stage_does_not_change_people_who_stay_apart():
    scene = clean_scene(people=2, duration_s=3.0)
    points = true_points_m(scene)
    assert np.nanmin(np.linalg.norm((points[:, 0] - points[:, 1]).mean(axis=1), axis=-1)) > 0.7
    assert_equal_results(run_without(scene), run_without(scene, "identity_audit"))
