"""Record the output of a tracker over a recording."""

from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np

from posefuse.checkpoint import Spool
from posefuse.model.track_events import Event
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.people.part_recorder import PartRecorder
from posefuse.pipeline.people.tracked_people import TrackedPeople, TrackNames
from posefuse.tracking.history import History
from posefuse.tracking.records import TrackedFrame
from posefuse.tracking.tracker import ArticulatedTracker


class Recorder:
    """Records a tracker's output about bodies: a few numbers per frame here, the states in the history.

    Args:
        history: records the states.
        spool: stores entries that are not needed before the end; None to keep them in memory.
    """

    def __init__(self, history: History, spool: Spool | None = None) -> None:
        self.history, self._spool = history, spool
        self._spooled: list[int] = []
        """Positions in the spool of the entries and innovations of earlier frames."""
        self.entries = array("i")
        """Frame index, track number, state and detection rows of every person and frame; later entries win."""
        self.innovations = array("d")
        """Frame index, track number, NIS and its degrees of freedom, likewise."""
        self.names: dict[int, list[tuple[int, str]]] = {}
        self.shapes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.events: list[Event] = []

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the spool; :meth:`attach` sets it after unpickling."""
        return {name: value for name, value in vars(self).items() if name != "_spool"}

    def attach(self, spool: Spool) -> None:
        """Set the spool of an unpickled recorder."""
        self._spool = spool

    def spool_entries(self) -> None:
        """Move the entries of past frames to the spool, if there is one."""
        if self._spool is not None:
            self._spooled.append(self._spool.add((np.array(self.entries), np.array(self.innovations))))
            self.entries, self.innovations = array("i"), array("d")

    def _all_entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the entries and innovations of all frames."""
        spooled = [] if self._spool is None else [self._spool.read(place) for place in self._spooled]
        entries, innovations = zip(*spooled, (np.array(self.entries), np.array(self.innovations)), strict=True)
        return np.concatenate(entries), np.concatenate(innovations)

    def add(self, tracker: ArticulatedTracker, tracked: TrackedFrame) -> None:
        """Record one frame; ``tracker`` is as it is after the frame."""
        people = tracked.people
        self.history.add(tracker, tracked)
        place = len(self.history) - 1
        by_name = {person.name: person for person in people.people}
        for p, track in enumerate(tracker.tracks):
            self.names.setdefault(track.number, [(0, track.name)])
            self.shapes[track.name] = tracker.shape_of(p)
            person = by_name[track.name]
            self._add_entry(place, track.number, track.state, person.rows)
            if person.nis_dof:
                self.innovations.extend((place, track.number, person.nis, person.nis_dof))
            for each in tracked.past_states.get(track.name, []):
                # A tracker that continues an earlier range may remember frames of it.
                if each.number >= self.history.numbers[0]:
                    self._add_entry(self.history.place(each.number), track.number, TrackState.TENTATIVE, each.rows)
        for swap in tracked.swaps:
            self._rename(tracker, swap.numbers, self.history.place_at(swap.since_s))
        self.events.extend(people.events)

    def _add_entry(self, place: int, number: int, state: TrackState, rows: np.ndarray) -> None:
        self.entries.extend((place, number, state, *rows.tolist()))

    def _rename(self, tracker: ArticulatedTracker, numbers: tuple[int, int], place: int) -> None:
        """Give tracks whose identities were swapped their present names from a frame on."""
        for track in tracker.tracks:
            if track.number in numbers:
                before = [each for each in self.names[track.number] if each[0] < place]
                self.names[track.number] = [*before, (place, track.name)]

    def close(self, parts: Sequence[PartRecorder], offsets: np.ndarray, n_views: int) -> TrackedPeople:
        """Return the tracked people, in the order in which their tracks were confirmed.

        Args:
            parts: records of hands and faces in the same frames.
            offsets: shape (frame * view + 1,): offsets of the detections of the recorded frames.
            n_views: number of views.
        """
        names = tuple(self.shapes)
        n_frames = len(self.history)
        shape = (n_frames, len(names))
        rows = np.full((*shape, n_views), -1, dtype=np.int64)
        state = np.full(shape, TrackState.ABSENT, dtype=np.int8)
        naming = TrackNames({number: tuple(since) for number, since in self.names.items()})
        entries, innovations = self._all_entries()
        entries = entries.reshape(-1, 3 + n_views)
        for number in naming.since:
            own = entries[entries[:, 1] == number]
            columns = naming.columns(number, own[:, 0], names)
            rows[own[:, 0], columns], state[own[:, 0], columns] = own[:, 3:], own[:, 2]
        _end_at_last_detection(rows, state)
        nis, nis_dof = _innovations(innovations.reshape(-1, 4), naming, names, state)
        starts = offsets[:-1].reshape(n_frames, 1, n_views)
        # Rows of a frame count through its views; a track's detections count within the view.
        detection = np.where(rows >= 0, rows + starts[:, :, :1] - starts, -1).astype(np.int32)
        lengths = len(self.history.settings.skeleton.body_names[2])
        shapes = [[own, *(part.shapes[name] for part in parts)] for name, own in self.shapes.items()]
        shape_m, shape_sd_m = (
            np.stack([np.concatenate([shape[i] for shape in each]) for each in shapes])
            if names
            else np.empty((0, lengths))
            for i in range(2)
        )
        tracks = Tracks(names, detection, state)
        return TrackedPeople(
            tracks, tuple(self.events), self.history, tuple(part.history for part in parts), naming, nis, nis_dof,
            shape_m, shape_sd_m,
        )  # fmt: skip


def _innovations(
    entries: np.ndarray, naming: TrackNames, names: tuple[str, ...], state: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return NIS and its degrees of freedom, each of shape (frame, person)."""
    nis, dof = np.full(state.shape, np.nan), np.zeros(state.shape, dtype=np.int32)
    for number in naming.since:
        own = entries[entries[:, 1] == number]
        places = own[:, 0].astype(np.int64)
        columns = naming.columns(number, places, names)
        nis[places, columns], dof[places, columns] = own[:, 2], own[:, 3]
    absent = state == TrackState.ABSENT
    nis[absent], dof[absent] = np.nan, 0
    return nis, dof


def _end_at_last_detection(rows: np.ndarray, state: np.ndarray) -> None:
    """Mark people as absent after their last detection.

    Args:
        rows: shape (frame, person, view).
        state: shape (frame, person), modified in place.
    """
    detected = np.asarray((rows >= 0).any(axis=2))
    for p in range(state.shape[1]):
        last = np.flatnonzero(detected[:, p])
        end = last[-1] + 1 if len(last) else 0
        state[end:, p] = TrackState.ABSENT
