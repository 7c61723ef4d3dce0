"""One ``.npz`` per person with the arrays of :mod:`posefuse.io.results.freemocap`, named by their file names.

Lengths are in mm, as in FreeMoCap. ``numpy.load`` reads the file without pickles; ``head`` is the JSON text that
describes the arrays.
"""

import zipfile
from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import check_unpacked_size, must_exist, reading, replacing
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.freemocap import Array, arrays_of, description_of, points_of, write_npy
from posefuse.io.results.rows import rows_of
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.stored_points import StoredPoints

_HEAD = "head"


def write(result: Reconstruction, person: str, path: Path, layer: LayerName) -> None:
    """Write one person.

    Raises:
        ResultError: if there are no frames, or the result comes from a single camera.
    """
    _require(ResultFacts.of(result))
    head = np.array(description_of(result, person, layer))
    arrays = [*arrays_of(result, person, layer), Array(_HEAD, (), head.dtype, lambda: iter([head]))]
    with (
        replacing(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        for array in arrays:
            # Entries of a zip have dates; an entry created by name alone always has the same one.
            entry = zipfile.ZipInfo(f"{array.name.rsplit('/')[-1]}.npy")
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as file:
                write_npy(file, array)


def matches(path: Path) -> bool:
    """Return whether a file was written by posefuse."""
    try:
        with zipfile.ZipFile(path) as archive:
            return f"{_HEAD}.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def read(path: Path) -> StoredPoints:
    """Read a file that posefuse wrote.

    Raises:
        FileError: if it is not such a file, or corrupt.
    """
    must_exist(path, ".npz file")
    with reading(path, ".npz file"):
        _check_size(path)
        with np.load(path, allow_pickle=False) as content:
            if _HEAD not in content:
                raise FileError(f"{path} is an .npz file that posefuse did not write: it has no array {_HEAD!r}.")
            return points_of(path, str(content[_HEAD]), lambda name: content[name.rsplit("/")[-1]])


def _check_size(path: Path) -> None:
    """Check the decompressed size, because a small file could expand to any size."""
    with zipfile.ZipFile(path) as archive:
        check_unpacked_size(path, sum(entry.file_size for entry in archive.infolist()))


def _require(facts: ResultFacts) -> None:
    facts.require_meters("npz")
    rows_of(facts, "npz")


FORMAT = ResultFormat(
    name="npz",
    files="*.npz, one per person",
    conventions="FreeMoCap's arrays by name; mm, world axes; one row per frame",
    require=_require,
    additional_name="points.npz",
    endings=(".npz",),
    holds_measured_layer=True,
    matches=matches,
    read=read,
    write_person=write,
)
