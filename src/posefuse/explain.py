"""Explain a frame of a result: the assignment of every detection and the state of every person.

A result does not store the odds of the tracker. The explanation uses what it stores: assignments, projections, point
statuses and events.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.errors import DetectionsError, ResultError, choices, suggestion
from posefuse.evaluation.visibility import in_image, recorded
from posefuse.model.detections import Detections
from posefuse.model.frame_report import DetectionReport, FrameReport, LayerReport, PersonReport, ViewReport
from posefuse.model.frames import Frame
from posefuse.model.label_swaps import SwapState
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source, is_used
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState

AROUND_S = 1.0
"""Events within this time of the frame are listed, in seconds."""

_NEAR = 0.25
"""A detection is near a person if the median keypoint distance is below this fraction of its size in the image."""


def explain(
    result: Reconstruction, number: int, detections: Detections | None = None, person: str | None = None
) -> FrameReport:
    """Explain a frame.

    Args:
        result: result with tracks.
        number: frame number of the recording.
        detections: 2D keypoints of the result, views in the order of the cameras.
        person: restrict the report to this person and to unassigned detections.

    Raises:
        ResultError: if the frame or person does not exist, or the result has no tracks.
        DetectionsError: if the detections do not match the result.
    """
    if result.tracks is None:
        raise ResultError("This result has no assignments, because it was not computed from detections.")
    if person is not None and person not in result.person_ids:
        raise ResultError(f"This result has no person {person!r}. {suggestion(person, result.person_ids)}")
    place = _index_of(result, number)
    frame = None if detections is None else _frame_of(detections, number, result)
    context = _FrameContext.of(result, place, frame)
    selected = [p for p, name in enumerate(result.person_ids) if person in (None, name)]
    return FrameReport(
        number=number,
        time_s=float(result.time_s[place]),
        views=tuple(_view(context, v, selected) for v in range(len(result.rig))),
        people=tuple(_person(result, context, place, p) for p in selected if context.state[p] != TrackState.ABSENT),
        events=_events_around(result, place, person),
        complete=frame is not None,
    )


def _index_of(result: Reconstruction, number: int) -> int:
    found = np.flatnonzero(result.frame_numbers == number)
    if not len(found):
        first, last = result.frame_numbers[[0, -1]]
        lacking = "This frame was not recorded." if first < number < last else "Choose a frame of the result."
        raise ResultError(f"This result has no frame {number}, only frames {first} to {last}. {lacking}")
    return int(found[0])


def _frame_of(detections: Detections, number: int, result: Reconstruction) -> Frame:
    places = np.flatnonzero(detections.frame_numbers == number)
    if not len(places):
        first, last = detections.frame_numbers[[0, -1]]
        raise DetectionsError(
            f"The keypoints have no frame {number}, only {first} to {last}; the result was computed from other "
            "keypoints."
        )
    if detections.skeleton.keypoints != result.skeleton.keypoints:
        raise DetectionsError(
            f"The 2D detections have the keypoints {choices(detections.skeleton.keypoints, 4)}, but the result has "
            f"{choices(result.skeleton.keypoints, 4)}; the result was computed from other detections."
        )
    return Frame.of(detections, int(places[0]))


@dataclass(frozen=True, eq=False)
class _FrameContext:
    """One frame of a result, with its detections if given.

    Attributes:
        result: result with this frame only.
        frame: detections, or None.
        state: shape (person,): track states.
        detection: shape (person, view): assigned detections, -1 for none.
        pixels: layer to shape (person, view, keypoint, 2): projected keypoints.
        expected: shape (person, view), bool: whether the person is inside the image.
        recorded: shape (view,), bool: whether the view recorded the frame.
        best: name of the best layer.
    """

    result: Reconstruction
    frame: Frame | None
    state: np.ndarray
    detection: np.ndarray
    pixels: dict[str, np.ndarray]
    expected: np.ndarray
    recorded: np.ndarray
    best: str

    @classmethod
    def of(cls, result: Reconstruction, place: int, frame: Frame | None) -> "_FrameContext":
        now = result.frames(place, place + 1)
        assert now.tracks is not None
        best, layer = now.best_layer()
        points = np.asarray(layer.points_m)
        context = cls(
            result=now,
            frame=frame,
            state=np.asarray(now.tracks.state)[0],
            detection=np.asarray(now.tracks.detection)[0],
            pixels={
                name: np.moveaxis(now.rig.project(np.asarray(each.points_m))[0], 0, 1)
                for name, each in now.layers.items()
            },
            expected=in_image(now.rig, now.skeleton, points)[0],
            recorded=recorded(layer)[0] if frame is None else frame.recorded,
            best=best,
        )
        context.check_detections()
        return context

    def check_detections(self) -> None:
        """Check that every assigned detection exists."""
        if self.frame is None:
            return
        for v, name in enumerate(self.result.rig.names):
            there, given = len(self.frame.rows_of(v)), int(self.detection[:, v].max(initial=-1)) + 1
            if given > there:
                raise DetectionsError(
                    f"Camera {name} has {there} detections in frame {self.frame.number} of these keypoints, but the "
                    f"result uses detection {given - 1}; the result was computed from other keypoints."
                )

    def owner(self, view: int, number: int) -> int | None:
        """Return the person to whom a detection is assigned, or None."""
        owners = np.flatnonzero(self.detection[:, view] == number)
        return int(owners[0]) if len(owners) else None


def _view(context: _FrameContext, view: int, selected: Sequence[int]) -> ViewReport:
    if context.frame is None:
        numbers = sorted(int(number) for number in context.detection[:, view] if number >= 0)
    else:
        numbers = list(range(len(context.frame.rows_of(view))))
    reports = []
    for number in numbers:
        owner = context.owner(view, number)
        if owner is None:
            reports.append(_unassigned(context, view, number))
        elif owner in selected:
            reports.append(_assigned(context, view, number, owner))
    undetected = {
        context.result.person_ids[p]: _why_undetected(context, view, p)
        for p in selected
        if context.detection[p, view] < 0 and context.state[p] != TrackState.ABSENT
    }
    return ViewReport(context.result.rig.names[view], tuple(reports), undetected)


def _assigned(context: _FrameContext, view: int, number: int, owner: int) -> DetectionReport:
    name = context.result.person_ids[owner]
    errors = {
        layer: _median(np.asarray(each.view_error_px)[0, owner, :, view])
        for layer, each in context.result.layers.items()
    }
    layer = context.result.layers.get("measured", context.result.layers[context.best])
    used = int(is_used(np.asarray(layer.view_status)[0, owner, :, view]).sum())
    state = TrackState(int(context.state[owner]))
    words = ["assigned" if state == TrackState.ACTIVE else f"assigned while {state.name.lower()}"]
    words += _next_nearest(context, view, number, owner)
    swapped = _swapped_limbs(context, view, owner)
    if swapped:
        words.append(f"left/right swap: {', '.join(swapped)}")
    return DetectionReport(
        number, *_keypoints_and_identity(context, view, number), name, errors, used, "; ".join(words)
    )


def _next_nearest(context: _FrameContext, view: int, number: int, owner: int) -> list[str]:
    """Describe the next nearest person, if any."""
    if context.frame is None:
        return []
    distances = _distances(context, view, number)
    own, distances[owner] = distances[owner], np.nan
    if not np.isfinite(distances).any() or not np.isfinite(own):
        return []
    other = int(np.nanargmin(distances))
    how = "nearer" if distances[other] < own else "next nearest"
    return [f"{how}: {context.result.person_ids[other]}, {distances[other]:.0f} px"]


def _unassigned(context: _FrameContext, view: int, number: int) -> DetectionReport:
    count, track_id = _keypoints_and_identity(context, view, number)
    nearest = _nearest(context, view, number)
    if nearest is None:
        why = "no keypoints" if not count else "no person is tracked in this frame"
        return DetectionReport(number, count, track_id, None, {}, None, why)
    person, error = nearest
    name = context.result.person_ids[person]
    errors = {layer: _distances(context, view, number, layer)[person] for layer in context.result.layers}
    size = _size(_pixels_of(context, view, number))
    if not error < _NEAR * size:
        why = f"no person here; the nearest is {name}"
    elif context.detection[person, view] >= 0:
        why = (
            f"on {name}, which has detection {context.detection[person, view]}: a duplicate, or two people who overlap"
        )
    else:
        state = TrackState(int(context.state[person])).name.lower()
        why = f"near {name} ({state}), not assigned: too unlikely as a match"
    return DetectionReport(number, count, track_id, None, errors, None, why)


def _why_undetected(context: _FrameContext, view: int, person: int) -> str:
    if not context.recorded[view]:
        return "the camera did not record this frame"
    if not np.isfinite(context.pixels[context.best][person]).any():
        return "the position is unknown in this frame"
    if not context.expected[person, view]:
        return "outside the image"
    if context.frame is None:
        return "should be visible; detections are unknown without the 2D keypoints"
    others = [int(n) for n in range(len(context.frame.rows_of(view))) if _is_near(context, view, n, person)]
    if not others:
        return "should be visible, but has no detection: occluded or missed"
    taken = {n: context.owner(view, n) for n in others}
    words = [f"detection {n} ({'unassigned' if p is None else context.result.person_ids[p]})" for n, p in taken.items()]
    return f"should be visible; detected there: {', '.join(words)}"


def _is_near(context: _FrameContext, view: int, number: int, person: int) -> bool:
    return bool(_distances(context, view, number)[person] < _NEAR * _size(_pixels_of(context, view, number)))


def _keypoints_and_identity(context: _FrameContext, view: int, number: int) -> tuple[int | None, int | None]:
    """Return the number of keypoints of a detection, and the detector's identity."""
    if context.frame is None:
        return None, None
    row = context.frame.rows_of(view)[number]
    track_id = int(context.frame.track_ids[row])
    return int(np.isfinite(context.frame.keypoints_px[row, :, 0]).sum()), track_id if track_id >= 0 else None


