"""Putting identities right after the fact: names of a result merged, split, renamed, dropped and exchanged.

Every edit is a change to one table: whose data each person of the edited result takes in each frame. The table is made
first, from names, frame numbers and states alone; the data follow it range by range, so that a long result never has to
be in memory. The same edits on the same result give the same result.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import EditError, choices, suggestion
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.edits import Drop, Edit, Merge, Rename, Split, Swap, name_of
from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks, TrackState

_NOBODY = -1
# Of two who become one, who counts in a frame: who was seen rather than guessed, who was guessed rather than forgotten.
_RANK = {TrackState.ABSENT: 0, TrackState.LOST: 1, TrackState.TENTATIVE: 2, TrackState.ACTIVE: 3}


@dataclass(frozen=True, eq=False)
class _Casting:
    """Who plays whom.

    Attributes:
        names: of the people there will be.
        source: shape (frame, person), int64: the person of the original whose data they take, -1 for nobody's.
    """

    names: tuple[str, ...]
    source: np.ndarray


def apply_edits(result: Reconstruction, edits: Sequence[Edit]) -> Reconstruction:
    """A result with identities put right, in memory.

    Layers, tracks, poses, sides and events follow; the provenance says what was done. Lengths of bodies, which do not
    depend on the frame, are those of the original person who gives most frames.

    Args:
        result: stays as it is.
        edits: done one after the other, each on what the one before left.

    Raises:
        EditError: if an edit names somebody or a frame that is not there, or cannot be done; with its number.
    """
    return Reconstruction.concatenate(list(edited_chunks(result, edits)))


def edited_chunks(result: Reconstruction, edits: Sequence[Edit], size: int = CHUNK_FRAMES) -> Iterator[Reconstruction]:
    """:func:`apply_edits` in consecutive ranges of frames, for results that do not fit in memory.

    The edits are checked before the first range comes.
    """
    states = _states(result)
    casting = _cast(result, states, edits)
    owners = _main_sources(casting, states)
    events = _events(result, casting, states)
    notes = tuple(f"Edited: {edit.sentence}." for edit in edits)
    provenance = replace(result.provenance, notes=(*result.provenance.notes, *notes))
    head = replace(result, events=events, provenance=provenance)
    parts = ((start, stop, head.frames(start, stop)) for start, stop in ranges(result.n_frames, size))
    return (_recast(part, casting, casting.source[start:stop], owners) for start, stop, part in parts)


def _states(result: Reconstruction) -> np.ndarray:
    """Shape (frame, person): states; where nothing was tracked, people are active where they have points."""
    if result.tracks is not None:
        return np.asarray(result.tracks.state[:])
    _, layer = result.best_layer()
    return np.where(layer.has_point.any(axis=-1), TrackState.ACTIVE, TrackState.ABSENT)


def _cast(result: Reconstruction, states: np.ndarray, edits: Sequence[Edit]) -> _Casting:
    people = len(result.person_ids)
    casting = _Casting(result.person_ids, np.tile(np.arange(people), (result.n_frames, 1)))
    for number, edit in enumerate(edits, 1):
        try:
            casting = _edited(casting, edit, result.frame_numbers, states)
        except EditError as error:
            raise EditError(f"Edit {number} ({name_of(edit)}): {error}") from None
    return casting


def _edited(casting: _Casting, edit: Edit, numbers: np.ndarray, states: np.ndarray) -> _Casting:
    match edit:
        case Merge():
            return _merged(casting, edit, numbers, states)
        case Split():
            return _split(casting, edit, numbers)
        case Rename():
            return _renamed(casting, edit)
        case Drop():
            return _dropped(casting, edit, numbers)
        case Swap():
            return _swapped(casting, edit, numbers)


def _merged(casting: _Casting, edit: Merge, numbers: np.ndarray, states: np.ndarray) -> _Casting:
    goes, stays = (_place(casting, name) for name in (edit.person, edit.into))
    first, second = casting.source[:, stays], casting.source[:, goes]
    rank = np.vectorize(_RANK.__getitem__, otypes=[int])(np.stack([_states_of(s, states) for s in (first, second)]))
    both = (rank == _RANK[TrackState.ACTIVE]).all(axis=0)
    if edit.keep is None and both.any():
        there = numbers[both]
        raise EditError(
            f"{edit.into} and {edit.person} are both active in {len(there)} frames ({there[0]} to {there[-1]}), so "
            f"they look like two people. If they are one, say whose frames count there: keep = {edit.into!r}."
        )
    take_second = rank[1] > rank[0]
    take_second[both] = edit.keep == edit.person
    # Where neither is there, the frame belongs to who was there last: to them belongs what is told of their end.
    neither = (rank == 0).all(axis=0)
    last = np.maximum.accumulate(np.where(neither, -1, np.arange(len(neither))))
    take_second = np.where(last >= 0, take_second[last], False)
    taken, other = np.where(take_second, second, first), np.where(take_second, first, second)
    source = casting.source.copy()
    source[:, stays] = np.where(taken == _NOBODY, other, taken)
    return _Casting(_without(casting.names, goes), np.delete(source, goes, axis=1))


def _states_of(source: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Shape (frame,): the state of who is played in each frame."""
    if not states.shape[1]:
        return np.full(len(source), TrackState.ABSENT)
    own = np.take_along_axis(states, np.maximum(source, 0)[:, None], axis=1)[:, 0]
    return np.where(source >= 0, own, TrackState.ABSENT)


