"""Stitch the people of neighboring windows: tracks with the same detections in their overlap are one person."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.track_events import OVER_TIME, Event
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.people.selection import select_people
from posefuse.pipeline.people.windows import TrackedWindow, WindowBodies
from posefuse.skeleton.skeletons import Skeleton

_SAME_SHARE = 0.5
_PERSON = re.compile(r"\bperson_\d+\b")
_ABSENT_VALUES = {
    "status": PointStatus.ABSENT, "source": Source.NONE, "view_status": ViewStatus.UNSEEN, "nis_dof": 0,
}  # fmt: skip
"""Values of arrays where a person is absent; all others are NaN."""


@dataclass(frozen=True, eq=False)
class StitchedPeople:
    """People of a recording that was tracked window by window.

    Attributes:
        recording_tracks: tracks in all frames.
        events: track events.
        skeleton: skeleton with the kinematic tree that bodies were fitted to.
        starts: index of each window's first frame, and the number of frames.
        columns: per window, the column in ``recording_tracks`` of each of its people, or -1.
        shape_m: shape (person, shape): lengths of the bodies, from the last window in which they appear.
        shape_sd_m: shape (person, shape): their standard deviations.
        bodies: returns the model layer and poses of a window by its index.
    """

    recording_tracks: Tracks
    events: tuple[Event, ...]
    skeleton: Skeleton
    starts: tuple[int, ...]
    columns: tuple[tuple[int, ...], ...]
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    bodies: Callable[[int], WindowBodies]

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the assignment of detections to people in a range of frames."""
        return self.recording_tracks.frames(start, stop)

    def only(self, names: tuple[str, ...]) -> "StitchedPeople":
        """Return the result for some of the people.

        Raises:
            OptionsError: if a person does not exist.
        """
        tracks, keep = select_people(self.recording_tracks, names)
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
        """Return a measured range of frames with its model layer and poses.

        Args:
            part: measured range of these people.
            start: index of its first frame in the recording.
        """
        stop, layer, arrays, poses = start + part.n_frames, {}, {}, None
        for window, (begin, end) in enumerate(zip(self.starts[:-1], self.starts[1:], strict=True)):
            first, last = max(begin, start), min(end, stop)
            if first >= last:
                continue
            window_layer, poses = self.bodies(window)
            rows, cut = slice(first - start, last - start), slice(first - begin, last - begin)
            target = (part.n_frames, len(self.recording_tracks.person_ids), rows, cut, self.columns[window])
            for field in fields(Layer):
                _place(layer, field.name, getattr(window_layer, field.name), target)
            for name in OVER_TIME:
                _place(arrays, name, getattr(poses, name), target)
        assert poses is not None
        all_poses = replace(poses, **arrays, shape_m=self.shape_m, shape_sd_m=self.shape_sd_m)
        return replace(part, layers={**part.layers, "model": Layer(**layer)}, poses=all_poses, skeleton=self.skeleton)


Target = tuple[int, int, slice, slice, tuple[int, ...]]
"""Frames and people of the target array, rows to fill, frames of the window, and columns of its people."""


def _place(whole: dict[str, np.ndarray], name: str, piece: object, target: Target) -> None:
    """Copy an array of a window's people to their columns among all people."""
    frames, people, rows, cut, columns = target
    values = np.asarray(piece)[cut]
    if name not in whole:
        whole[name] = np.full((frames, people, *values.shape[2:]), _ABSENT_VALUES.get(name, np.nan), dtype=values.dtype)
    here = [i for i, column in enumerate(columns) if column >= 0]
    whole[name][rows, [columns[i] for i in here]] = values[:, here]


