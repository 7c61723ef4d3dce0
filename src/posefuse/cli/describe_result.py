"""Print a summary of a result."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from posefuse.cli.console import count, note, percent, say, table, warn
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction

if TYPE_CHECKING:
    from posefuse.report.summary import Summary

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

    name, _ = result.best_layer(result.options.layer)
    summary = summarize(result.chunks(), name)
    rate = f" at {result.rate_hz:g} Hz" if result.rate_hz else ""
    note(
        f"{count(result.n_frames, 'frame')}{rate}, {count(len(result.rig), 'camera')}, "
        f"{count(len(result.skeleton), 'keypoint')}"
    )
    for layer in result.layers:
        note(f"layer {layer}: {layer_origin(result, layer)}")
    for remark in result.provenance.notes:
        note(f"note: {remark}")
    for finding in result.findings:
        note(f"finding: {finding}")
    if result.unit == "px":
        note("note: one camera: coordinates are pixels in its image plane, not in the world; C3D cannot hold them.")
    _describe_points(result, name, summary)
    _describe_cameras(result, summary)


def _describe_points(result: Reconstruction, layer: LayerName, summary: "Summary") -> None:
    from posefuse.model.status import USED_CODES, PointStatus, ViewStatus
    from posefuse.report.people import people_per_frame
    from posefuse.report.summary import format_sources

    with_points = sum(n for code, n in summary.status_counts.items() if code.has_point)
    people = "tracked people" if result.has_identities else "people"
    scope = "" if len(result.person_ids) == 1 else f" of {people}"
    share = with_points / summary.n_points if summary.n_points else math.nan
    say(f"{percent(share)} of the points{scope} have coordinates (layer {layer})")
    if with_points:
        say(f"by source: {format_sources(summary.source_counts)}")
    if summary.error_px.count:
        say(f"reprojection error: median {summary.error_px.median:.2f} px, 90 % {summary.error_px.p90:.2f} px")
    for code, n in summary.status_counts.items():
        if not code.has_point:
            say(f"missing: {count(n, 'point')}, {PointStatus(code).sentence}")
    if not result.has_identities:
        say(people_per_frame(result))
    elif len(result.person_ids) != 1 or result.events:
        _describe_people(result, layer)
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
    table(None, ["camera", "used", "median px", "90 % px", *([] if swapped is None else ["sides swapped"])], rows)


def _describe_people(result: Reconstruction, layer: LayerName) -> None:
    """Print the tracks of all people and their most important events."""
    from posefuse.io.results.write import people_with_frames
    from posefuse.model.tracks import TrackState
    from posefuse.report.people import format_event_counts, presence_interval, summarize_people

    if not result.person_ids:
        warn("no person was found.")
    elif not people_with_frames(result):
        warn("no person is left in any frame; there is no TRC or C3D to write.")
    if result.events:
        note(f"events: {format_event_counts(result.events)}")
    for event in result.events:
        if event.what in _MAJOR_EVENTS:
            note(f"frame {event.number}: {event.person}: {event.what}: {event.why}")
    people = summarize_people(result.chunks(), layer)
    if not people:
        return
    timed = bool(np.isfinite(result.time_s).all())
    rows = []
    for life in people:
        span = max(life.last - life.first + 1, 1)
        shares = [percent(life.frames[state] / span) for state in (TrackState.ACTIVE, TrackState.LOST)]
        numbers = [f"{value:.1f}" if np.isfinite(value) else "-" for value in (life.n_views, life.error_px)]
        rows.append([life.name, *presence_interval(result, life), *shares, *numbers])
    unit = "s" if timed else "frame"
    table(None, ["person", f"from {unit}", f"to {unit}", "active", "lost", "cameras", "median px"], rows)
