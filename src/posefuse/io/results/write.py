"""Write results in any supported format."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.errors import ResultError, choices, suggestion
from posefuse.io.files import check_texts
from posefuse.io.results import c3d, csv, trc
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.names import safe_names
from posefuse.io.results.registry import RESULTS
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import TrackState
from posefuse.progress import Progress, Silent, report_ranges


@dataclass(frozen=True)
class Written:
    """The files of a written result.

    Attributes:
        files: written files in order, or the folder for formats of many files.
        layer: layer in the files, or None if they have all layers.
        notes: notes on what the files do not contain, in sentences.
    """

    files: tuple[Path, ...]
    layer: LayerName | None
    notes: tuple[str, ...]


def write(
    result: Reconstruction,
    path: str | Path,
    format: str | None = None,  # noqa: A002
) -> Written:
    """Write a result to a file.

    netcdf holds everything. The others hold one layer: the one ``result.options.layer`` names, or the best present.
    trc, c3d, anipose, npz and freemocap hold one person; a result of several is written to ``<stem>_<person><suffix>``
    each; so do bvh and gltf, which hold articulated bodies.

    Args:
        result: what to write.
        path: the file, or the folder of freemocap, opensim and openpose; it appears when it is whole.
        format: a name that ``posefuse formats`` lists; by default what the path's ending says, and where several
            formats end so, what its name does (anipose, dlc, movement, points3d).

    Returns:
        What was written, and what it does not hold.

    Raises:
        ResultError: if there is no such format, or it cannot hold the result.
        FileError: if a name in the result is no text, or the file cannot be written.
    """
    path = Path(path)
    check_texts([*result.person_ids, *result.rig.names, *result.skeleton.keypoints, result.skeleton.name])
    form = _format_of(path, format)
    layer, points = result.best_layer(result.options.layer)
    if form.write_figure is not None or form.write_result is not None:
        return _write_bodies(result, path, form, layer)
    # Formats of one layer must read nothing else; some hold the measured layer beside it.
    layers = {layer: points}
    if form.holds_measured_layer and "measured" in result.layers:
        layers = {"measured": result.layers["measured"], **layers}
    bare = replace(result, layers=layers, tracks=None, swaps=None, poses=None, events=())
    files = (path,)
    if form.write_person is not None:
        files = person_paths(path, result.person_ids)
        for person, target in zip(result.person_ids, files, strict=True):
            form.write_person(bare, person, target, layer)
    elif form.write_layer is not None:
        form.write_layer(bare, path, layer)
    others = _others(result, layer)
    beside = (f"{form.name}: the layer {layer}; without {choices(others)}.",) if others else ()
    return Written(files, layer, (*beside, *_lacks(form, path)))


def _others(result: Reconstruction, layer: LayerName) -> list[str]:
    """Return the parts of a result that a file with one layer does not contain."""
    parts = {
        "fitted bodies": result.poses is not None,
        "detections of each track": result.tracks is not None,
        "swapped sides": result.swaps is not None,
        "events": bool(result.events),
    }
    return [*(name for name in result.layers if name != layer), *(name for name, there in parts.items() if there)]


def _write_bodies(result: Reconstruction, path: Path, form: ResultFormat, layer: LayerName) -> Written:
    """Write formats that need more than one layer of a result."""
    people = people_with_frames(result)
    if form.write_figure is not None:
        targets = person_paths(path, people)
        notes = [
            note for person, target in zip(people, targets, strict=True)
            for note in form.write_figure(result, person, target)
        ]  # fmt: skip
        return Written(targets, "model", tuple(dict.fromkeys(notes)))
    assert form.write_result is not None
    notes = form.write_result(result, people, path, layer)
    return Written((path,), None if form.holds_every_layer else layer, tuple(notes))


def _format_of(path: Path, name: str | None) -> ResultFormat:
    """Return the format of a name, or the one selected by the path."""
    form = _format_named_by(path) if name is None else RESULTS.find_written(name)
    if form is not None:
        return form
    names = [each.name for each in RESULTS.written()]
    if name is None and path.suffix.lower() == ".h5":
        raise ResultError(f"{path.name} may be of the format deeplabcut or sleap; say which: format=... (--to ...).")
    wrong = f"No format {name!r}. " if name else f"{path.name} ends in no known format. "
    raise ResultError(wrong + (suggestion(name, names) if name else f"Formats: {choices(names)}."))


def _format_named_by(path: Path) -> ResultFormat | None:
    """Return the format selected by a path's ending; among several, a word of the file name decides."""
    suffix, stem = path.suffix.lower(), path.stem.lower()
    fitting = [form for form in RESULTS.written() if suffix in form.endings]
    by_word = next((form for form in fitting if any(word in stem for word in form.name_words)), None)
    return by_word or next((form for form in fitting if not form.name_words), None)


