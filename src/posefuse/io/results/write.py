"""Write results in any supported format."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError, choices, suggestion
from posefuse.io.files import check_texts
from posefuse.io.outputs import check_new_files, check_new_folder, replacing_together
from posefuse.io.results import c3d, csv, mot, trc
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.names import safe_names
from posefuse.io.results.registry import RESULTS
from posefuse.io.results.timing import export_rate
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.progress import Progress, Silent

Table = Callable[[Reconstruction], Iterable[Mapping[str, np.ndarray]]]
"""Returns a table of a result, as ranges of columns by name. A function of a module, or a partial call of one."""


@dataclass(frozen=True)
class WrittenResult:
    """The files of a written result.

    Attributes:
        files: written files in order, or the folder for formats of many files.
        layer: layer in the files, or None if they have all layers.
        notes: notes on what the files do not contain, in sentences.
    """

    files: tuple[Path, ...]
    layer: LayerName | None
    notes: tuple[str, ...]


@checked
def write(
    result: Reconstruction,
    path: str | Path,
    format: str | None = None,  # noqa: A002
    *,
    overwrite: bool = False,
) -> WrittenResult:
    """Write a result to a file.

    A netcdf file holds the whole result. The other formats hold one layer: the one that ``result.options.layer`` names,
    or the best available one. Files of trc, c3d, anipose, npz, freemocap, bvh and gltf hold one person; several people
    are written to one file ``<stem>_<person><suffix>`` each. bvh and gltf hold the articulated fit.

    Args:
        result: the result to write.
        path: the file, or the folder for freemocap, opensim and openpose; created only once it is complete.
        format: a name that ``posefuse formats`` lists; by default selected by the ending of the path and, if several
            formats share the ending, by a word in the file name (anipose, dlc, movement, points3d).
        overwrite: whether to replace files, or the content of the folder, of an earlier call.

    Returns:
        The written files, and notes on what they do not contain.

    Raises:
        ResultError: if there is no such format, or it cannot hold the result.
        FileError: if a name in the result is not valid text, or the file cannot be written.
        OutputExistsError: if the path exists and ``overwrite`` is False.
    """
    path = Path(path)
    check_texts([*result.person_ids, *result.rig.names, *result.skeleton.keypoints, result.skeleton.name])
    form = _format_of(path, format)
    if not result.has_identities:
        require_stills_format(form)
    layer, _ = result.best_layer(result.options.layer)
    people = result.person_ids if form.write_person is not None else people_with_frames(result)
    one_each = form.write_person is not None or form.write_figure is not None
    files = person_paths(path, people) if one_each else (path,)
    if form.is_folder:
        for folder in files:
            check_new_folder(folder, overwrite=overwrite, target="`path`")
    else:
        check_new_files(files, overwrite=overwrite, target="`path`")
    # A format writes a single file or folder only when it is complete.
    staged = nullcontext(files) if form.is_folder or len(files) == 1 else replacing_together(files)
    with staged as targets:
        if form.write_figure is not None or form.write_result is not None:
            notes = _write_bodies(result, people, targets, form, layer)
        else:
            notes = _write_layer(result, targets, form, layer)
    if form.write_figure is not None:
        layer = "model"
    return WrittenResult(files, None if form.holds_every_layer else layer, notes)


def _write_layer(
    result: Reconstruction, files: Sequence[Path], form: ResultFormat, layer: LayerName
) -> tuple[str, ...]:
    """Write formats of one layer, and return notes."""
    # They must not read the other layers; some also hold the measured layer.
    layers = {layer: result.layers[layer]}
    if form.holds_measured_layer and "measured" in result.layers:
        layers = {"measured": result.layers["measured"], **layers}
    bare = replace(result, layers=layers, tracks=None, swaps=None, poses=None, events=())
    if form.write_person is not None:
        for person, file in zip(result.person_ids, files, strict=True):
            form.write_person(bare, person, file, layer)
    elif form.write_layer is not None:
        form.write_layer(bare, files[0], layer)
    others = _others(result, layer)
    omissions = (f"{form.name} contains the layer {layer}, without {choices(others)}.",) if others else ()
    return (*omissions, *_lacks(form, result, files[0]))


def require_stills_format(form: ResultFormat) -> None:
    """Refuse a format that follows people over time for unrelated frames.

    Raises:
        ResultError: if the format is one of these.
    """
    if not form.holds_stills:
        raise ResultError(
            f"The format {form.name} follows each person over time, but the frames are unrelated (`people='stills'`). "
            f"Formats: {choices([each.name for each in RESULTS.written() if each.holds_stills])}."
        )


def _others(result: Reconstruction, layer: LayerName) -> list[str]:
    """Return the parts of a result that a file with one layer does not contain."""
    parts = {
        "articulated fit": result.poses is not None,
        "detections of each track": result.tracks is not None,
        "left/right swaps": result.swaps is not None,
        "events": bool(result.events),
    }
    return [
        *(name for name in result.layers if name != layer),
        *(name for name, is_present in parts.items() if is_present),
    ]


def _write_bodies(
    result: Reconstruction, people: Sequence[str], files: Sequence[Path], form: ResultFormat, layer: LayerName
) -> tuple[str, ...]:
    """Write formats that need more than one layer of a result, and return notes."""
    if form.write_figure is None:
        assert form.write_result is not None
        return tuple(form.write_result(result, people, files[0], layer))
    notes = [
        note for person, file in zip(people, files, strict=True) for note in form.write_figure(result, person, file)
    ]
    return tuple(dict.fromkeys(notes))


def _format_of(path: Path, name: str | None) -> ResultFormat:
    """Return the format with a name, or the one selected by the path."""
    form = _format_named_by(path) if name is None else RESULTS.find_written(name)
    if form is not None:
        return form
    names = [each.name for each in RESULTS.written()]
    if name is None and path.suffix.lower() == ".h5":
        raise ResultError(f"{path.name} may be in the format deeplabcut or sleap. Choose one with `format`.")
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
        raise ResultError(f"This result contains no people: there is nothing to write to {path.name}.")
    if len(person_ids) == 1:
        return (path,)
    return tuple(path.with_name(f"{path.stem}_{name}{path.suffix}") for name in safe_names(person_ids))


def _lacks(form: ResultFormat, result: Reconstruction, path: Path) -> tuple[str, ...]:
    """Return which fields of a layer a file cannot contain."""
    whole = not form.lacks or path.suffix.lower() in form.complete_endings
    remarks = () if form.remarks is None else form.remarks(result)
    return remarks if whole else (f"{form.name} cannot hold {form.lacks}.", *remarks)


def additional_names() -> dict[str, str]:
    """Return the file or folder name of each format that ``--also`` offers, by format."""
    return {form.name: form.additional_name for form in RESULTS if form.additional_name}


def require_formats(also: Sequence[str], facts: ResultFacts) -> None:
    """Refuse formats that cannot hold a result, before the result is made.

    Raises:
        ResultError: if a format cannot hold a result with these facts.
        FileError: if a name in the result is not a valid file name.
    """
    for name in also:
        form = RESULTS.find_written(name)
        if form is None:
            continue
        if not facts.has_identities:
            require_stills_format(form)
        if form.require is not None:
            form.require(facts)


def write_also(result: Reconstruction, folder: Path, also: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Write formats of :func:`additional_names` under their default names, with the same layer as TRC and C3D.

    Returns:
        The names of the files and folders, and notes on what they do not contain and which formats could not be
        written, such as those of a result without people.

    Raises:
        ResultError: if a format is not offered.
    """
    files, notes = [], []
    for name in dict.fromkeys(also):
        form = RESULTS.find_written(name)
        if form is None or not form.additional_name:
            raise ResultError(f"`also`: unknown format {name!r}. {suggestion(name, additional_names())}")
        path = folder / form.additional_name
        try:
            written = write(result, path, name)
        except ResultError as error:
            notes.append(f"{name} was not written: {error}")
            continue
        files += [file.name for file in written.files]
        notes += written.notes if form.write_result is not None else _lacks(form, result, path)
    return files, tuple(notes)


