"""Correct the identities of a result: merge, split, rename, drop and swap people.

Every edit changes one table: for each frame and each person of the edited result, the person of the original whose data
are used. The table is computed first, from names, frame numbers and states alone. The data are then edited range by
range, so a long result need not fit in memory. The same edits on the same result give the same result.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import ranges
from posefuse.errors import EditError, choices, suggestion
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.edits import Drop, Edit, Merge, Rename, Split, Swap, name_of
from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks, TrackState

_UNASSIGNED = -1
# When two people are merged, the higher rank wins in each frame: observed before predicted, predicted before absent.
_RANK = {TrackState.ABSENT: 0, TrackState.LOST: 1, TrackState.TENTATIVE: 2, TrackState.ACTIVE: 3}


@dataclass(frozen=True, eq=False)
class _IdentityTable:
    """Assignment of original people to the people of the edited result.

    Attributes:
        names: names of the people in the edited result.
        source: shape (frame, person), int64: original person whose data are used, -1 for none.
    """

    names: tuple[str, ...]
    source: np.ndarray


@checked
def apply_edits(result: Reconstruction, edits: Sequence[Edit]) -> Reconstruction:
    """Return the result with edited identities, in memory.

    Layers, tracks, poses, left/right swaps and events are edited; the provenance lists the edits. Body dimensions,
    which do not depend on the frame, come from the original person who contributes the most frames.

    Args:
        result: original result; not modified.
        edits: applied in order, each to the outcome of the previous one.

    Raises:
        EditError: if an edit names a person or frame that does not exist, or cannot be applied; names the edit's
            number.
    """
    return Reconstruction.concatenate(list(edited_chunks(result, edits)))


def edited_chunks(result: Reconstruction, edits: Sequence[Edit], size: int = CHUNK_FRAMES) -> Iterator[Reconstruction]:
    """Apply edits as in :func:`apply_edits`, but yield consecutive ranges of frames, for results larger than memory.

    All edits are checked before the first range is yielded.
    """
    if not result.has_identities:
        raise EditError("Edits correct identities, but the frames are unrelated (`people='stills'`) and have none.")
    states = _states(result)
    table = _build_table(result, states, edits)
    main_sources = _main_sources(table, states)
    events = _edit_events(result, table, states)
    notes = tuple(f"Edited: {edit.sentence}." for edit in edits)
    provenance = replace(result.provenance, notes=(*result.provenance.notes, *notes))
    head = replace(result, events=events, provenance=provenance)
    parts = ((start, stop, head.frames(start, stop)) for start, stop in ranges(result.n_frames, size))
    return (_apply_table(part, table, table.source[start:stop], main_sources) for start, stop, part in parts)


def _states(result: Reconstruction) -> np.ndarray:
    """Return states, shape (frame, person); without tracks, a person is active in frames with points."""
    if result.tracks is not None:
        return np.asarray(result.tracks.state[:])
    _, layer = result.best_layer()
    return np.where(layer.has_point.any(axis=-1), TrackState.ACTIVE, TrackState.ABSENT)


def _build_table(result: Reconstruction, states: np.ndarray, edits: Sequence[Edit]) -> _IdentityTable:
    people = len(result.person_ids)
    table = _IdentityTable(result.person_ids, np.tile(np.arange(people), (result.n_frames, 1)))
    for number, edit in enumerate(edits, 1):
        try:
            table = _apply_edit(table, edit, result.frame_numbers, states)
        except EditError as error:
            raise EditError(f"Edit {number} ({name_of(edit)}): {error}") from None
    return table


def _apply_edit(table: _IdentityTable, edit: Edit, numbers: np.ndarray, states: np.ndarray) -> _IdentityTable:
    match edit:
        case Merge():
            return _merge(table, edit, numbers, states)
        case Split():
            return _split(table, edit, numbers)
        case Rename():
            return _rename(table, edit)
        case Drop():
            return _drop(table, edit, numbers)
        case Swap():
            return _swap(table, edit, numbers)


def _merge(table: _IdentityTable, edit: Merge, numbers: np.ndarray, states: np.ndarray) -> _IdentityTable:
    removed, remaining = (_person_index(table, name) for name in (edit.person, edit.into))
    first, second = table.source[:, remaining], table.source[:, removed]
    rank = np.vectorize(_RANK.__getitem__, otypes=[int])(np.stack([_states_of(s, states) for s in (first, second)]))
    both = (rank == _RANK[TrackState.ACTIVE]).all(axis=0)
    if edit.keep is None and both.any():
        shared = numbers[both]
        raise EditError(
            f"{edit.into} and {edit.person} are both active in {len(shared)} frames ({shared[0]} to {shared[-1]}), so "
            "they are probably two people. If they are one person, choose whose frames to keep there: keep = "
            f"{edit.into!r}."
        )
    take_second = rank[1] > rank[0]
    take_second[both] = edit.keep == edit.person
    # A frame in which both are absent goes to the person who was present last, so that their final events are kept.
    neither = (rank == 0).all(axis=0)
    last = np.maximum.accumulate(np.where(neither, -1, np.arange(len(neither))))
    take_second = np.where(last >= 0, take_second[last], False)
    taken, other = np.where(take_second, second, first), np.where(take_second, first, second)
    source = table.source.copy()
    source[:, remaining] = np.where(taken == _UNASSIGNED, other, taken)
    return _IdentityTable(_without(table.names, removed), np.delete(source, removed, axis=1))


def _states_of(source: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return the state of the source person in each frame, shape (frame,)."""
    if not states.shape[1]:
        return np.full(len(source), TrackState.ABSENT)
    own = np.take_along_axis(states, np.maximum(source, 0)[:, None], axis=1)[:, 0]
    return np.where(source >= 0, own, TrackState.ABSENT)


