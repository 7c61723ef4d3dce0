"""Report section on several people: track states, statistics, and missed detections by person and camera."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from posefuse.evaluation.visibility import Misses
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.track_events import EVENT_KINDS, Event
from posefuse.model.tracks import TrackState
from posefuse.report.summary import Summary
from posefuse.skeleton.subject_words import subject_heading, subject_words

_MAX_EXPLAINED_EVENTS = 400
"""Only this many events carry their reasons, which limits the size of the page."""


@dataclass(frozen=True)
class PersonSummary:
    """Statistics of one person.

    Attributes:
        name: name of the person.
        first: index of the first frame in which the person is not absent; -1 if there is none.
        last: index of the last such frame; -1 if there is none.
        frames: number of frames in each track state.
        has_point: share of keypoints with coordinates while active.
        n_views: mean number of views with a detection of the person while active.
    """

    name: str
    first: int
    last: int
    frames: dict[TrackState, int]
    has_point: float
    n_views: float


def summarize_people(parts: Iterable[Reconstruction], layer: LayerName) -> tuple[PersonSummary, ...]:
    """Return the statistics of each person from consecutive ranges of frames; empty for a result without tracks."""
    states, points, views = [], [], []
    names: tuple[str, ...] = ()
    for part in parts:
        if part.tracks is None:
            return ()
        names = part.person_ids
        states.append(np.asarray(part.tracks.state[:]))
        points.append(part.layers[layer].has_point.mean(axis=-1))
        views.append((np.asarray(part.tracks.detection[:]) >= 0).sum(axis=-1))
    state, share, n_views = (np.concatenate(each) for each in (states, points, views))
    return tuple(_summarize_person(name, state[:, p], share[:, p], n_views[:, p]) for p, name in enumerate(names))


def _summarize_person(name: str, state: np.ndarray, share: np.ndarray, n_views: np.ndarray) -> PersonSummary:
    present = np.flatnonzero(state != TrackState.ABSENT)
    active = state == TrackState.ACTIVE
    return PersonSummary(
        name=name,
        first=int(present[0]) if len(present) else -1,
        last=int(present[-1]) if len(present) else -1,
        frames={each: int((state == each).sum()) for each in TrackState},
        has_point=float(share[active].mean()) if active.any() else float("nan"),
        n_views=float(n_views[active].mean()) if active.any() else float("nan"),
    )


def people_per_frame(result: Reconstruction) -> str:
    """Return a sentence on the number of people in unrelated frames."""
    assert result.tracks is not None
    numbers = (np.asarray(result.tracks.state[:]) != TrackState.ABSENT).sum(axis=1)
    return (
        f"{numbers.sum()} people in {(numbers > 0).sum()} of {result.n_frames} frames, at most "
        f"{numbers.max(initial=0)} in one frame"
    )


def track_timeline(result: Reconstruction) -> dict[str, Any] | None:
    """Return the data of the track state chart, or None for a single person without events.

    Returns:
        Names of the rows (people, then cameras with events); for each person, runs of (state, first frame index, frame
        index after the last one); events as (frame index, row, kind, reason, frame number); and the times of the frames
        in s, or their numbers if a time is unknown, with the unit.
    """
    if result.tracks is None or not result.has_identities or (len(result.person_ids) == 1 and not result.events):
        return None
    state = np.asarray(result.tracks.state[:])
    timed = bool(np.isfinite(result.time_s).all())
    others = list(dict.fromkeys(event.person for event in result.events if event.person not in result.person_ids))
    rows = [*result.person_ids, *others]
    times = result.time_s if timed else result.frame_numbers
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    indices = {int(number): index for index, number in enumerate(result.frame_numbers)}
    events = [event for event in result.events if event.number in indices]
    return {
        "rows": rows,
        "people": len(result.person_ids),
        "runs": [[[TrackState(s).name.lower(), a, b] for s, a, b in _runs(column)] for column in state.T],
        "events": [
            [
                indices[event.number],
                rows.index(event.person),
                event.what,
                event.why if i < _MAX_EXPLAINED_EVENTS else "",
                event.number,
            ]
            for i, event in enumerate(events)
        ],
        "time": np.round(np.append(times, times[-1] + step), 3).tolist(),
        "unit": "s" if timed else "frame",
    }


def format_event_counts(events: Sequence[Event]) -> str:
    """Return the number of events of each kind, in the order of the kinds."""
    counts = {kind: sum(event.what == kind for event in events) for kind in EVENT_KINDS}
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)


def _runs(state: np.ndarray) -> list[tuple[int, int, int]]:
    """Return the runs of equal states except absence: (state, first frame index, frame index after the last one)."""
    cuts = np.flatnonzero(np.diff(state)) + 1
    starts, stops = [0, *cuts.tolist()], [*cuts.tolist(), len(state)]
    return [(int(state[a]), a, b) for a, b in zip(starts, stops, strict=True) if state[a] != TrackState.ABSENT]


def people_section(
    result: Reconstruction, summary: Summary, people: Sequence[PersonSummary], misses: Misses | None
) -> str:
    """Return the section as HTML; empty for a single person without events."""
    if result.tracks is None or (len(result.person_ids) == 1 and not result.events):
        return ""
    one, several = subject_words(result.skeleton)
    title = several.capitalize()
    if not result.person_ids:
        return f"<section><h2>{title}</h2><p>No {one} was found.</p></section>"
    if not result.has_identities:
        text = f"Frames are unrelated: numbers of {several} are not identities. {people_per_frame(result)}."
        return f"<section><h2>{title}</h2><p>{text}</p></section>"
    hint = (
        "" if not result.events else " Markers are events: hover over one to see its reason, click it to see its frame."
    )
    return (
        f"<section><h2>{title} over time</h2><p>One line per {one}: thick while active, thin while tentative, dotted "
        f"while lost.{hint}</p>"
        '<div id="track-states" role="img" aria-label="When each subject was tentative, active and lost"></div>'
        f'<div class="wide">{_people_table(result, summary, people)}</div>'
        f"{_COLUMN_NOTES}{_misses_table(result, misses)}"
        "</section>"
    )


_COLUMN_NOTES = (
    '<p class="hint">Active, Tentative, Lost: share of the frames between From and To. Points: share of the subject\'s '
    "keypoints with coordinates while active. Cameras: mean number of cameras with a detection of the subject "
    "while active. Median error: reprojection error of the subject's used detections, as by camera.</p>"
)


def presence_interval(result: Reconstruction, person: PersonSummary) -> tuple[str, str]:
    """Return when a person is first and last present, in s or frame numbers if times are unknown; dashes for never."""
    if person.first < 0:
        return "–", "–"
    times = result.time_s[[person.first, person.last]]
    if np.isfinite(times).all():
        return f"{times[0]:.2f}", f"{times[1]:.2f}"
    numbers = result.frame_numbers[[person.first, person.last]]
    return str(int(numbers[0])), str(int(numbers[1]))


def _people_table(result: Reconstruction, summary: Summary, people: Sequence[PersonSummary]) -> str:
    unit = "s" if np.isfinite(result.time_s).all() else "frame"
    headings = (
        "Color", subject_heading(result.skeleton), f"From, {unit}", f"To, {unit}", "Active", "Tentative", "Lost",
        "Points", "Cameras", "Median error, px",
    )  # fmt: skip
    rows = []
    for p, person in enumerate(people):
        error_px = summary.error_px_by_person[p].median
        n_frames = max(person.last - person.first + 1, 1)
        shares = [f"{100 * person.frames[state] / n_frames:.1f} %" for state in _LISTED_STATES]
        cells = (
            person.name,
            *presence_interval(result, person),
            *shares,
            _percent(person.has_point),
            f"{person.n_views:.1f}" if np.isfinite(person.n_views) else "–",
            f"{error_px:.2f}" if np.isfinite(error_px) else "–",
        )
        chip = f'<td><span class="chip person-{p % 10}"></span></td>'
        rows.append(f"<tr>{chip}" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return f'<table class="people"><tr>{_headings(headings)}</tr>{"".join(rows)}</table>'


_LISTED_STATES = (TrackState.ACTIVE, TrackState.TENTATIVE, TrackState.LOST)


def _misses_table(result: Reconstruction, misses: Misses | None) -> str:
    if misses is None or not misses.expected.any():
        return ""
    share = misses.share
    totals = [_ratio(misses.missed[p], misses.expected[p]) for p in range(len(share))]
    rows = [_misses_row(name, [*share[p], totals[p]]) for p, name in enumerate(result.person_ids)]
    by_view = [_ratio(misses.missed[:, v], misses.expected[:, v]) for v in range(share.shape[1])]
    rows.append(_misses_row("all", [*by_view, _ratio(misses.missed, misses.expected)]))
    head = _headings((subject_heading(result.skeleton), *result.rig.names, "all"))
    return (
        "<h3>Missed detections</h3><p>Share of frames without an assigned detection, among the frames in which an "
        "active subject is in the camera's image (at least half of the core keypoints). Occluded subjects count as "
        "missed. A dash means that the subject was never in the image.</p>"
        f'<div class="wide"><table class="heat"><tr>{head}</tr>'
        f"{''.join(rows)}</table></div>"
    )


def _misses_row(name: str, shares: Sequence[float]) -> str:
    cells = "".join(
        f'<td style="--heat: {0 if np.isnan(share) else round(100 * min(share, 1))}%">{_percent(share)}</td>'
        for share in shares
    )
    return f"<tr><th>{escape(name)}</th>{cells}</tr>"


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> float:
    return float(numerator.sum() / denominator.sum()) if denominator.sum() else float("nan")


def _headings(names: Iterable[str]) -> str:
    return "".join(f"<th>{escape(name)}</th>" for name in names)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"
