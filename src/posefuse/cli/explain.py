"""``posefuse explain``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say, table, warn
from posefuse.cli.types import TimestampsPath
from posefuse.errors import MatchError, choices
from posefuse.explain import AROUND_S, FrameAccount, PersonAccount, Sighting, ViewAccount
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import Skeleton

_MOST_NAMED = 12


def explain(
    result: Annotated[Path, Parameter(help="A result's folder, or its reconstruction.nc.")],
    *,
    frame: Annotated[int, Parameter(help="Number of the frame, as in keypoints.csv.")],
    person: Annotated[str | None, Parameter(help="Tell of this person only, keypoint by keypoint.")] = None,
    recording: Annotated[
        Path | None, Parameter(help="The recording's folder; the result does not say where it is.")
    ] = None,
    keypoints: Annotated[
        Path | None, Parameter(help="File or folder of the 2D keypoints; by default those in the recording.")
    ] = None,
    timestamps: TimestampsPath = None,
) -> None:
    """Say of a frame which detection is whose and why, and how everybody's keypoints came out.

    Detections that are nobody's are known only with the 2D keypoints: --recording or --keypoints.
    """
    from posefuse import explain as explaining
    from posefuse.io.results.open_result import open_result

    _, opened = open_result(result)
    detections = None
    if recording is not None or keypoints is not None:
        detections = detections_for(opened, recording, keypoints, timestamps)
    told = explaining.explain(opened, frame, detections, person)
    at = f", {told.time_s:.3f} s" if np.isfinite(told.time_s) else ""
    say(f"frame {told.number}{at}")
    if not told.complete:
        note(
            "The 2D keypoints are not known here, so detections that are nobody's are not told of, nor whether there "
            "were any: --recording FOLDER or --keypoints FILE."
        )
    _say_events(told)
    _say_people(told)
    if person is not None:
        _say_keypoints(told, opened.skeleton)
    for view in told.views:
        _say_view(view, tuple(opened.layers))


def detections_for(
    result: Reconstruction, recording: Path | None, keypoints: Path | None, timestamps: Path | None
) -> Detections:
    """The 2D keypoints, their views in the order of the result's cameras."""
    from posefuse.io.keypoints.read import read_keypoints
    from posefuse.io.open_recording import digest_path, keypoint_request
    from posefuse.io.recording import choose_keypoints, find_recording

    if keypoints is None:
        assert recording is not None
        keypoints = choose_keypoints(find_recording(recording))
    # Where the skeleton's file lay is nobody's business, and the result holds the skeleton.
    options = replace(result.options, skeleton=None)
    request = keypoint_request(recording or keypoints.parent, keypoints, options, Bars(), timestamps)
    detections = read_keypoints(keypoints, replace(request, skeleton=result.skeleton))
    known = result.provenance.inputs.get(keypoints.name)
    if known is not None and known != digest_path(keypoints):
        warn(f"{keypoints.name} has changed since the result was made; what is said of detections may be wrong.")
    return detections.views(_views_of(result, detections))


def _views_of(result: Reconstruction, detections: Detections) -> list[str]:
    """The view of each of the result's cameras."""
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
                f"whose views are {choices(views)}. Give the keypoints that the result was made from."
            )
        chosen.append(found[0])
    return chosen


def _say_events(told: FrameAccount) -> None:
    say("")
    if not told.events:
        note(f"Nothing happened within {AROUND_S:g} s.")
        return
    rows = [[str(event.number), event.person, event.what, event.why] for event in told.events]
    table(None, ["frame", "who", "what", "why"], rows, words=True)


def _say_people(told: FrameAccount) -> None:
    say("")
    if not told.people:
        note("Nobody is followed in this frame.")
        return
    rows = [row for person in told.people for row in _person_rows(person)]
    table(None, ["person", "state", "layer", "points", "error px", "sd mm"], rows)


def _person_rows(person: PersonAccount) -> list[list[str]]:
    state = f"{person.state.name.lower()} since {person.since}"
    rows = []
    for i, layer in enumerate(person.layers):
        who = [person.name, state] if i == 0 else ["", ""]
        keypoints = sum(len(names) for names in layer.status.values())
        points = f"{layer.n_points} of {keypoints}"
        rows.append([*who, layer.layer, points, _number(layer.error_px), _number(layer.sd_mm)])
    return rows


def _say_keypoints(told: FrameAccount, skeleton: Skeleton) -> None:
    """How each keypoint of one person came out."""
    for each in told.people:
        for layer in each.layers:
            say("")
            how = ", ".join(f"{n} {code.label}" for code, n in layer.source.items())
            note(f"{each.name}, layer {layer.layer}: {how or 'no points'}")
            for code, names in layer.status.items():
                which = _in_short(names, skeleton) if len(layer.status) > 1 else f"all {len(names)} keypoints"
                note(f"  {which}: {code.label}, {code.sentence}")


def _in_short(names: Sequence[str], skeleton: Skeleton) -> str:
    """Names of keypoints; of many, how many of each hand and face, and the first of the others."""
    if len(names) <= _MOST_NAMED:
        return ", ".join(names)
    said, rest = [], list(names)
    for part in skeleton.parts:
        theirs = {skeleton.keypoints[k] for k in part.keypoints}
        mine = [name for name in rest if name in theirs]
        if mine:
            said.append(f"{part.name.replace('_', ' ')} ({len(mine)} of {len(theirs)})")
            rest = [name for name in rest if name not in theirs]
    return ", ".join([*said, *([choices(rest, _MOST_NAMED)] if rest else [])])


def _say_view(view: ViewAccount, layers: tuple[str, ...]) -> None:
    say("")
    note(f"{view.name}: {count(len(view.sightings), 'detection')}" + ("" if view.sightings else " to tell of"))
    if view.sightings:
        columns = ["  #", "whose", *(f"{layer} px" for layer in layers), "used", "why"]
        table(None, columns, [_sighting_row(each, layers) for each in view.sightings], words=True)
    for name, why in view.unseen.items():
        note(f"  {name} not matched: {why}")


def _sighting_row(each: Sighting, layers: tuple[str, ...]) -> list[str]:
    of = "" if each.n_keypoints is None else f" of {each.n_keypoints}"
    used = "-" if each.n_used is None else f"{each.n_used}"
    mark = "" if each.track_id is None else f" (id {each.track_id})"
    errors = [_number(each.error_px.get(layer, float("nan"))) for layer in layers]
    return [f"  {each.number}{mark}", each.person or "nobody", *errors, used + of, each.why]


def _number(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"