def _pixels_of(context: _FrameContext, view: int, number: int) -> np.ndarray:
    """Return the keypoints of a detection, shape (keypoint, 2)."""
    assert context.frame is not None
    return context.frame.keypoints_px[context.frame.rows_of(view)[number]]


def _distances(context: _FrameContext, view: int, number: int, layer: str | None = None) -> np.ndarray:
    """Return the median distance from every person, shape (person,), with the better side labels; NaN if absent."""
    seen, people = _pixels_of(context, view, number), context.pixels[layer or context.best][:, view]
    mirror = context.result.skeleton.mirror
    off = [np.linalg.norm(people - each, axis=-1) for each in (seen, seen[mirror])]
    return np.array([min(_median(off[0][p]), _median(off[1][p])) for p in range(len(people))])


def _nearest(context: _FrameContext, view: int, number: int) -> tuple[int, float] | None:
    if context.frame is None or not len(context.state):
        return None
    distances = _distances(context, view, number)
    if not np.isfinite(distances).any():
        return None
    person = int(np.nanargmin(distances))
    return person, float(distances[person])


def _size(pixels: np.ndarray) -> float:
    """Return the longer side of the bounding box of a detection."""
    there = pixels[np.isfinite(pixels[:, 0])]
    return float(np.ptp(there, axis=0).max()) if len(there) else float("nan")