def people_with_frames(result: Reconstruction) -> tuple[str, ...]:
    """Return the people who are present in some frame; edits can leave people without frames."""
    if result.tracks is None:
        return result.person_ids
    present = (np.asarray(result.tracks.state[:]) != TrackState.ABSENT).any(axis=0)
    return tuple(name for name, is_present in zip(result.person_ids, present, strict=True) if is_present)


@dataclass(frozen=True)
class OutputFile:
    """A file of a result's folder, written independently of the others.

    Attributes:
        name: name of the file, or what the notes of several files are about.
        write: writes it from the result into the folder; returns the names of the files, and notes on what they do not
            contain. A function of a module, or a partial call of one.
    """

    name: str
    write: Callable[[Reconstruction, Path], tuple[Sequence[str], Sequence[str]]]


def write_files(
    result: Reconstruction, files: Sequence[OutputFile], folder: Path, progress: Progress, jobs: Jobs = ONE_JOB
) -> tuple[list[str], list[str]]:
    """Write files into the folder of a result.

    Args:
        result: the result to write.
        files: the files.
        folder: output folder.
        progress: receives the progress.
        jobs: processes that write.

    Returns:
        The names of the files, in order, and notes on what they do not contain.
    """
    names: list[str] = []
    notes: list[str] = []
    progress.start("writing files", len(files))
    # All files are begun: the first one may take as long as all others together.
    for written, remarks in jobs.in_order(_write_file, ((file, result, folder) for file in files), len(files)):
        names += written
        notes += remarks
        progress.advance(1)
    progress.finish()
    return names, list(dict.fromkeys(notes))


