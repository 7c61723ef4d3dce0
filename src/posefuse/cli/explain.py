"""``posefuse explain``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say, table, warn
from posefuse.cli.types import Result, TimestampsPath
from posefuse.errors import MatchError, choices
from posefuse.explain import AROUND_S
from posefuse.model.detections import Detections
from posefuse.model.frame_report import DetectionReport, FrameReport, PersonReport, ViewReport
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import Skeleton

if TYPE_CHECKING:
    from posefuse.io.recording import Recording as FoundRecording

_MOST_NAMED = 12


def explain(
    result: Result,
    *,
    frame: Annotated[int, Parameter(help="Frame number, as in keypoints.csv.")],
    person: Annotated[
        str | None, Parameter(help="Person to show, keypoint by keypoint; by default all people.")
    ] = None,
    recording: Annotated[
        Path | None, Parameter(help="Folder of the recording, to list unassigned detections; not needed for a run.")
    ] = None,
    keypoints: Annotated[
        Path | None, Parameter(help="File or folder of 2D keypoints; by default those in the recording.")
    ] = None,
    timestamps: TimestampsPath = None,
) -> None:
    """Explain one frame: the assignment of detections to people, its reasons, and the status of all points.

    Unassigned detections are listed only with the 2D keypoints: --recording or --keypoints.
    """
    from posefuse import explain as explaining
    from posefuse.io.results.open_result import open_result, run_of

    file, opened = open_result(result)
    detections, made = None, run_of(file)
    if keypoints is None and made is not None and (made / "keypoints").is_dir():
        # The recording of a run has videos, whose keypoints are in its output.
        keypoints = made / "keypoints"
    if recording is not None or keypoints is not None:
        detections = detections_for(opened, recording, keypoints, timestamps)
    report = explaining.explain(opened, frame, detections, person)
    at = f", {report.time_s:.3f} s" if np.isfinite(report.time_s) else ""
    say(f"frame {report.number}{at}")
    if not report.complete:
        note(
            "Unassigned detections are not listed without the 2D keypoints. Add --recording FOLDER or --keypoints FILE."
        )
    _print_events(report)
    _print_people(report)
    if person is not None:
        _print_keypoints(report, opened.skeleton)
    for view in report.views:
        _print_view(view, tuple(opened.layers))


def detections_for(
    result: Reconstruction, recording: Path | None, keypoints: Path | None, timestamps: Path | None
) -> Detections:
    """Return the 2D keypoints of a result at the times that it used, views in the order of its cameras."""
    from posefuse.io.keypoints.read import read_keypoints
    from posefuse.io.open_recording import digest_path, keypoint_request
    from posefuse.io.recording import find_recording
    from posefuse.preprocess.time_offsets import shift_views

    if keypoints is None:
        assert recording is not None
        keypoints = _keypoints_of(result, find_recording(recording))
    # The result holds the skeleton; the path of its file is not stored.
    options = replace(result.options, skeleton=None)
    request = keypoint_request(recording or keypoints.parent, keypoints, options, Bars(), timestamps)
    detections = read_keypoints(keypoints, replace(request, skeleton=result.skeleton))
    known = result.provenance.inputs.get(keypoints.name)
    if known is not None and known != digest_path(keypoints):
        warn(f"{keypoints.name} has changed since the result was written; its detections may not match the result.")
    detections = detections.views(_views_of(result, detections))
    if result.options.sync.does_nothing:
        return detections
    return shift_views(detections, result.rig.names, result.options.sync).detections


def _keypoints_of(result: Reconstruction, found: "FoundRecording") -> Path:
    """Return the keypoints of a recording; among several, those whose content the result was computed from."""
    from posefuse.io.open_recording import digest_path
    from posefuse.io.recording import choose_keypoints

    if len(found.keypoints) > 1:
        known = set(result.provenance.inputs.values())
        same = next((item.path for item in found.keypoints if digest_path(item.path) in known), None)
        if same is not None:
            note(f"note: among several sets of keypoints, {same} is used: the result was computed from it.")
            return same
    return choose_keypoints(found)


def _views_of(result: Reconstruction, detections: Detections) -> list[str]:
    """Return the view of each of the result's cameras."""
    from posefuse.model.view_names import plain_name

    views = detections.view_names
    if result.options.camera_order:
        by_camera = dict(zip(result.options.camera_order, views, strict=False))
        return [by_camera[name] for name in result.rig.names]
    chosen = []
    for name in result.rig.names:
        exact = [view for view in views if view == name]
        found = exact or [view for view in views if plain_name(view) == plain_name(name)]
        if len(found) != 1:
            raise MatchError(
                f"Camera {name!r} of the result has {'no view' if not found else 'several views'} in the keypoints, "
                f"whose views are {choices(views)}. Specify the keypoints that the result was computed from."
            )
        chosen.append(found[0])
    return chosen


