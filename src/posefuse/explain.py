"""Why a frame came out as it did: each detection and whose it is, each person and what was made of them.

What the tracker weighed is not kept with a result. What is told here follows from what is: who was given which
detection, how far people project from detections, how points came out, and what happened around the frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.errors import DetectionsError, ResultError, choices, suggestion
from posefuse.evaluation.visibility import in_image, recorded
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.label_swaps import SwapState
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source, is_used
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState

AROUND_S = 1.0
"""How much before and after a frame its events are told."""

_NEAR = 0.25
"""A detection is near a person whose keypoints are off by less than this share of its size in the image."""


@dataclass(frozen=True)
class Sighting:
    """One detection of a frame.

    Attributes:
        number: its place in the view, from 0.
        n_keypoints: how many keypoints it has; None where the 2D keypoints were not given.
        track_id: the detector's own identity, or None.
        person: whose it is, or None if nobody's.
        error_px: layer to the median distance of the person's points from it; of nobody's, of the nearest person's.
        n_used: of its keypoints, how many the measured (or only) layer rests on; None where it is nobody's.
        why: whose it is and why, or why nobody's.
    """

    number: int
    n_keypoints: int | None
    track_id: int | None
    person: str | None
    error_px: dict[str, float]
    n_used: int | None
    why: str


@dataclass(frozen=True)
class ViewAccount:
    """What a view showed.

    Attributes:
        name: of the camera.
        sightings: by number.
        unseen: person to why the view does not show them.
    """

    name: str
    sightings: tuple[Sighting, ...]
    unseen: dict[str, str]


@dataclass(frozen=True)
class LayerAccount:
    """How a person's keypoints came out in a layer.

    Attributes:
        layer: its name.
        n_points: how many have coordinates.
        error_px: median of their reprojection errors, NaN where there is none.
        sd_mm: median of their standard deviations, likewise.
        status: status to the keypoints that have it.
        source: how points came about to how many did.
    """

    layer: str
    n_points: int
    error_px: float
    sd_mm: float
    status: dict[PointStatus, tuple[str, ...]]
    source: dict[Source, int]


@dataclass(frozen=True)
class PersonConsistency:
    """What is known of a person.

    Attributes:
        name: of the person.
        state: in this frame.
        since: number of the frame from which they have been in that state.
        layers: how their keypoints came out.
    """

    name: str
    state: TrackState
    since: int
    layers: tuple[LayerAccount, ...]


@dataclass(frozen=True)
class FrameAccount:
    """A frame explained.

    Attributes:
        number: of the frame.
        time_s: of the frame, NaN where unknown.
        views: in the rig's order.
        people: those who are not absent.
        events: of the time around, in order.
        complete: whether the 2D keypoints were given, so that nobody's detections are known too.
    """

    number: int
    time_s: float
    views: tuple[ViewAccount, ...]
    people: tuple[PersonConsistency, ...]
    events: tuple[Event, ...]
    complete: bool


def explain(
    result: Reconstruction, number: int, detections: Detections | None = None, person: str | None = None
) -> FrameAccount:
    """Explain a frame.

    Args:
        result: of detections that were followed.
        number: of the frame, as in the recording.
        detections: the 2D keypoints the result was made from, its views in the order of the result's cameras.
        person: tell only of this one, and of what is nobody's.

    Raises:
        ResultError: if there is no such frame or person, or nothing was followed.
        DetectionsError: if the detections cannot be those the result was made from.
    """
    if result.tracks is None:
        raise ResultError("This result does not say which detection was whose: it was not made from detections.")
    if person is not None and person not in result.person_ids:
        raise ResultError(f"Nobody is called {person!r} in this result. {suggestion(person, result.person_ids)}")
    place = _place(result, number)
    frame = None if detections is None else _frame_of(detections, number, result)
    here = _Here.of(result, place, frame)
    told = [p for p, name in enumerate(result.person_ids) if person in (None, name)]
    return FrameAccount(
        number=number,
        time_s=float(result.time_s[place]),
        views=tuple(_view(here, v, told) for v in range(len(result.rig))),
        people=tuple(_person(result, here, place, p) for p in told if here.state[p] != TrackState.ABSENT),
        events=_events_around(result, place, person),
        complete=frame is not None,
    )


def _place(result: Reconstruction, number: int) -> int:
    found = np.flatnonzero(result.frame_numbers == number)
    if not len(found):
        first, last = result.frame_numbers[[0, -1]]
        lacking = "It was not recorded." if first < number < last else "Give one of them."
        raise ResultError(f"No frame {number} in this result, whose frames are {first} to {last}. {lacking}")
    return int(found[0])


def _frame_of(detections: Detections, number: int, result: Reconstruction) -> Frame:
    places = np.flatnonzero(detections.frame_numbers == number)
    if not len(places):
        first, last = detections.frame_numbers[[0, -1]]
        raise DetectionsError(
            f"The keypoints have no frame {number}, only {first} to {last}: the result was made from others."
        )
    if detections.skeleton.keypoints != result.skeleton.keypoints:
        raise DetectionsError(
            f"The keypoints are {choices(detections.skeleton.keypoints, 4)}, the result's "
            f"{choices(result.skeleton.keypoints, 4)}: it was made from others."
        )
    return Frame.of(detections, int(places[0]))


@dataclass(frozen=True, eq=False)
class _Here:
    """One frame of a result, and of its detections where they are known.

    Attributes:
        result: the one frame.
        frame: its detections, or None.
        state: shape (person,).
        detection: shape (person, view): numbers of detections, -1 for none.
        pixels: layer to shape (person, view, keypoint, 2): where people are in the images.
        expected: shape (person, view), bool: who is within the image.
        recorded: shape (view,), bool.
        best: the layer that says where people are.
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
    def of(cls, result: Reconstruction, place: int, frame: Frame | None) -> "_Here":
        now = result.frames(place, place + 1)
        assert now.tracks is not None
        best, layer = now.best_layer()
        points = np.asarray(layer.points_m)
        here = cls(
            result=now,
            frame=frame,
            state=np.asarray(now.tracks.state)[0],
            detection=np.asarray(now.tracks.detection)[0],
            pixels={
                name: np.moveaxis(now.rig.project(np.asarray(each.points_m)[0]), 0, 1)
                for name, each in now.layers.items()
            },
            expected=in_image(now.rig, now.skeleton, points)[0],
            recorded=recorded(layer)[0] if frame is None else frame.recorded,
            best=best,
        )
        here.must_fit()
        return here

    def must_fit(self) -> None:
        """Refuse detections of which people were given more than there are."""
        if self.frame is None:
            return
        for v, name in enumerate(self.result.rig.names):
            there, given = len(self.frame.rows_of(v)), int(self.detection[:, v].max(initial=-1)) + 1
            if given > there:
                raise DetectionsError(
                    f"Camera {name} has {there} detections in frame {self.frame.number} of these keypoints, but the "
                    f"result was given number {given - 1}: it was made from others."
                )

    def owner(self, view: int, number: int) -> int | None:
        """Whose a detection is."""
        owners = np.flatnonzero(self.detection[:, view] == number)
        return int(owners[0]) if len(owners) else None