def person_paths(path: Path, person_ids: Sequence[str]) -> tuple[Path, ...]:
    """Return one path per person, all in the folder of ``path``; ``path`` itself for a single person.

    Raises:
        ResultError: if the result has no people.
    """
    if not person_ids:
        raise ResultError(f"Nobody is in this result: there is no person to write to {path.name}.")
    if len(person_ids) == 1:
        return (path,)
    return tuple(path.with_name(f"{path.stem}_{name}{path.suffix}") for name in safe_names(person_ids))


def _lacks(form: ResultFormat, path: Path) -> tuple[str, ...]:
    """Return which fields of a layer a file cannot contain."""
    whole = not form.lacks or path.suffix.lower() in form.complete_endings
    return () if whole else (f"{form.name} has no place for {form.lacks}.",)


def additional_names() -> dict[str, str]:
    """Formats that a command writes beside its usual ones if asked to, and what the files are called."""
    return {form.name: form.additional_name for form in RESULTS if form.additional_name}


def write_also(result: Reconstruction, folder: Path, also: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Write formats of :func:`additional_names` under their usual names; they hold the layer that TRC and C3D do.

    Returns:
        The names of files and folders, and what of the layer they have no place for.
    """
    files, notes = [], []
    for name in dict.fromkeys(also):
        form = RESULTS.find_written(name)
        if form is None or not form.additional_name:
            raise ResultError(f"No format {name!r} beside a result. {suggestion(name, additional_names())}")
        path = folder / form.additional_name
        done = write(result, path, name)
        files += [file.name for file in done.files]
        notes += done.notes if form.write_result is not None else _lacks(form, path)
    return files, tuple(notes)


def people_with_frames(result: Reconstruction) -> tuple[str, ...]:
    """Return the people who are present in some frame; edits can leave people without frames."""
    if result.tracks is None:
        return result.person_ids
    there = (np.asarray(result.tracks.state[:]) != TrackState.ABSENT).any(axis=0)
    return tuple(name for name, some in zip(result.person_ids, there, strict=True) if some)


def write_folder(
    result: Reconstruction,
    folder: Path,
    progress: Progress | None = None,
    angles: csv.Angles | None = None,
    tables: Mapping[str, Iterable[Mapping[str, np.ndarray]]] | None = None,
) -> tuple[list[str], LayerName]:
    """Write every output of a reconstruction but ``reconstruction.nc``.

    That is a CSV a layer, ``events.csv`` and ``angles.csv`` where there are such, a TRC and a C3D a person who is
    there in some frame.

    Args:
        result: what to write.
        folder: where.
        progress: receives the progress.
        angles: finds the joint angles of bodies.
        tables: what else to write, by file name: ranges of columns by name.

    Returns:
        The file names, in order, and the layer that TRC and C3D hold.
    """
    files = []
    for name in result.layers:
        file_name = csv.FILE_NAMES[name]  # type: ignore[index]
        parts = report_ranges(result.chunks(), result.n_frames, f"writing {file_name}", progress or Silent())
        csv.write(parts, folder / file_name, name)  # type: ignore[arg-type]
        files.append(file_name)
    if result.events or result.poses is not None:
        csv.write_events(result.events, folder / csv.EVENTS)
        files.append(csv.EVENTS)
    if angles is not None and angles(result.frames(0, 1))[0]:
        parts = report_ranges(result.chunks(), result.n_frames, f"writing {csv.ANGLES}", progress or Silent())
        csv.write_angles(parts, folder / csv.ANGLES, angles)
        files.append(csv.ANGLES)
    for file_name, columns in (tables or {}).items():
        csv.write_columns(columns, folder / file_name)
        files.append(file_name)
    layer, points = result.best_layer(result.options.layer)
    # Each person's files go through the frames: nothing is read that they do not hold.
    bare = replace(result, layers={layer: points}, tracks=None, swaps=None, poses=None, events=())
    people = people_with_frames(result)
    for person, stem in zip(people, safe_names(people), strict=True):
        trc.write(bare, person, folder / f"{stem}.trc", layer, progress)
        files.append(f"{stem}.trc")
        if result.unit == "m":
            c3d.write(bare, person, folder / f"{stem}.c3d", layer, progress)
            files.append(f"{stem}.c3d")
    return files, layer
