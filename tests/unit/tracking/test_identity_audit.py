"""After two people were too near to be told from each other: who is who, by their bones, and how sure that is."""

import math
from collections import deque

import numpy as np
import pytest

from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import joined
from posefuse.tracking.identity_audit import Contact, Finding, audit, contacts
from posefuse.tracking.settings import Settings
from tests.unit.tracking.test_forgetting import somebody
from tests.unit.tracking.test_track_initiation import settings_with, standing_still

NAMES = ("person_1", "person_2")
APART_S = 1.3
TIMES_S = np.arange(0.0, APART_S, 0.04)


def found(settings: Settings, known: tuple[float, float], shown: tuple[float, float]) -> Finding:
    """Of two whose sizes were known, and who have shown others since."""
    tracks, bodies = zip(*(somebody(settings, TrackState.ACTIVE) for _ in NAMES), strict=True)
    for track, name, size in zip(tracks, NAMES, known, strict=True):
        track.name, track.sought_s = name, settings.options.shape_settle_s
        track.trusted = size * settings.tree.shape_m, np.diag((0.005 + 0.0 * settings.tree.shape_m) ** 2)
    contact = Contact(NAMES, 1.0, 0.0)
    for name, size in zip(NAMES, shown, strict=True):
        contact.shown[name] = deque(standing_still(settings, TIMES_S, size))
    return audit({NAMES: contact}, list(tracks), joined(*bodies), APART_S, settings)[0]


def test_who_differ_are_told_from_each_other():
    settings = settings_with()
    straight = found(settings, (1.06, 0.98), (1.06, 0.98))
    crossed = found(settings, (1.06, 0.98), (0.98, 1.06))
    assert (straight.exchange, straight.clear) == (False, True)
    assert (crossed.exchange, crossed.clear) == (True, True)
    assert crossed.odds == pytest.approx(-straight.odds)


@pytest.mark.parametrize("shown", [(1.0, 1.0), (1.06, 0.98)])
def test_equal_bodies_are_not(shown):
    finding = found(settings_with(), (1.02, 1.02), shown)
    assert finding.odds == pytest.approx(0.0, abs=1e-9)
    assert (finding.exchange, finding.clear) == (False, False)


@pytest.mark.parametrize("larger", [0.01, 0.02, 0.03, 0.04, 0.06])
def test_nobody_goes_on_as_somebody_else_but_by_a_hundred_to_one(larger):
    """The likelihood ratio is one, so that this is how often it is wrong."""
    finding = found(settings_with(), (1.0 + larger, 1.0), (1.0, 1.0 + larger))
    assert finding.odds < 0.0
    assert finding.exchange == finding.clear == (finding.odds < -math.log(100.0))


def test_of_somebody_forgotten_nothing_is_found_even_where_only_one_is_left():
    settings = settings_with()
    track, body = somebody(settings, TrackState.ACTIVE)
    track.name = NAMES[0]
    known: dict[tuple[str, str], Contact] = {NAMES: Contact(NAMES, 1.0, 0.0)}
    seen = np.zeros((1, len(settings.rig)), dtype=bool)
    contacts(known, [track], body, seen, seen, 10.0, 0.04, settings.tree.scale)
    assert audit(known, [track], body, 10.0, settings) == []


@pytest.mark.parametrize("others", [0, 2])
def test_only_who_are_or_were_near_are_known_together(others):
    """Whoever else is there, far away."""
    settings = settings_with()
    tracks, bodies = zip(*(somebody(settings, TrackState.ACTIVE) for _ in range(2 + others)), strict=True)
    state = bodies[0]
    for k, (track, body) in enumerate(zip(tracks, bodies, strict=True)):
        track.name = f"person_{k + 1}"
        state = joined(state, body) if k else body
    seen, known = np.ones((len(tracks), len(settings.rig)), dtype=bool), {}
    alone = seen.copy()
    alone[0] = False
    for t, (apart_m, shown) in enumerate([(2.0, seen), (0.3, alone), (0.3, alone), (2.0, seen)]):
        state.root[:] = 10.0 * np.arange(len(tracks))[:, None]
        state.root[1] = state.root[0] + [apart_m, 0.0, 0.0]
        contacts(known, list(tracks), state, shown, seen, float(t), 0.1, settings.tree.scale)
    assert list(known) == [NAMES]
    assert known[NAMES].mixed_s == pytest.approx(0.2)
    assert known[NAMES].apart_s == 3.0
