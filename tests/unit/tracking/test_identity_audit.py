"""Audit of identities by bone lengths after close contact."""

import math
from collections import deque

import numpy as np
import pytest

from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import join_states
from posefuse.tracking.identity_audit import AuditResult, Contact, audit_identities, update_contacts
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import FrameOutcome
from tests.unit.tracking.test_lifecycle import tracked_person
from tests.unit.tracking.test_track_initiation import settings_with, standing_still

NAMES = ("person_1", "person_2")
APART_S = 1.3
TIMES_S = np.arange(0.0, APART_S, 0.04)


def outcome_of(supported: np.ndarray, expected: np.ndarray, time_s: float, dt_s: float) -> FrameOutcome:
    """Return the outcome of a frame of which only the views matter."""
    nothing = np.empty(0)
    frame = Frame(np.empty((0, 1, 2)), np.empty((0, 1)), nothing, nothing, nothing, nothing)
    return FrameOutcome(frame, time_s, dt_s, nothing, nothing, nothing, supported, expected)


def found(settings: TrackerSettings, known: tuple[float, float], shown: tuple[float, float]) -> AuditResult:
    """Return the audit of two people with known sizes and others observed since."""
    tracks, bodies = zip(*(tracked_person(settings, TrackState.ACTIVE) for _ in NAMES), strict=True)
    for track, name, size in zip(tracks, NAMES, known, strict=True):
        track.name, track.shape_observed_s = name, settings.options.fix_shape_after_s
        track.known_shape = size * settings.tree.shape_m, np.diag((0.005 + 0.0 * settings.tree.shape_m) ** 2)
    contact = Contact(NAMES, 1.0, 0.0)
    for name, size in zip(NAMES, shown, strict=True):
        contact.observations[name] = deque(standing_still(settings, TIMES_S, size))
    return audit_identities({NAMES: contact}, list(tracks), join_states(*bodies), APART_S, settings)[0]


def test_different_bodies_are_distinguished():
    settings = settings_with()
    straight = found(settings, (1.06, 0.98), (1.06, 0.98))
    crossed = found(settings, (1.06, 0.98), (0.98, 1.06))
    assert (straight.swap, straight.is_clear) == (False, True)
    assert (crossed.swap, crossed.is_clear) == (True, True)
    assert crossed.log_odds == pytest.approx(-straight.log_odds)


@pytest.mark.parametrize("shown", [(1.0, 1.0), (1.06, 0.98)])
def test_equal_bodies_are_not_distinguished(shown):
    finding = found(settings_with(), (1.02, 1.02), shown)
    assert finding.log_odds == pytest.approx(0.0, abs=1e-9)
    assert (finding.swap, finding.is_clear) == (False, False)


@pytest.mark.parametrize("larger", [0.01, 0.02, 0.03, 0.04, 0.06])
def test_identities_are_swapped_only_above_the_odds_threshold(larger):
    """The threshold is a likelihood ratio, which bounds the rate of errors."""
    finding = found(settings_with(), (1.0 + larger, 1.0), (1.0, 1.0 + larger))
    assert finding.log_odds < 0.0
    assert finding.swap == finding.is_clear == (finding.log_odds < -math.log(100.0))


def test_contact_with_a_terminated_track_is_dropped():
    settings = settings_with()
    track, body = tracked_person(settings, TrackState.ACTIVE)
    track.name = NAMES[0]
    known: dict[tuple[str, str], Contact] = {NAMES: Contact(NAMES, 1.0, 0.0)}
    seen = np.zeros((1, len(settings.rig)), dtype=bool)
    update_contacts(known, [track], body, outcome_of(seen, seen, 10.0, 0.04), settings.options.identity_audit)
    assert audit_identities(known, [track], body, 10.0, settings) == []


@pytest.mark.parametrize("others", [0, 2])
def test_contacts_exist_only_for_people_who_were_close(others):
    """Other people far away do not matter."""
    settings = settings_with()
    tracks, bodies = zip(*(tracked_person(settings, TrackState.ACTIVE) for _ in range(2 + others)), strict=True)
    state = bodies[0]
    for k, (track, body) in enumerate(zip(tracks, bodies, strict=True)):
        track.name = f"person_{k + 1}"
        state = join_states(state, body) if k else body
    seen, known = np.ones((len(tracks), len(settings.rig)), dtype=bool), {}
    alone = seen.copy()
    alone[0] = False
    for t, (apart_m, shown) in enumerate([(2.0, seen), (0.3, alone), (0.3, alone), (2.0, seen)]):
        state.root[:] = 10.0 * np.arange(len(tracks))[:, None]
        state.root[1] = state.root[0] + [apart_m, 0.0, 0.0]
        outcome = outcome_of(shown, seen, float(t), 0.1)
        update_contacts(known, list(tracks), state, outcome, settings.options.identity_audit)
    assert list(known) == [NAMES]
    assert known[NAMES].merged_s == pytest.approx(0.2)
    assert known[NAMES].separated_at_s == 3.0