def same_people(before: TrackedWindow, after: TrackedWindow) -> dict[int, int]:
    """Match the people of two consecutive windows by their shared detections.

    Two tracks are compared in the views and frames in which both have a detection. The matching maximizes the number of
    equal detections; pairs in which at most half are equal are not matched.

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


def stitch(
    tracked: Sequence[TrackedWindow], frame_numbers: np.ndarray, bodies: Callable[[int], WindowBodies]
) -> StitchedPeople:
    """Match the people of consecutive windows, and name them in the order in which they appear.

    Args:
        tracked: the windows in order; together they cover all frames.
        frame_numbers: shape (frame,): frame numbers of the recording.
        bodies: returns the model layer and poses of a window by its index.
    """
    columns = _columns(tracked)
    number = 1 + max((column for of_window in columns for column in of_window), default=-1)
    names = tuple(f"person_{i + 1}" for i in range(number))
    n_frames, views = tracked[-1].window.stop, np.asarray(tracked[0].tracks.detection).shape[2]
    detection = np.full((n_frames, number, views), -1, dtype=np.int32)
    state = np.full((n_frames, number), TrackState.ABSENT, dtype=np.int8)
    lengths = tracked[0].shape_m.shape[1]
    shape_m, shape_sd_m = np.full((number, lengths), np.nan), np.full((number, lengths), np.nan)
    events: list[Event] = []
    for each, of_window in zip(tracked, columns, strict=True):
        window, (local, to) = each.window, _kept(of_window)
        core, own = slice(window.start - window.first, window.stop - window.first), slice(window.start, window.stop)
        detection[own, to] = np.asarray(each.tracks.detection)[core, local]
        state[own, to] = np.asarray(each.tracks.state)[core, local]
        shape_m[to], shape_sd_m[to] = each.shape_m[local], each.shape_sd_m[local]
        called = dict(zip(each.tracks.person_ids, (names[c] if c >= 0 else "" for c in of_window), strict=True))
        events += _events(each, called, frame_numbers)
    starts = (*(each.window.start for each in tracked), n_frames)
    tracks = Tracks(names, detection, state)
    return StitchedPeople(tracks, tuple(events), tracked[0].skeleton, starts, columns, shape_m, shape_sd_m, bodies)


def _columns(tracked: Sequence[TrackedWindow]) -> tuple[tuple[int, ...], ...]:
    """Return per window the index among all people of each of its people; -1 for people outside all windows."""
    bodies: list[list[int]] = []
    """Per window, a number for each person of its wider range."""
    made = 0
    for i, each in enumerate(tracked):
        matched = same_people(tracked[i - 1], each) if i else {}
        numbers = []
        for p in range(len(each.tracks.person_ids)):
            numbers.append(bodies[i - 1][matched[p]] if p in matched else made)
            made += p not in matched
        bodies.append(numbers)
    order: dict[int, int] = {}
    for each, numbers in zip(tracked, bodies, strict=True):
        window = each.window
        core = np.asarray(each.tracks.state)[window.start - window.first : window.stop - window.first]
        for number, there in zip(numbers, (core != TrackState.ABSENT).any(axis=0), strict=True):
            if there:
                order.setdefault(number, len(order))
    return tuple(tuple(order.get(number, -1) for number in numbers) for numbers in bodies)


def _kept(columns: Sequence[int]) -> tuple[list[int], list[int]]:
    """Return the columns of a window's people that are among all people, and their columns there."""
    local = [i for i, column in enumerate(columns) if column >= 0]
    return local, [columns[i] for i in local]


def _events(tracked: TrackedWindow, called: Mapping[str, str], frame_numbers: np.ndarray) -> list[Event]:
    """Return the events within a window, with people's names among all windows."""
    window = tracked.window
    first, last = frame_numbers[window.start], frame_numbers[window.stop - 1]
    inside = [event for event in tracked.events if first <= event.number <= last and called.get(event.person, "-")]

    def named(found: re.Match[str]) -> str:
        return called.get(found[0]) or "a person"

    return [
        replace(event, person=called.get(event.person, event.person), why=_PERSON.sub(named, event.why))
        for event in inside
    ]