def _split(casting: _Casting, edit: Split, numbers: np.ndarray) -> _Casting:
    person, start = _place(casting, edit.person), _frame(edit.from_frame, "from_frame", numbers)
    _must_be_new(casting, edit.into)
    if start == 0:
        raise EditError(f"from_frame {edit.from_frame} is the first frame: nothing would be left of {edit.person}.")
    source = np.insert(casting.source, person + 1, _NOBODY, axis=1)
    source[start:, person + 1] = source[start:, person]
    source[start:, person] = _NOBODY
    return _Casting((*casting.names[: person + 1], edit.into, *casting.names[person + 1 :]), source)


def _renamed(casting: _Casting, edit: Rename) -> _Casting:
    person = _place(casting, edit.person)
    _must_be_new(casting, edit.to)
    return replace(casting, names=(*casting.names[:person], edit.to, *casting.names[person + 1 :]))


def _dropped(casting: _Casting, edit: Drop, numbers: np.ndarray) -> _Casting:
    people = slice(None) if edit.person is None else _place(casting, edit.person)
    if edit.whole:
        assert isinstance(people, int)
        return _Casting(_without(casting.names, people), np.delete(casting.source, people, axis=1))
    start = 0 if edit.from_frame is None else _frame(edit.from_frame, "from_frame", numbers)
    stop = len(numbers) if edit.to_frame is None else _frame(edit.to_frame, "to_frame", numbers) + 1
    source = casting.source.copy()
    source[start:stop, people] = _NOBODY
    return replace(casting, source=source)


def _swapped(casting: _Casting, edit: Swap, numbers: np.ndarray) -> _Casting:
    a, b = (_place(casting, name) for name in edit.people)
    start = _frame(edit.from_frame, "from_frame", numbers)
    source = casting.source.copy()
    source[start:, [a, b]] = source[start:, [b, a]]
    return replace(casting, source=source)


def _place(casting: _Casting, name: str) -> int:
    if name not in casting.names:
        raise EditError(f"Nobody is called {name!r} here. {suggestion(name, casting.names)}")
    return casting.names.index(name)


def _must_be_new(casting: _Casting, name: str) -> None:
    if name in casting.names:
        raise EditError(
            f"Somebody is called {name!r} already; there are {choices(casting.names, 20)}. Choose another name, or "
            "merge the two."
        )


def _frame(number: int, key: str, numbers: np.ndarray) -> int:
    """The place of a frame by its number."""
    if not numbers[0] <= number <= numbers[-1]:
        raise EditError(f"{key} {number} is not in this result, whose frames are {numbers[0]} to {numbers[-1]}.")
    place = int(np.searchsorted(numbers, number))
    if numbers[place] != number:
        raise EditError(
            f"{key} {number} is a frame that was not recorded; {numbers[place - 1]} and {numbers[place]} were."
        )
    return place


def _without(names: tuple[str, ...], place: int) -> tuple[str, ...]:
    return (*names[:place], *names[place + 1 :])


