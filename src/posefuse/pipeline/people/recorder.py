"""What is kept of a tracker's run."""

from array import array
from typing import Any

import numpy as np

from posefuse.checkpoint import Spool
from posefuse.model.detections import Detections
from posefuse.model.track_events import Event
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.people.tracked_people import Naming, TrackedPeople
from posefuse.tracking.history import History
from posefuse.tracking.records import TrackedFrame
from posefuse.tracking.tracker import ArticulatedTracker


class Book:
    """What is kept of a tracker's run: little a frame, the states in the history.

    Args:
        history: to be written.
        parts: to be written, of hands and faces.
        spool: where to put away what is not needed before the end; memory, where it is left out.
    """

    def __init__(self, history: History, parts: tuple[History, ...], spool: Spool | None = None) -> None:
        self.history, self.parts, self._spool = history, parts, spool
        self._put_away: list[int] = []
        """Where in the spool lines and innovations of earlier frames are."""
        self.lines = array("i")
        """Place, number, state and rows, of every person and frame one after the other; later ones count."""
        self.innovations = array("d")
        """Place, number, NIS and its degrees of freedom, likewise."""
        self.names: dict[int, list[tuple[int, str]]] = {}
        self.shapes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.events: list[Event] = []

    def __getstate__(self) -> dict[str, Any]:
        """All but the spool: whoever goes on from a pickle says where that is, with :meth:`goes_on_in`."""
        return {name: value for name, value in vars(self).items() if name != "_spool"}

    def goes_on_in(self, spool: Spool) -> None:
        """Take a spool, that of the book which this one is a pickle of, for one's own."""
        self._spool = spool

    def put_away(self) -> None:
        """Put what is not needed before the end into the spool, if there is one."""
        if self._spool is not None:
            self._put_away.append(self._spool.add((np.array(self.lines), np.array(self.innovations))))
            self.lines, self.innovations = array("i"), array("d")

    def _all(self) -> tuple[np.ndarray, np.ndarray]:
        """Lines and innovations of all frames, one after the other."""
        away = [] if self._spool is None else [self._spool.read(place) for place in self._put_away]
        lines, innovations = zip(*away, (np.array(self.lines), np.array(self.innovations)), strict=True)
        return np.concatenate(lines), np.concatenate(innovations)

    def enter(self, tracker: ArticulatedTracker, tracked: TrackedFrame) -> None:
        """Add a frame."""
        people = tracked.people
        self.history.add(tracker, tracked)
        for history, follower in zip(self.parts, tracker.parts, strict=True):
            history.add_parts(follower, tracker.tracks, people)
        place = len(self.history) - 1
        told = {person.name: person for person in people.people}
        for p, track in enumerate(tracker.tracks):
            self.names.setdefault(track.number, [(0, track.name)])
            shapes = [tracker.shape_of(p), *(part.shape_of(track.name) for part in tracker.parts)]
            values, sds = (np.concatenate(each) for each in zip(*shapes, strict=True))
            self.shapes[track.name] = (values, sds)
            person = told[track.name]
            self._note(place, track.number, track.state, person.rows)
            if person.nis_dof:
                self.innovations.extend((place, track.number, person.nis, person.nis_dof))
            for each in tracked.past_states.get(track.name, []):
                self._note(self.history.place(each.number), track.number, TrackState.TENTATIVE, each.rows)
        for swap in tracked.swaps:
            self._rename(tracker, swap.numbers, self.history.place_at(swap.since_s))
        self.events.extend(people.events)

    def _note(self, place: int, number: int, state: TrackState, rows: np.ndarray) -> None:
        self.lines.extend((place, number, state, *rows.tolist()))

    def _rename(self, tracker: ArticulatedTracker, numbers: tuple[int, int], place: int) -> None:
        """Bodies have been, from that frame on, who they are called now."""
        for track in tracker.tracks:
            if track.number in numbers:
                before = [each for each in self.names[track.number] if each[0] < place]
                self.names[track.number] = [*before, (place, track.name)]

    def close(self, detections: Detections) -> TrackedPeople:
        """All of it, people in the order in which they were first believed."""
        names = tuple(self.shapes)
        shape = (len(self.history), len(names))
        rows = np.full((*shape, detections.n_views), -1, dtype=np.int64)
        state = np.full(shape, TrackState.ABSENT, dtype=np.int8)
        naming = Naming({number: tuple(since) for number, since in self.names.items()})
        lines, innovations = self._all()
        lines = lines.reshape(-1, 3 + detections.n_views)
        for number in naming.since:
            mine = lines[lines[:, 1] == number]
            columns = naming.columns(number, mine[:, 0], names)
            rows[mine[:, 0], columns], state[mine[:, 0], columns] = mine[:, 3:], mine[:, 2]
        _end_with_the_last_sight(rows, state)
        nis, nis_dof = _innovations(innovations.reshape(-1, 4), naming, names, state)
        starts = detections.offsets[:-1].reshape(detections.n_frames, 1, detections.n_views)
        # A frame's rows are counted through its views, a track's detections within the view.
        detection = np.where(rows >= 0, rows + starts[:, :, :1] - starts, -1).astype(np.int32)
        lengths = len(self.history.settings.skeleton.body_names[2])
        shape_m, shape_sd_m = (
            np.stack([each[i] for each in self.shapes.values()]) if names else np.empty((0, lengths)) for i in range(2)
        )
        tracks = Tracks(names, detection, state)
        return TrackedPeople(
            tracks, tuple(self.events), self.history, self.parts, naming, nis, nis_dof, shape_m, shape_sd_m
        )  # fmt: skip


def _innovations(
    lines: np.ndarray, naming: Naming, names: tuple[str, ...], state: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """NIS and its degrees of freedom, shape (frame, person) each, of those who are there."""
    nis, dof = np.full(state.shape, np.nan), np.zeros(state.shape, dtype=np.int32)
    for number in naming.since:
        mine = lines[lines[:, 1] == number]
        places = mine[:, 0].astype(np.int64)
        columns = naming.columns(number, places, names)
        nis[places, columns], dof[places, columns] = mine[:, 2], mine[:, 3]
    absent = state == TrackState.ABSENT
    nis[absent], dof[absent] = np.nan, 0
    return nis, dof


def _end_with_the_last_sight(rows: np.ndarray, state: np.ndarray) -> None:
    """Afterwards it is known who did not come back: they were there until they were last seen.

    Args:
        rows: shape (frame, person, view).
        state: shape (frame, person), in and out.
    """
    seen = np.asarray((rows >= 0).any(axis=2))
    for p in range(state.shape[1]):
        last = np.flatnonzero(seen[:, p])
        end = last[-1] + 1 if len(last) else 0
        state[end:, p] = TrackState.ABSENT
