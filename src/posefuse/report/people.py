"""Several people over time, as the report shows them: life lines, numbers, and which cameras missed whom."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from posefuse.evaluation.sightings import Misses
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.track_events import HAPPENINGS, Event
from posefuse.model.tracks import TrackState

_MOST_HOVER = 400
"""Events beyond are marked without their reasons, lest the page grows without bound."""


@dataclass(frozen=True)
class Life:
    """How one person fared.

    Attributes:
        name: of the person.
        first: place of the first frame in which they are not absent; -1 if there is none.
        last: place of the last.
        frames: state to how many frames.
        has_point: share of the keypoints that have coordinates, while active.
        error_px: median reprojection error of their points, NaN where there is none.
        n_views: mean number of views that show them, while active.
    """

    name: str
    first: int
    last: int
    frames: dict[TrackState, int]
    has_point: float
    error_px: float
    n_views: float


def lives(parts: Iterable[Reconstruction], layer: LayerName) -> tuple[Life, ...]:
    """How everybody fared, from consecutive ranges of frames; nobody where nothing was tracked."""
    states, points, errors, views = [], [], [], []
    names: tuple[str, ...] = ()
    for part in parts:
        if part.tracks is None:
            return ()
        names = part.person_ids
        states.append(np.asarray(part.tracks.state[:]))
        points.append(part.layers[layer].has_point.mean(axis=-1))
        errors.append(np.asarray(part.layers[layer].reprojection_error_px[:]).astype(np.float32))
        views.append((np.asarray(part.tracks.detection[:]) >= 0).sum(axis=-1))
    state, share, error, seen = (np.concatenate(each) for each in (states, points, errors, views))
    return tuple(_life(name, state[:, p], share[:, p], error[:, p], seen[:, p]) for p, name in enumerate(names))


def _life(name: str, state: np.ndarray, share: np.ndarray, error: np.ndarray, seen: np.ndarray) -> Life:
    there = np.flatnonzero(state != TrackState.ABSENT)
    active = state == TrackState.ACTIVE
    known = error[np.isfinite(error)]
    return Life(
        name=name,
        first=int(there[0]) if len(there) else -1,
        last=int(there[-1]) if len(there) else -1,
        frames={each: int((state == each).sum()) for each in TrackState},
        has_point=float(share[active].mean()) if active.any() else float("nan"),
        error_px=float(np.median(known)) if len(known) else float("nan"),
        n_views=float(seen[active].mean()) if active.any() else float("nan"),
    )


def life_lines(result: Reconstruction) -> dict[str, Any] | None:
    """What the picture of life lines is drawn from, or None where nobody comes or goes.

    Returns:
        Names; for each person, runs of (state, place of the first frame, place after the last); events with the place
        of their frame and of their person, or of a row of their own for a camera; and the frames' times in s, or
        numbers where a time is unknown, and which of the two.
    """
    if result.tracks is None or (len(result.person_ids) == 1 and not result.events):
        return None
    state = np.asarray(result.tracks.state[:])
    timed = bool(np.isfinite(result.time_s).all())
    others = list(dict.fromkeys(event.person for event in result.events if event.person not in result.person_ids))
    rows = [*result.person_ids, *others]
    when = result.time_s if timed else result.frame_numbers
    step = float(np.median(np.diff(when))) if len(when) > 1 else 1.0
    places = {int(number): place for place, number in enumerate(result.frame_numbers)}
    events = [event for event in result.events if event.number in places]
    return {
        "rows": rows,
        "people": len(result.person_ids),
        "runs": [[[TrackState(s).name.lower(), a, b] for s, a, b in _runs(column)] for column in state.T],
        "events": [
            [
                places[event.number],
                rows.index(event.person),
                event.what,
                event.why if i < _MOST_HOVER else "",
                event.number,
            ]
            for i, event in enumerate(events)
        ],
        "time": np.round(np.append(when, when[-1] + step), 3).tolist(),
        "unit": "s" if timed else "frame",
    }


def events_in_words(events: Sequence[Event]) -> str:
    """How many events of each kind there are, in the order of their kinds."""
    counts = {kind: sum(event.what == kind for event in events) for kind in HAPPENINGS}
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)


def _runs(state: np.ndarray) -> list[tuple[int, int, int]]:
    """Stretches of one state, but for absence: (state, place of the first frame, place after the last)."""
    cuts = np.flatnonzero(np.diff(state)) + 1
    starts, stops = [0, *cuts.tolist()], [*cuts.tolist(), len(state)]
    return [(int(state[a]), a, b) for a, b in zip(starts, stops, strict=True) if state[a] != TrackState.ABSENT]


def people_section(result: Reconstruction, everybody: Sequence[Life], misses: Misses | None) -> str:
    """The report's section on people; empty for one person to whom nothing happens."""
    if result.tracks is None or (len(result.person_ids) == 1 and not result.events):
        return ""
    if not result.person_ids:
        return "<section><h2>People</h2><p>Nobody was found.</p></section>"
    marks = "" if not result.events else " Marks are events: point at one to read why, click to see the frame."
    return (
        "<section><h2>People over time</h2><p>A line a person: thick while active, thin while tentative, dotted while "
        f"lost.{marks}</p>"
        '<div id="lives" role="img" aria-label="When each person was tentative, active and lost"></div>'
        f'<div class="wide">{_people_table(result, everybody)}</div>{_COLUMNS}{_misses_table(result, misses)}</section>'
    )