def _view(here: _Here, view: int, told: Sequence[int]) -> ViewAccount:
    if here.frame is None:
        numbers = sorted(int(number) for number in here.detection[:, view] if number >= 0)
    else:
        numbers = list(range(len(here.frame.rows_of(view))))
    sightings = []
    for number in numbers:
        owner = here.owner(view, number)
        if owner is None:
            sightings.append(_nobodys(here, view, number))
        elif owner in told:
            sightings.append(_somebodys(here, view, number, owner))
    unseen = {
        here.result.person_ids[p]: _why_unseen(here, view, p)
        for p in told
        if here.detection[p, view] < 0 and here.state[p] != TrackState.ABSENT
    }
    return ViewAccount(here.result.rig.names[view], tuple(sightings), unseen)


def _somebodys(here: _Here, view: int, number: int, owner: int) -> Sighting:
    name = here.result.person_ids[owner]
    errors = {
        layer: _median(np.asarray(each.view_error_px)[0, owner, :, view]) for layer, each in here.result.layers.items()
    }
    layer = here.result.layers.get("measured", here.result.layers[here.best])
    used = int(is_used(np.asarray(layer.view_status)[0, owner, :, view]).sum())
    state = TrackState(int(here.state[owner]))
    words = ["matched" if state == TrackState.ACTIVE else f"matched, while {state.name.lower()}"]
    words += _next_to(here, view, number, owner)
    swapped = _swapped_limbs(here, view, owner)
    if swapped:
        words.append(f"left and right exchanged: {', '.join(swapped)}")
    return Sighting(number, *_of_detector(here, view, number), name, errors, used, "; ".join(words))


def _next_to(here: _Here, view: int, number: int, owner: int) -> list[str]:
    """Who else might have had a detection, where there is somebody."""
    if here.frame is None:
        return []
    distances = _distances(here, view, number)
    own, distances[owner] = distances[owner], np.nan
    if not np.isfinite(distances).any() or not np.isfinite(own):
        return []
    other = int(np.nanargmin(distances))
    how = "though nearer" if distances[other] < own else "next"
    return [f"{how}: {here.result.person_ids[other]}, {distances[other]:.0f} px"]


