"""Two people who could not be told from each other for a while: afterwards, who is who, by their bones.

While people hold each other, detections come of both, and a track may go on with either. When they are apart again, a
body is fitted to what each has shown since, from scratch, and its lengths are compared with those known from before.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.tracking.records import Evidence, Track
from posefuse.tracking.reidentification import same_body
from posefuse.tracking.settings import Settings
from posefuse.tracking.state_initiation import begin

_NEAR_M, _APART_M = 0.6, 0.9
_MIXED_S = 0.15
_LOOK_S = 1.2
_MOST_LOOK_S = 3.0
_FRAMES, _FEWEST = 12, 4
_EVERY_S = 0.03
_FRAMES_KEPT = 100
_CLEAR = 4.6
"""A hundred to one: movement had it otherwise, and it is not taken back."""


@dataclass
class Contact:
    """Two people who are or were so near that they can be taken for each other.

    Attributes:
        names: theirs.
        mixed_s: for how long detections came of only one of them where both were to be seen.
        apart_s: since when they are apart, NaN while they are not.
        shown: by name, what each has shown since.
    """

    names: tuple[str, str]
    mixed_s: float = 0.0
    apart_s: float = np.nan
    shown: dict[str, deque[Evidence]] = field(default_factory=dict)


@dataclass(frozen=True)
class Finding:
    """What an audit came to.

    Attributes:
        names: of the two.
        exchange: whether each goes on as the other.
        clear: whether that is sure.
        odds: the log odds that they are who they were taken for.
        since_s: since when they are apart.
    """

    names: tuple[str, str]
    exchange: bool
    clear: bool
    odds: float
    since_s: float


def contacts(
    known: dict[tuple[str, str], Contact],
    tracks: list[Track],
    state: State,
    supported: np.ndarray,
    expected: np.ndarray,
    time_s: float,
    dt_s: float,
    scale: float,
) -> None:
    """See who is near whom, and for how long views have shown only one of the two.

    Args:
        known: in and out, by names.
        tracks: of everybody.
        state: theirs.
        supported: shape (person, view), bool.
        expected: shape (person, view), bool.
        time_s: of the frame.
        dt_s: since the last.
        scale: how large bodies are next to an adult human.
    """
    place = {track.name: p for p, track in enumerate(tracks)}
    for pair in [pair for pair in known if not place.keys() >= set(pair)]:
        del known[pair]
    if len(tracks) < 2:
        return
    # Of most pairs there is nothing to say: they are not near, and have not been.
    told = {(place[first], place[second]) for first, second in known}
    for (p, one), (q, other) in combinations(enumerate(state.root.tolist()), 2):
        away_m = math.dist(one, other) / scale
        if away_m < _NEAR_M or (p, q) in told or (q, p) in told:
            pair = pair_of(tracks[p].name, tracks[q].name)
            both = expected[p] & expected[q]
            mixed = 2 * (both & (supported[p] != supported[q])).sum() > both.sum()
            _note(known, pair, away_m, dt_s if mixed else 0.0, time_s)


def _note(
    known: dict[tuple[str, str], Contact], pair: tuple[str, str], away_m: float, mixed_s: float, time_s: float
) -> None:
    """Note how far apart two people are, and for how long views of this frame showed only one of them."""
    contact = known.get(pair)
    if away_m < _NEAR_M:
        contact = known.setdefault(pair, Contact(pair))
        contact.mixed_s += mixed_s
        contact.apart_s = np.nan
        contact.shown.clear()
    elif contact is not None and away_m > _APART_M and np.isnan(contact.apart_s):
        contact.apart_s = time_s
        if contact.mixed_s < _MIXED_S:
            del known[pair]


def pair_of(first: str, second: str) -> tuple[str, str]:
    """How two people are known together, whichever comes first."""
    return (first, second) if first < second else (second, first)


def forget(known: dict[tuple[str, str], Contact], names: tuple[str, str]) -> None:
    """What either of two people, who are now called otherwise, has shown with others was not theirs."""
    for pair in [pair for pair in known if set(pair) & set(names)]:
        del known[pair]


def remember(known: dict[tuple[str, str], Contact], name: str, shown: Evidence) -> None:
    """Keep what somebody has shown since they are apart from somebody."""
    for contact in known.values():
        if name in contact.names and np.isfinite(contact.apart_s):
            kept = contact.shown.setdefault(name, deque(maxlen=_FRAMES_KEPT))
            # Frames that follow each other at once err alike.
            if not kept or shown.time_s - kept[-1].time_s > _EVERY_S:
                kept.append(shown)


def audit(
    known: dict[tuple[str, str], Contact], tracks: list[Track], state: State, time_s: float, settings: Settings
) -> list[Finding]:
    """Decide of those who have been apart for long enough; they are then known no more.

    Args:
        known: in and out.
        tracks: of everybody.
        state: theirs.
        time_s: of the frame.
        settings: of the tracker.
    """
    found = []
    place = {track.name: p for p, track in enumerate(tracks)}
    for pair, contact in list(known.items()):
        if not time_s - contact.apart_s > _LOOK_S:
            continue
        frames, late = min(len(contact.shown.get(name, ())) for name in pair), time_s - contact.apart_s > _MOST_LOOK_S
        if frames < _FRAMES and not late:
            continue
        del known[pair]
        if frames < _FEWEST:
            found.append(Finding(pair, exchange=False, clear=False, odds=0.0, since_s=contact.apart_s))
            continue
        fresh = [begin(_some(contact.shown[name]), settings)[0] for name in pair]
        p, q = (place[name] for name in pair)
        straight = _likeness(tracks, state, p, fresh[0], settings) + _likeness(tracks, state, q, fresh[1], settings)
        crossed = _likeness(tracks, state, p, fresh[1], settings) + _likeness(tracks, state, q, fresh[0], settings)
        odds = straight - crossed
        found.append(Finding(pair, odds < -_CLEAR, abs(odds) > _CLEAR, odds, contact.apart_s))
    return found


def _some(shown: deque[Evidence]) -> list[Evidence]:
    """So many frames, evenly spread: their errors have less in common."""
    return [shown[int(i)] for i in np.linspace(0, len(shown) - 1, min(len(shown), _FRAMES))]


def _likeness(tracks: list[Track], state: State, p: int, fresh: State, settings: Settings) -> float:
    return same_body(settings, tracks[p], state, p, fresh, _LOOK_S)