_COLUMNS = (
    '<p class="hint">Active, tentative, lost: shares of the time from first to last. Points: the share of a person\'s '
    "keypoints that have coordinates, while active. Cameras: how many show them on average, while active. Median px: "
    "of the distances between their detections and their projected points.</p>"
)


def span_of(result: Reconstruction, life: Life) -> tuple[str, str]:
    """When a person is first and last there: seconds, or frame numbers where times are unknown; dashes for never."""
    if life.first < 0:
        return "–", "–"
    times = result.time_s[[life.first, life.last]]
    if np.isfinite(times).all():
        return f"{times[0]:.2f}", f"{times[1]:.2f}"
    numbers = result.frame_numbers[[life.first, life.last]]
    return str(int(numbers[0])), str(int(numbers[1]))


def _people_table(result: Reconstruction, everybody: Sequence[Life]) -> str:
    unit = "s" if np.isfinite(result.time_s).all() else "frame"
    head = ("", "Person", f"From {unit}", f"To {unit}", "Active", "Tentative", "Lost", "Points", "Cameras", "Median px")
    rows = []
    for p, life in enumerate(everybody):
        span = max(life.last - life.first + 1, 1)
        shares = [f"{100 * life.frames[state] / span:.1f} %" for state in _SHOWN]
        cells = (
            life.name,
            *span_of(result, life),
            *shares,
            _percent(life.has_point),
            f"{life.n_views:.1f}" if np.isfinite(life.n_views) else "–",
            f"{life.error_px:.1f}" if np.isfinite(life.error_px) else "–",
        )
        chip = f'<td><span class="chip person-{p % 10}"></span></td>'
        rows.append(f"<tr>{chip}" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return f'<table class="people"><tr>{_heads(head)}</tr>{"".join(rows)}</table>'


_SHOWN = (TrackState.ACTIVE, TrackState.TENTATIVE, TrackState.LOST)


def _misses_table(result: Reconstruction, misses: Misses | None) -> str:
    if misses is None or not misses.expected.any():
        return ""
    share = misses.share
    every = [_ratio(misses.missed[p], misses.expected[p]) for p in range(len(share))]
    rows = [_misses_row(name, [*share[p], every[p]]) for p, name in enumerate(result.person_ids)]
    by_view = [_ratio(misses.missed[:, v], misses.expected[:, v]) for v in range(share.shape[1])]
    rows.append(_misses_row("all", [*by_view, _ratio(misses.missed, misses.expected)]))
    return (
        "<h3>Missed</h3><p>Share of the frames in which a camera should see an active person, at least half of them "
        "within its image, and shows no detection that was theirs; people who are hidden count too. A dash: it never "
        "should.</p>"
        f'<div class="wide"><table class="heat"><tr>{_heads(("Person", *result.rig.names, "all"))}</tr>{"".join(rows)}'
        "</table></div>"
    )


def _misses_row(name: str, shares: Sequence[float]) -> str:
    cells = "".join(
        f'<td style="--heat: {0 if np.isnan(share) else round(100 * min(share, 1))}%">{_percent(share)}</td>'
        for share in shares
    )
    return f"<tr><th>{escape(name)}</th>{cells}</tr>"


def _ratio(some: np.ndarray, of: np.ndarray) -> float:
    return float(some.sum() / of.sum()) if of.sum() else float("nan")


def _heads(names: Iterable[str]) -> str:
    return "".join(f"<th>{escape(name)}</th>" for name in names)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"