def _swapped_limbs(context: _FrameContext, view: int, person: int) -> list[str]:
    swaps = context.result.swaps
    if swaps is None:
        return []
    state = np.asarray(swaps.state)[0, person, view]
    return [chain for chain, each in zip(swaps.chains, state, strict=True) if each == SwapState.SWAPPED]


def _person(result: Reconstruction, context: _FrameContext, place: int, person: int) -> PersonReport:
    assert result.tracks is not None
    past = np.asarray(result.tracks.state[: place + 1])[:, person]
    others = np.flatnonzero(past != past[-1])
    since = int(result.frame_numbers[others[-1] + 1 if len(others) else 0])
    layers = tuple(_layer(context, name, person) for name in context.result.layers)
    return PersonReport(result.person_ids[person], TrackState(int(past[-1])), since, layers)


def _layer(context: _FrameContext, name: str, person: int) -> LayerReport:
    layer = context.result.layers[name]
    codes = np.asarray(layer.status)[0, person]
    keypoints = np.array(context.result.skeleton.keypoints)
    status = {code: tuple(keypoints[codes == code].tolist()) for code in PointStatus if (codes == code).any()}
    origins = np.asarray(layer.source)[0, person]
    source = {code: n for code in Source if code and (n := int((origins == code).sum()))}
    there = layer.has_point[0, person]
    deviation = 1000.0 * np.sqrt((layer.sd_m[0, person] ** 2).mean(axis=-1))
    error = np.asarray(layer.reprojection_error_px)[0, person]
    return LayerReport(name, int(there.sum()), _median(error[there]), _median(deviation[there]), status, source)


def _events_around(result: Reconstruction, place: int, person: str | None) -> tuple[Event, ...]:
    when = float(result.time_s[place])
    number = int(result.frame_numbers[place])
    frames = AROUND_S * (result.rate_hz or 30.0)

    def is_around(event: Event) -> bool:
        away = abs(event.time_s - when)
        return away <= AROUND_S + 1e-6 if np.isfinite(away) else abs(event.number - number) <= frames

    names = (person, *result.rig.names)
    return tuple(e for e in result.events if is_around(e) and (person is None or e.person in names))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