def _split(table: _IdentityTable, edit: Split, numbers: np.ndarray) -> _IdentityTable:
    person, start = _person_index(table, edit.person), _frame_index(edit.from_frame, "from_frame", numbers)
    _require_new_name(table, edit.into)
    if start == 0:
        raise EditError(f"from_frame {edit.from_frame} is the first frame: no frames would remain for {edit.person}.")
    source = np.insert(table.source, person + 1, _UNASSIGNED, axis=1)
    source[start:, person + 1] = source[start:, person]
    source[start:, person] = _UNASSIGNED
    return _IdentityTable((*table.names[: person + 1], edit.into, *table.names[person + 1 :]), source)


def _rename(table: _IdentityTable, edit: Rename) -> _IdentityTable:
    person = _person_index(table, edit.person)
    _require_new_name(table, edit.to)
    return replace(table, names=(*table.names[:person], edit.to, *table.names[person + 1 :]))


def _drop(table: _IdentityTable, edit: Drop, numbers: np.ndarray) -> _IdentityTable:
    people = slice(None) if edit.person is None else _person_index(table, edit.person)
    if edit.whole:
        assert isinstance(people, int)
        return _IdentityTable(_without(table.names, people), np.delete(table.source, people, axis=1))
    start = 0 if edit.from_frame is None else _frame_index(edit.from_frame, "from_frame", numbers)
    stop = len(numbers) if edit.to_frame is None else _frame_index(edit.to_frame, "to_frame", numbers) + 1
    source = table.source.copy()
    source[start:stop, people] = _UNASSIGNED
    return replace(table, source=source)


def _swap(table: _IdentityTable, edit: Swap, numbers: np.ndarray) -> _IdentityTable:
    a, b = (_person_index(table, name) for name in edit.people)
    start = _frame_index(edit.from_frame, "from_frame", numbers)
    source = table.source.copy()
    source[start:, [a, b]] = source[start:, [b, a]]
    return replace(table, source=source)


def _person_index(table: _IdentityTable, name: str) -> int:
    if name not in table.names:
        raise EditError(f"No person is called {name!r}. {suggestion(name, table.names)}")
    return table.names.index(name)


def _require_new_name(table: _IdentityTable, name: str) -> None:
    if name in table.names:
        raise EditError(
            f"A person is already called {name!r}; the names are {choices(table.names, 20)}. Choose another name, or "
            "merge the two."
        )


def _frame_index(number: int, key: str, numbers: np.ndarray) -> int:
    """Return the index of a frame number."""
    if not numbers[0] <= number <= numbers[-1]:
        raise EditError(f"{key} {number} is not in this result, which has frames {numbers[0]} to {numbers[-1]}.")
    index = int(np.searchsorted(numbers, number))
    if numbers[index] != number:
        raise EditError(
            f"{key} {number} was not recorded; the nearest recorded frames are {numbers[index - 1]} and "
            f"{numbers[index]}."
        )
    return index


def _without(names: tuple[str, ...], index: int) -> tuple[str, ...]:
    return (*names[:index], *names[index + 1 :])


def _main_sources(table: _IdentityTable, states: np.ndarray) -> np.ndarray:
    """Return the original person who contributes the most frames to each person, shape (person,)."""
    main_sources = []
    for p in range(len(table.names)):
        source = table.source[:, p]
        counted = source[(source >= 0) & (_states_of(source, states) != TrackState.ABSENT)]
        frames = np.bincount(counted if len(counted) else source[source >= 0], minlength=1)
        main_sources.append(int(frames.argmax()))
    return np.array(main_sources, dtype=np.int64)