def _nobodys(here: _Here, view: int, number: int) -> Sighting:
    count, track_id = _of_detector(here, view, number)
    nearest = _nearest(here, view, number)
    if nearest is None:
        why = "no keypoints" if not count else "nobody is followed in this frame"
        return Sighting(number, count, track_id, None, {}, None, why)
    person, error = nearest
    name = here.result.person_ids[person]
    errors = {layer: _distances(here, view, number, layer)[person] for layer in here.result.layers}
    size = _size(_pixels_of(here, view, number))
    if not error < _NEAR * size:
        why = f"nobody stands there; {name} is nearest"
    elif here.detection[person, view] >= 0:
        why = f"on {name}, who has number {here.detection[person, view]}: seen twice, or two people who overlap"
    else:
        state = TrackState(int(here.state[person])).name.lower()
        why = f"near {name} ({state}), who was not given it: too unlikely as matched; the odds are not kept"
    return Sighting(number, count, track_id, None, errors, None, why)


def _why_unseen(here: _Here, view: int, person: int) -> str:
    if not here.recorded[view]:
        return "the camera has no such frame"
    if not np.isfinite(here.pixels[here.best][person]).any():
        return "nobody knows where they are in this frame"
    if not here.expected[person, view]:
        return "out of the image"
    if here.frame is None:
        return "should be seen; whether anything was detected there is not known without the 2D keypoints"
    others = [int(n) for n in range(len(here.frame.rows_of(view))) if _is_near(here, view, n, person)]
    if not others:
        return "should be seen, but nothing was detected there: hidden, or missed"
    taken = {n: here.owner(view, n) for n in others}
    words = [f"number {n} ({'nobody' if p is None else here.result.person_ids[p]})" for n, p in taken.items()]
    return f"should be seen; detected there: {', '.join(words)}"


def _is_near(here: _Here, view: int, number: int, person: int) -> bool:
    return bool(_distances(here, view, number)[person] < _NEAR * _size(_pixels_of(here, view, number)))


def _of_detector(here: _Here, view: int, number: int) -> tuple[int | None, int | None]:
    """How many keypoints a detection has, and the detector's identity."""
    if here.frame is None:
        return None, None
    row = here.frame.rows_of(view)[number]
    track_id = int(here.frame.track_ids[row])
    return int(np.isfinite(here.frame.keypoints_px[row, :, 0]).sum()), track_id if track_id >= 0 else None


def _pixels_of(here: _Here, view: int, number: int) -> np.ndarray:
    """Shape (keypoint, 2)."""
    assert here.frame is not None
    return here.frame.keypoints_px[here.frame.rows_of(view)[number]]


def _distances(here: _Here, view: int, number: int, layer: str | None = None) -> np.ndarray:
    """Shape (person,): median distance of a detection from everybody, sides as they fit better; NaN where absent."""
    seen, people = _pixels_of(here, view, number), here.pixels[layer or here.best][:, view]
    mirror = here.result.skeleton.mirror
    off = [np.linalg.norm(people - each, axis=-1) for each in (seen, seen[mirror])]
    return np.array([min(_median(off[0][p]), _median(off[1][p])) for p in range(len(people))])


def _nearest(here: _Here, view: int, number: int) -> tuple[int, float] | None:
    if here.frame is None or not len(here.state):
        return None
    distances = _distances(here, view, number)
    if not np.isfinite(distances).any():
        return None
    person = int(np.nanargmin(distances))
    return person, float(distances[person])


def _size(pixels: np.ndarray) -> float:
    """The longer side of the box around a detection."""
    there = pixels[np.isfinite(pixels[:, 0])]
    return float(np.ptp(there, axis=0).max()) if len(there) else float("nan")


def _swapped_limbs(here: _Here, view: int, person: int) -> list[str]:
    swaps = here.result.swaps
    if swaps is None:
        return []
    state = np.asarray(swaps.state)[0, person, view]
    return [chain for chain, each in zip(swaps.chains, state, strict=True) if each == SwapState.SWAPPED]


def _person(result: Reconstruction, here: _Here, place: int, person: int) -> PersonConsistency:
    assert result.tracks is not None
    past = np.asarray(result.tracks.state[: place + 1])[:, person]
    others = np.flatnonzero(past != past[-1])
    since = int(result.frame_numbers[others[-1] + 1 if len(others) else 0])
    layers = tuple(_layer(here, name, person) for name in here.result.layers)
    return PersonConsistency(result.person_ids[person], TrackState(int(past[-1])), since, layers)


def _layer(here: _Here, name: str, person: int) -> LayerAccount:
    layer = here.result.layers[name]
    codes = np.asarray(layer.status)[0, person]
    keypoints = np.array(here.result.skeleton.keypoints)
    status = {code: tuple(keypoints[codes == code].tolist()) for code in PointStatus if (codes == code).any()}
    origins = np.asarray(layer.source)[0, person]
    source = {code: n for code in Source if code and (n := int((origins == code).sum()))}
    there = layer.has_point[0, person]
    deviation = 1000.0 * np.sqrt((layer.sd_m[0, person] ** 2).mean(axis=-1))
    error = np.asarray(layer.reprojection_error_px)[0, person]
    return LayerAccount(name, int(there.sum()), _median(error[there]), _median(deviation[there]), status, source)


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