def _print_events(report: FrameReport) -> None:
    say("")
    if not report.events:
        note(f"No events within {AROUND_S:g} s.")
        return
    rows = [[str(event.number), event.person, event.what, event.why] for event in report.events]
    table(None, ["frame", "person", "event", "reason"], rows, words=True)


def _print_people(report: FrameReport) -> None:
    say("")
    if not report.people:
        note("No person is tracked in this frame.")
        return
    rows = [row for person in report.people for row in _person_rows(person)]
    table(None, ["person", "state", "layer", "points", "error px", "sd mm"], rows)


def _person_rows(person: PersonReport) -> list[list[str]]:
    state = f"{person.state.name.lower()} since {person.since}"
    rows = []
    for i, layer in enumerate(person.layers):
        who = [person.name, state] if i == 0 else ["", ""]
        keypoints = sum(len(names) for names in layer.status.values())
        points = f"{layer.n_points} of {keypoints}"
        rows.append([*who, layer.layer, points, _number(layer.error_px), _number(layer.sd_mm)])
    return rows


def _print_keypoints(report: FrameReport, skeleton: Skeleton) -> None:
    """Print the status of each keypoint of one person."""
    for each in report.people:
        for layer in each.layers:
            say("")
            how = ", ".join(f"{n} {code.label}" for code, n in layer.source.items())
            note(f"{each.name}, layer {layer.layer}: {how or 'no points'}")
            for code, names in layer.status.items():
                which = _summary_of_names(names, skeleton) if len(layer.status) > 1 else f"all {len(names)} keypoints"
                note(f"  {which}: {code.label}, {code.sentence}")


def _summary_of_names(names: Sequence[str], skeleton: Skeleton) -> str:
    """Return the names of keypoints; long lists give counts per hand and face, and the first of the others."""
    if len(names) <= _MOST_NAMED:
        return ", ".join(names)
    parts, rest = [], list(names)
    for part in skeleton.parts:
        of_part = {skeleton.keypoints[k] for k in part.keypoints}
        named = [name for name in rest if name in of_part]
        if named:
            parts.append(f"{part.name.replace('_', ' ')} ({len(named)} of {len(of_part)})")
            rest = [name for name in rest if name not in of_part]
    return ", ".join([*parts, *([choices(rest, _MOST_NAMED)] if rest else [])])


def _print_view(view: ViewReport, layers: tuple[str, ...]) -> None:
    say("")
    note(f"{view.name}: {count(len(view.detections), 'detection')}")
    if view.detections:
        columns = ["  #", "person", *(f"{layer} px" for layer in layers), "used", "reason"]
        table(None, columns, [_detection_row(each, layers) for each in view.detections], words=True)
    for name, why in view.undetected.items():
        note(f"  {name} not matched: {why}")


def _detection_row(each: DetectionReport, layers: tuple[str, ...]) -> list[str]:
    of = "" if each.n_keypoints is None else f" of {each.n_keypoints}"
    used = "-" if each.n_used is None else f"{each.n_used}"
    mark = "" if each.track_id is None else f" (id {each.track_id})"
    errors = [_number(each.error_px.get(layer, float("nan"))) for layer in layers]
    return [f"  {each.number}{mark}", each.person or "unassigned", *errors, used + of, each.why]


def _number(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"
