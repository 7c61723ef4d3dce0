"""The people of neighbouring windows made one: who has the same detections where both windows look is the same."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.track_events import OVER_TIME, Event
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.people.selection import kept_tracks
from posefuse.pipeline.people.windows import Bodies, Seen
from posefuse.skeleton.skeletons import Skeleton

_SAME_SHARE = 0.5
_PERSON = re.compile(r"\bperson_\d+\b")
_NOTHING = {
    "status": PointStatus.ABSENT, "source": Source.NONE, "view_status": ViewStatus.UNSEEN, "nis_dof": 0,
}  # fmt: skip
"""What arrays hold of somebody who is not there; numbers are NaN."""


@dataclass(frozen=True, eq=False)
class StitchedPeople:
    """Who was where in a recording that was followed window by window.

    Attributes:
        recording_tracks: of all frames.
        events: what happened.
        skeleton: with the tree that bodies were fitted to.
        starts: the windows' first frames, counted from 0, and the recording's end.
        columns: by window, who of its people is who of ``tracks``, -1 for nobody.
        shape_m: shape (person, shape), of the last window that shows them.
        shape_sd_m: shape (person, shape).
        bodies: gives the model layer and poses of a window by its number.
    """

    recording_tracks: Tracks
    events: tuple[Event, ...]
    skeleton: Skeleton
    starts: tuple[int, ...]
    columns: tuple[tuple[int, ...], ...]
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    bodies: Callable[[int], Bodies]

    def tracks(self, start: int, stop: int) -> Tracks:
        """Whose detections are whose in a range of frames."""
        return self.recording_tracks.frames(start, stop)

    def only(self, names: tuple[str, ...]) -> "StitchedPeople":
        """The same of some of the people.

        Raises:
            OptionsError: if there is nobody of a name.
        """
        tracks, keep = kept_tracks(self.recording_tracks, names)
        others = set(self.recording_tracks.person_ids) - set(names)
        place = {old: new for new, old in enumerate(keep)}
        return replace(
            self,
            recording_tracks=tracks,
            events=tuple(event for event in self.events if event.person not in others),
            columns=tuple(tuple(place.get(column, -1) for column in of_window) for of_window in self.columns),
            shape_m=self.shape_m[keep],
            shape_sd_m=self.shape_sd_m[keep],
        )

    def with_bodies(self, part: Reconstruction, start: int) -> Reconstruction:
        """A range of frames with its model layer and poses.

        Args:
            part: measured, of these people.
            start: its first frame, counted from 0 in the recording.
        """
        stop, layer, arrays, poses = start + part.n_frames, {}, {}, None
        for window, (begin, end) in enumerate(zip(self.starts[:-1], self.starts[1:], strict=True)):
            first, last = max(begin, start), min(end, stop)
            if first >= last:
                continue
            theirs, poses = self.bodies(window)
            rows, cut = slice(first - start, last - start), slice(first - begin, last - begin)
            where = (part.n_frames, len(self.recording_tracks.person_ids), rows, cut, self.columns[window])
            for field in fields(Layer):
                _place(layer, field.name, getattr(theirs, field.name), where)
            for name in OVER_TIME:
                _place(arrays, name, getattr(poses, name), where)
        assert poses is not None
        stood = replace(poses, **arrays, shape_m=self.shape_m, shape_sd_m=self.shape_sd_m)
        return replace(part, layers={**part.layers, "model": Layer(**layer)}, poses=stood, skeleton=self.skeleton)


Where = tuple[int, int, slice, slice, tuple[int, ...]]


def _place(whole: dict[str, np.ndarray], name: str, piece: object, where: Where) -> None:
    """Put what a window knows of its people into the columns that they have among all."""
    frames, people, rows, cut, columns = where
    values = np.asarray(piece)[cut]
    if name not in whole:
        whole[name] = np.full((frames, people, *values.shape[2:]), _NOTHING.get(name, np.nan), dtype=values.dtype)
    here = [i for i, column in enumerate(columns) if column >= 0]
    whole[name][rows, [columns[i] for i in here]] = values[:, here]


def same_people(before: Seen, after: Seen) -> dict[int, int]:
    """Who of a window is who of the one before it: the two share most of the detections that they have in both.

    In each view and frame in which both windows give a person a detection, it is the same or it is not. People are
    matched so that most are; who shares less than half is somebody else.

    Returns:
        Column of ``after`` to column of ``before``.
    """
    first, last = after.window.first, before.window.last
    one = np.asarray(before.tracks.detection)[first - before.window.first :]
    other = np.asarray(after.tracks.detection)[: last - first]
    both = np.einsum("fav,fbv->ab", (one >= 0).astype(np.int64), (other >= 0).astype(np.int64))
    same = np.zeros_like(both)
    for a in range(one.shape[1]):
        for b in range(other.shape[1]):
            same[a, b] = np.count_nonzero((one[:, a] >= 0) & (one[:, a] == other[:, b]))
    rows, columns = linear_sum_assignment(same, maximize=True)
    return {int(b): int(a) for a, b in zip(rows, columns, strict=True) if same[a, b] > _SAME_SHARE * both[a, b]}


def stitch(seen: Sequence[Seen], frame_numbers: np.ndarray, bodies: Callable[[int], Bodies]) -> StitchedPeople:
    """Make the people of consecutive windows one, named in the order in which they come.

    Args:
        seen: the windows, in order; together all frames.
        frame_numbers: shape (frame,), of the recording.
        bodies: gives the model layer and poses of a window by its number.
    """
    columns = _columns(seen)
    number = 1 + max((column for of_window in columns for column in of_window), default=-1)
    names = tuple(f"person_{i + 1}" for i in range(number))
    n_frames, views = seen[-1].window.stop, np.asarray(seen[0].tracks.detection).shape[2]
    detection = np.full((n_frames, number, views), -1, dtype=np.int32)
    state = np.full((n_frames, number), TrackState.ABSENT, dtype=np.int8)
    lengths = seen[0].shape_m.shape[1]
    shape_m, shape_sd_m = np.full((number, lengths), np.nan), np.full((number, lengths), np.nan)
    events: list[Event] = []
    for each, of_window in zip(seen, columns, strict=True):
        window, (local, to) = each.window, _kept(of_window)
        core, own = slice(window.start - window.first, window.stop - window.first), slice(window.start, window.stop)
        detection[own, to] = np.asarray(each.tracks.detection)[core, local]
        state[own, to] = np.asarray(each.tracks.state)[core, local]
        shape_m[to], shape_sd_m[to] = each.shape_m[local], each.shape_sd_m[local]
        called = dict(zip(each.tracks.person_ids, (names[c] if c >= 0 else "" for c in of_window), strict=True))
        events += _events(each, called, frame_numbers)
    starts = (*(each.window.start for each in seen), n_frames)
    tracks = Tracks(names, detection, state)
    return StitchedPeople(tracks, tuple(events), seen[0].skeleton, starts, columns, shape_m, shape_sd_m, bodies)


def _columns(seen: Sequence[Seen]) -> tuple[tuple[int, ...], ...]:
    """By window, which of all people each of its people is; -1 for those who are in no window itself."""
    bodies: list[list[int]] = []
    """By window, a number for everybody, whether they are in the window itself or beside it."""
    made = 0
    for i, each in enumerate(seen):
        matched = same_people(seen[i - 1], each) if i else {}
        numbers = []
        for p in range(len(each.tracks.person_ids)):
            numbers.append(bodies[i - 1][matched[p]] if p in matched else made)
            made += p not in matched
        bodies.append(numbers)
    order: dict[int, int] = {}
    for each, numbers in zip(seen, bodies, strict=True):
        window = each.window
        core = np.asarray(each.tracks.state)[window.start - window.first : window.stop - window.first]
        for number, there in zip(numbers, (core != TrackState.ABSENT).any(axis=0), strict=True):
            if there:
                order.setdefault(number, len(order))
    return tuple(tuple(order.get(number, -1) for number in numbers) for numbers in bodies)


def _kept(columns: Sequence[int]) -> tuple[list[int], list[int]]:
    """Of a window's people those who are somebody, and who."""
    local = [i for i, column in enumerate(columns) if column >= 0]
    return local, [columns[i] for i in local]


def _events(seen: Seen, called: Mapping[str, str], frame_numbers: np.ndarray) -> list[Event]:
    """What happened in a window itself, to people by the names that they have in all windows, and to cameras."""
    window = seen.window
    first, last = frame_numbers[window.start], frame_numbers[window.stop - 1]
    inside = [event for event in seen.events if first <= event.number <= last and called.get(event.person, "-")]

    def named(found: re.Match[str]) -> str:
        return called.get(found[0]) or "somebody"

    return [
        replace(event, person=called.get(event.person, event.person), why=_PERSON.sub(named, event.why))
        for event in inside
    ]