def _main_sources(casting: _Casting, states: np.ndarray) -> np.ndarray:
    """Shape (person,): who of the original gives each person most frames, for what has no frames."""
    owners = []
    for p in range(len(casting.names)):
        source = casting.source[:, p]
        counted = source[(source >= 0) & (_states_of(source, states) != TrackState.ABSENT)]
        frames = np.bincount(counted if len(counted) else source[source >= 0], minlength=1)
        owners.append(int(frames.argmax()))
    return np.array(owners, dtype=np.int64)


def _events(result: Reconstruction, casting: _Casting, states: np.ndarray) -> tuple[Event, ...]:
    """Events under their new names; those of people and frames that are gone go too."""
    places = {int(number): place for place, number in enumerate(result.frame_numbers)}
    told = []
    for event in result.events:
        if event.person not in result.person_ids or event.number not in places:
            told.append(event)
            continue
        f = places[event.number]
        for p in np.flatnonzero(casting.source[f] == result.person_ids.index(event.person)):
            told.append(_retold(event, casting, states, f, int(p)))
    return tuple(told)


def _retold(event: Event, casting: _Casting, states: np.ndarray, frame: int, person: int) -> Event:
    """An event of somebody who may have had another name, and may not be new where that name was."""
    name = casting.names[person]
    why = event.why if name == event.person else f"{event.why} (then called {event.person})"
    earlier = _states_of(casting.source[:frame, person], states[:frame]) >= TrackState.ACTIVE
    what = "reidentified" if event.what == "confirmed" and earlier.any() else event.what
    return replace(event, person=name, what=what, why=why)


def _recast(part: Reconstruction, casting: _Casting, source: np.ndarray, owners: np.ndarray) -> Reconstruction:
    """A range of frames with its people as they are cast."""

    def take(values: Any, empty: Any) -> np.ndarray:
        return _taken(np.asarray(values[:]), source, empty)

    tracks, swaps = part.tracks, part.swaps
    if tracks is not None:
        state = take(tracks.state, TrackState.ABSENT)
        tracks = Tracks(casting.names, take(tracks.detection, -1), state)
    return replace(
        part,
        person_ids=casting.names,
        layers={name: _recast_layer(layer, source) for name, layer in part.layers.items()},
        tracks=tracks,
        swaps=None if swaps is None else Swaps(swaps.chains, take(swaps.state, SwapState.UNKNOWN)),
        poses=None if part.poses is None else _recast_poses(part.poses, source, owners),
    )


def _taken(values: np.ndarray, source: np.ndarray, empty: Any) -> np.ndarray:
    """Shape (frame, person, ...): values of who is played, ``empty`` where that is nobody."""
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


def _recast_layer(layer: Layer, source: np.ndarray) -> Layer:
    arrays = {f.name: _taken(np.asarray(getattr(layer, f.name)[:]), source, _EMPTY[f.name]) for f in fields(Layer)}
    # A frame that a view does not have is not unseen in it, whoever was taken out.
    original = np.asarray(layer.view_status[:])
    if original.shape[1] and source.shape[1]:
        lacking = (original == ViewStatus.NOT_RECORDED).all(axis=(1, 2))
        for person in range(source.shape[1]):
            gone = (source[:, person] < 0)[:, None] & lacking
            frame, view = np.nonzero(gone)
            arrays["view_status"][frame, person, :, view] = ViewStatus.NOT_RECORDED
    return Layer(**arrays)


def _recast_poses(poses: Poses, source: np.ndarray, owners: np.ndarray) -> Poses:
    return replace(
        poses,
        turns=_taken(np.asarray(poses.turns[:]), source, np.nan),
        directions=_taken(np.asarray(poses.directions[:]), source, np.nan),
        angle_sd_deg=_taken(np.asarray(poses.angle_sd_deg[:]), source, np.nan),
        nis=_taken(np.asarray(poses.nis[:]), source, np.nan),
        nis_dof=_taken(np.asarray(poses.nis_dof[:]), source, 0),
        shape_m=np.asarray(poses.shape_m[:])[owners],
        shape_sd_m=np.asarray(poses.shape_sd_m[:])[owners],
    )