def _edit_events(result: Reconstruction, table: _IdentityTable, states: np.ndarray) -> tuple[Event, ...]:
    """Return events with edited names, without those of removed people and frames."""
    places = {int(number): place for place, number in enumerate(result.frame_numbers)}
    edited = []
    for event in result.events:
        if event.person not in result.person_ids or event.number not in places:
            edited.append(event)
            continue
        f = places[event.number]
        for p in np.flatnonzero(table.source[f] == result.person_ids.index(event.person)):
            edited.append(_edit_event(event, table, states, f, int(p)))
    return tuple(edited)


def _edit_event(event: Event, table: _IdentityTable, states: np.ndarray, frame: int, person: int) -> Event:
    """Return an event with its new name; a confirmation becomes a re-identification if the person was active before."""
    name = table.names[person]
    why = event.why if name == event.person else f"{event.why} (then called {event.person})"
    earlier = _states_of(table.source[:frame, person], states[:frame]) >= TrackState.ACTIVE
    what = "reidentified" if event.what == "confirmed" and earlier.any() else event.what
    return replace(event, person=name, what=what, why=why)


def _apply_table(
    part: Reconstruction, table: _IdentityTable, source: np.ndarray, main_sources: np.ndarray
) -> Reconstruction:
    """Return a range of frames with the people of the edited result."""

    def take(values: Any, empty: Any) -> np.ndarray:
        return _select(np.asarray(values[:]), source, empty)

    tracks, swaps = part.tracks, part.swaps
    if tracks is not None:
        state = take(tracks.state, TrackState.ABSENT)
        tracks = Tracks(table.names, take(tracks.detection, -1), state)
    return replace(
        part,
        person_ids=table.names,
        layers={name: _edit_layer(layer, source) for name, layer in part.layers.items()},
        tracks=tracks,
        swaps=None if swaps is None else Swaps(swaps.chains, take(swaps.state, SwapState.UNKNOWN)),
        poses=None if part.poses is None else _edit_poses(part.poses, source, main_sources),
        joint_angles=None,  # They are estimated again, because the points of people have changed.
    )


def _select(values: np.ndarray, source: np.ndarray, empty: Any) -> np.ndarray:
    """Return the values of the source people, ``empty`` where there is none, shape (frame, person, ...)."""
    if not source.shape[1]:
        return values[:, :0]
    if not values.shape[1]:
        return np.full((*source.shape, *values.shape[2:]), empty, dtype=values.dtype)
    frames = np.arange(len(source))[:, None]
    out = values[frames, np.maximum(source, 0)]
    out[source < 0] = empty
    return out


_EMPTY: dict[str, Any] = {
    "points_m": np.nan,
    "covariance_m2": np.nan,
    "status": PointStatus.ABSENT,
    "source": Source.NONE,
    "reprojection_error_px": np.nan,
    "view_status": ViewStatus.UNSEEN,
    "view_error_px": np.nan,
}


def _edit_layer(layer: Layer, source: np.ndarray) -> Layer:
    arrays = {f.name: _select(np.asarray(getattr(layer, f.name)[:]), source, _EMPTY[f.name]) for f in fields(Layer)}
    # Frames that a view did not record keep their status, even for people without a source.
    original = np.asarray(layer.view_status[:])
    if original.shape[1] and source.shape[1]:
        lacking = (original == ViewStatus.NOT_RECORDED).all(axis=(1, 2))
        for person in range(source.shape[1]):
            gone = (source[:, person] < 0)[:, None] & lacking
            frame, view = np.nonzero(gone)
            arrays["view_status"][frame, person, :, view] = ViewStatus.NOT_RECORDED
    return Layer(**arrays)


def _edit_poses(poses: Poses, source: np.ndarray, main_sources: np.ndarray) -> Poses:
    return replace(
        poses,
        turns=_select(np.asarray(poses.turns[:]), source, np.nan),
        directions=_select(np.asarray(poses.directions[:]), source, np.nan),
        angle_sd_deg=_select(np.asarray(poses.angle_sd_deg[:]), source, np.nan),
        root_turn_rad2=_select(np.asarray(poses.root_turn_rad2[:]), source, np.nan),
        nis=_select(np.asarray(poses.nis[:]), source, np.nan),
        nis_dof=_select(np.asarray(poses.nis_dof[:]), source, 0),
        shape_m=np.asarray(poses.shape_m[:])[main_sources],
        shape_sd_m=np.asarray(poses.shape_sd_m[:])[main_sources],
    )
