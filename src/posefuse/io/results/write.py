"""Write results in any format."""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from posefuse.errors import PosefuseWarning, ResultError, choices, suggestion
from posefuse.io.registry import RESULTS
from posefuse.io.results import c3d, csv, figures, netcdf, openpose, opensim, trc
from posefuse.model.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import TrackState
from posefuse.progress import Progress, Silent, watched

_BY_SUFFIX = {
    ".nc": "netcdf", ".csv": "csv", ".trc": "trc", ".c3d": "c3d", ".bvh": "bvh", ".glb": "gltf", ".gltf": "gltf",
}  # fmt: skip
_FORMATS = tuple(form.name for form in RESULTS if form.writes)


def write(result: Reconstruction, path: str | Path, format: str | None = None) -> None:  # noqa: A002
    """Write a result to a file.

    netcdf holds everything. csv, trc and c3d hold one layer: the one ``result.options.layer`` names, or the best
    present. trc, c3d, bvh and gltf hold one person; a result of several is written to ``<stem>_<person><suffix>``
    each. bvh and gltf hold the articulated bodies. What a format cannot hold is warned of.

    Args:
        result: what to write.
        path: the file, or of opensim and openpose a folder; it appears when it is whole.
        format: netcdf, csv, trc, c3d, bvh, gltf, opensim or openpose; by default what the path's ending says.

    Raises:
        ResultError: if there is no such format, or it cannot hold the result.
    """
    path = Path(path)
    name = format or _BY_SUFFIX.get(path.suffix.lower())
    if name not in _FORMATS:
        wrong = f"No format {name!r}. " if name else f"{path.name} ends in no known format. "
        raise ResultError(wrong + (suggestion(name, _FORMATS) if name else f"Formats: {choices(_FORMATS)}."))
    layer, _ = result.best_layer(result.options.layer)
    if name == "netcdf":
        netcdf.write(result.chunks(), path)
    elif name == "csv":
        csv.write(result.chunks(), path, layer)
    elif name in figures.FORMATS:
        _say(figures.write_people(result, people_with_frames(result), path, name))
    elif name == "opensim":
        _say(opensim.write(result, people_with_frames(result), path, layer))
    elif name == "openpose":
        _say(openpose.write(result, path, layer))
    else:
        for person in result.person_ids:
            target = path if len(result.person_ids) == 1 else path.with_stem(f"{path.stem}_{person}")
            (trc if name == "trc" else c3d).write(result, person, target, layer)


def _say(notes: Iterable[str]) -> None:
    """Warn of what a format cannot hold."""
    for note in notes:
        warnings.warn(note, PosefuseWarning, stacklevel=3)


def people_with_frames(result: Reconstruction) -> tuple[str, ...]:
    """Who is there in some frame: edits can leave a name without any."""
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
        progress: told how far the work is.
        angles: finds the joint angles of bodies.
        tables: what else to write, by file name: ranges of columns by name.

    Returns:
        The file names, in order, and the layer that TRC and C3D hold.
    """
    files = []
    for name in result.layers:
        file_name = csv.FILE_NAMES[name]  # type: ignore[index]
        parts = watched(result.chunks(), result.n_frames, f"writing {file_name}", progress or Silent())
        csv.write(parts, folder / file_name, name)  # type: ignore[arg-type]
        files.append(file_name)
    if result.events or result.poses is not None:
        csv.write_events(result.events, folder / csv.EVENTS)
        files.append(csv.EVENTS)
    if angles is not None and angles(result.frames(0, 1))[0]:
        parts = watched(result.chunks(), result.n_frames, f"writing {csv.ANGLES}", progress or Silent())
        csv.write_angles(parts, folder / csv.ANGLES, angles)
        files.append(csv.ANGLES)
    for file_name, columns in (tables or {}).items():
        csv.write_columns(columns, folder / file_name)
        files.append(file_name)
    layer, points = result.best_layer(result.options.layer)
    # Each person's files go through the frames: nothing is read that they do not hold.
    bare = replace(result, layers={layer: points}, tracks=None, swaps=None, poses=None, events=())
    for person in people_with_frames(result):
        trc.write(bare, person, folder / f"{person}.trc", layer, progress)
        files.append(f"{person}.trc")
        if result.unit == "m":
            c3d.write(bare, person, folder / f"{person}.c3d", layer, progress)
            files.append(f"{person}.c3d")
    return files, layer