def _write_file(piece: tuple[OutputFile, Reconstruction, Path]) -> tuple[Sequence[str], Sequence[str]]:
    file, result, folder = piece
    return file.write(result, folder)


def default_files(
    result: Reconstruction, tables: Mapping[str, Table] | None = None, movements: Sequence[Event] = ()
) -> tuple[list[OutputFile], tuple[str, ...]]:
    """Return every default output of a reconstruction except ``reconstruction.nc``, figures and report.

    The outputs are one CSV per layer, ``events.csv`` and ``angles.csv`` if the result has events or angles, and one TRC
    and one C3D per person who is present in some frame, unless frames are unrelated.

    Args:
        result: the result to write.
        tables: additional tables by file name.
        movements: events of movements, such as heel strikes, that ``events.csv`` also lists.

    Returns:
        The files, and a note if TRC and C3D cannot be written.
    """
    layers: list[LayerName] = [name for name in csv.FILE_NAMES if name in result.layers]
    files = [OutputFile(csv.FILE_NAMES[name], partial(_write_layer_table, name)) for name in layers]
    if result.events or movements or result.poses is not None:
        files.append(OutputFile(csv.EVENTS, partial(_write_events, tuple(movements))))
    if result.joint_angles is not None:
        files.append(OutputFile(csv.ANGLES, _write_angles))
    files += [OutputFile(name, partial(_write_table, name, columns)) for name, columns in (tables or {}).items()]
    if not result.has_identities:
        return files, ()
    people = people_with_frames(result)
    try:
        if people:
            export_rate(result, "TRC or C3D")
    except ResultError as error:
        return files, (f"{error} None was written.",)
    for person, stem in zip(people, safe_names(people), strict=True):
        ends = ["trc", *(["mot"] if mot.has_coordinates(result) else []), *(["c3d"] if result.unit == "m" else [])]
        files += [OutputFile(f"{stem}.{end}", partial(_write_person, end, person, stem)) for end in ends]
    return files, ()


def _write_layer_table(name: LayerName, result: Reconstruction, folder: Path) -> tuple[Sequence[str], Sequence[str]]:
    file_name = csv.file_name(csv.FILE_NAMES[name], _n_bodies(result) * len(result.skeleton))
    csv.write(result.windows(), folder / file_name, name)
    return (file_name,), ()


def _write_events(
    movements: tuple[Event, ...], result: Reconstruction, folder: Path
) -> tuple[Sequence[str], Sequence[str]]:
    csv.write_events(sorted([*result.events, *movements], key=lambda event: event.number), folder / csv.EVENTS)
    return (csv.EVENTS,), ()


def _write_angles(result: Reconstruction, folder: Path) -> tuple[Sequence[str], Sequence[str]]:
    assert result.joint_angles is not None
    file_name = csv.file_name(csv.ANGLES, _n_bodies(result) * len(result.joint_angles.names))
    csv.write_angles(result.windows(), folder / file_name)
    return (file_name,), ()


def _n_bodies(result: Reconstruction) -> int:
    return result.n_frames * len(result.person_ids)


def _write_table(
    name: str, columns: Table, result: Reconstruction, folder: Path
) -> tuple[Sequence[str], Sequence[str]]:
    csv.write_table(columns(result), folder / name)
    return (name,), ()


def _write_person(
    end: str, person: str, stem: str, result: Reconstruction, folder: Path
) -> tuple[Sequence[str], Sequence[str]]:
    """Write a file of one person in the best layer."""
    layer, points = result.best_layer(result.options.layer)
    # The frames are read once per file, so the other layers are left out.
    bare = replace(result, layers={layer: points}, tracks=None, swaps=None, poses=None, events=(), joint_angles=None)
    path = folder / f"{stem}.{end}"
    if end == "mot":
        mot.write(replace(bare, joint_angles=result.joint_angles), person, path, layer)
    else:
        {"trc": trc, "c3d": c3d}[end].write(bare, person, path, layer)
    return (path.name,), ()


def write_folder(
    result: Reconstruction,
    folder: Path,
    progress: Progress | None = None,
    tables: Mapping[str, Table] | None = None,
    movements: Sequence[Event] = (),
) -> tuple[list[str], LayerName, tuple[str, ...]]:
    """Write the files of :func:`default_files`, whose arguments these are, into a folder.

    Returns:
        The file names, in order, the layer in TRC and C3D, and a note if they could not be written.
    """
    files, notes = default_files(result, tables, movements)
    names, _ = write_files(result, files, folder, progress or Silent())
    return names, result.best_layer(result.options.layer)[0], notes
