"""Print a summary of a result."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from posefuse.cli.console import count, detail, note, notes, percent, say, table, warn
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.subject_words import subject_words

if TYPE_CHECKING:
    from posefuse.report.summary import Summary

_MOST_ROWS, _MOST_EVENTS, _MOST_GAITS, _MOST_REMARKS = 4, 2, 2, 2
_MAJOR_EVENTS = ("possible_identity_switch", "camera_rejected", "camera_silent")


def layer_remark(files: Sequence[str], layer: LayerName, also: Sequence[str] = ()) -> str:
    """Return which of the written formats contain a single layer, and which layer; empty without any.

    Args:
        files: names of the written files.
        layer: layer in them.
        also: names of other formats that were requested.
    """
    from posefuse.io.results.write import additional_names

    single = [name for name, ending in (("TRC", ".trc"), ("C3D", ".c3d")) if any(f.endswith(ending) for f in files)]
    offered = additional_names() if also else {}
    stems = tuple(Path(offered[name]).stem for name in also)
    if any(file.startswith(stems) for file in files):
        single.append("the other formats" if single else "the additional formats")
    if not single:
        return ""
    plural = len(single) > 1 or single[-1].startswith("the ")
    listed = " and ".join(filter(None, [", ".join(single[:-1]), single[-1]]))
    return f"{listed} {'contain' if plural else 'contains'} the layer {layer}."


def describe_result(result: Reconstruction) -> None:
    """Print the size of a result, its notes and findings, and the share and accuracy of its points."""
    from posefuse.report.summary import layer_origin, summarize
    from posefuse.report.verdict import judge_result

    name, _ = result.best_layer(result.options.layer)
    summary = summarize(result.windows(), name)
    rate = f" at {result.rate_hz:g} Hz" if result.rate_hz else ""
    note(
        f"{count(result.n_frames, 'frame')}{rate}, {count(len(result.rig), 'camera')}, "
        f"{count(len(result.skeleton), 'keypoint')}"
    )
    if detail.verbose:
        for layer in result.layers:
            note(f"layer {layer}: {layer_origin(result, layer)}")
    notes(result.provenance.notes)
    verdict = judge_result(result, summary)
    # A finding is the reason of its verdict.
    note(f"verdict: {verdict.level}" + (f": {verdict.sentence}" if not result.findings else ""))
    for finding in result.findings:
        note(f"finding: {finding}")
    if result.unit == "px":
        note("note: one camera: coordinates are pixels in its image plane, not in the world; C3D cannot hold them.")
    _describe_points(result, name, summary)
    _describe_cameras(result, summary)


def describe_gait(lines: Sequence[str]) -> None:
    """Print the gait and repetitions of people: of the first ones, except with ``--verbose``."""
    shown = lines if detail.verbose or len(lines) <= _MOST_GAITS else lines[: _MOST_GAITS - 1]
    for line in shown:
        note(f"gait: {line}")
    if len(lines) > len(shown):
        say(f"gait: and {count(len(lines) - len(shown), 'person').replace('persons', 'people')} (gait.csv, --verbose)")


def describe_remarks(remarks: Sequence[str]) -> None:
    """Print what the written formats cannot hold; only their number, except with ``--verbose``."""
    if detail.verbose or len(remarks) <= _MOST_REMARKS:
        for remark in remarks:
            note(f"note: {remark}")
    else:
        say(f"{count(len(remarks), 'note')} on what the written formats cannot hold (--verbose)")


def _describe_points(result: Reconstruction, layer: LayerName, summary: "Summary") -> None:
    from posefuse.model.status import USED_CODES, PointStatus, ViewStatus
    from posefuse.report.people import people_per_frame
    from posefuse.report.summary import format_sources

    with_points = sum(n for code, n in summary.status_counts.items() if code.has_point)
    people = subject_words(result.skeleton)[1]
    people = f"tracked {people}" if result.has_identities else people
    scope = "" if len(result.person_ids) == 1 else f" of {people}"
    share = with_points / summary.n_points if summary.n_points else math.nan
    say(f"{percent(share)} of the points{scope} have coordinates (layer {layer})")
    if with_points and detail.verbose:
        say(f"by source: {format_sources(summary.source_counts)}")
    if summary.error_px.count:
        say(f"reprojection error: median {summary.error_px.median:.2f} px, 90 % {summary.error_px.p90:.2f} px")
    missing = {code: n for code, n in summary.status_counts.items() if not code.has_point}
    if detail.verbose:
        for code, n in missing.items():
            say(f"missing: {count(n, 'point')}, {PointStatus(code).sentence}")
    elif missing:
        most = max(missing, key=missing.__getitem__)
        mostly = "" if len(missing) == 1 else "mostly "
        say(f"missing: {count(sum(missing.values()), 'point')}, {mostly}{PointStatus(most).sentence}")
    if not result.has_identities:
        say(people_per_frame(result))
    elif len(result.person_ids) != 1 or result.events:
        _describe_people(result, layer, summary)
    if not with_points and summary.n_points:
        totals = zip(summary.view_status_counts.sum(axis=0), ViewStatus, strict=True)
        _, cause = max((int(n), code) for n, code in totals if code not in USED_CODES)
        warn(f"no point has coordinates. Most observations: {cause.sentence}.")


def _describe_cameras(result: Reconstruction, summary: "Summary") -> None:
    swapped = summary.swapped
    rows = []
    for v, camera in enumerate(result.rig.names):
        error = summary.error_px_by_view[v]
        numbers = [f"{value:.2f}" if np.isfinite(value) else "-" for value in (error.median, error.p90)]
        swaps = [] if swapped is None else [percent(summary.swapped_share(v))]
        rows.append([camera, percent(summary.used[v]) if summary.n_points else "-", *numbers, *swaps])
    worst = np.argsort([-error.median if np.isfinite(error.median) else 0.0 for error in summary.error_px_by_view])
    shown = _shown(rows, worst)
    table(None, ["camera", "used", "median px", "90 % px", *([] if swapped is None else ["sides swapped"])], shown)
    _say_rest(rows, shown, "camera", "with smaller errors")


def _describe_people(result: Reconstruction, layer: LayerName, summary: "Summary") -> None:
    """Print the tracks of all people and their most important events."""
    from posefuse.io.results.write import people_with_frames
    from posefuse.model.tracks import TrackState
    from posefuse.report.people import format_event_counts, presence_interval, summarize_people

    word, _ = subject_words(result.skeleton)
    if not result.person_ids:
        warn(f"no {word} was found.")
    elif not people_with_frames(result):
        warn(f"no {word} is left in any frame; there is no TRC or C3D to write.")
    if result.events:
        note(f"events: {format_event_counts(result.events)}")
    major = [event for event in result.events if event.what in _MAJOR_EVENTS]
    for event in major if detail.verbose else major[:_MOST_EVENTS]:
        note(f"frame {event.number}: {event.person}: {event.what}: {event.why}")
    if len(major) > _MOST_EVENTS and not detail.verbose:
        say(f"and {count(len(major) - _MOST_EVENTS, 'event')} of these kinds (events.csv, --verbose)")
    people = summarize_people(result.windows(), layer)
    if not people:
        return
    timed = bool(np.isfinite(result.time_s).all())
    rows = []
    for life, error in zip(people, summary.error_px_by_person, strict=True):
        span = max(life.last - life.first + 1, 1)
        shares = [percent(life.frames[state] / span) for state in (TrackState.ACTIVE, TrackState.LOST)]
        views = f"{life.n_views:.1f}" if np.isfinite(life.n_views) else "-"
        median = f"{error.median:.2f}" if np.isfinite(error.median) else "-"
        rows.append([life.name, *presence_interval(result, life), *shares, views, median])
    unit = "s" if timed else "frame"
    shown = _shown(rows, np.arange(len(rows)))
    table(None, [word, f"from {unit}", f"to {unit}", "active", "lost", "cameras", "median px"], shown)
    _say_rest(rows, shown, "subject", "")


def _shown(rows: list[list[str]], order: np.ndarray) -> list[list[str]]:
    """Return the rows of a table that are printed: all, or the first ones of an order, in their own order."""
    if detail.verbose or len(rows) <= _MOST_ROWS:
        return rows
    return [rows[i] for i in sorted(order[: _MOST_ROWS - 1])]


def _say_rest(rows: list[list[str]], shown: list[list[str]], noun: str, which: str) -> None:
    """Print how many rows a table does not show."""
    if len(shown) < len(rows):
        say(f"and {count(len(rows) - len(shown), noun)} {which}".rstrip() + " (--verbose)")
