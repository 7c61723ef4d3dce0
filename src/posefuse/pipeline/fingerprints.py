"""Fingerprints of results, stored beside them, so that the same inputs and options are not reconstructed again."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from platform import python_version
from typing import Any

from posefuse.errors import choices
from posefuse.io.checkpoints import digest_of, holds_parts, key_in
from posefuse.io.files import CHECKPOINT_FOLDER, RESULT_FILES, check_folder_marker, replacing
from posefuse.io.open_recording import digest_path
from posefuse.io.outputs import exists_error
from posefuse.io.results.open_result import result_file
from posefuse.kernels import prebuilt
from posefuse.model.options.options import Options

RESULT, MARK = RESULT_FILES[:2]
_MOST_NAMES = 4


@dataclass(frozen=True)
class RecordingKeys:
    """Digests of everything that a result depends on: contents, options and versions, but no path, host or time.

    Attributes:
        result: for the whole result.
        parts: for the parts in a checkpoint, which depend on the versions of libraries, but not on edits and formats.
    """

    result: str
    parts: str


@dataclass(frozen=True)
class Mark:
    """The content of the file that marks a complete result.

    Attributes:
        key: :attr:`RecordingKeys.result`.
        result: digest of ``reconstruction.nc``.
        files: names of the files and folders of the result.
        remembered: what the caller of the reconstruction stores, as JSON values.
    """

    key: str
    result: str
    files: tuple[str, ...]
    remembered: Mapping[str, Any]


def fingerprint(inputs: Mapping[str, str], options: Options, **more: object) -> str:
    """Return a digest of what a result depends on.

    Args:
        inputs: names and digests of the inputs.
        options: options of the reconstruction; files that they name count by their content.
        more: further JSON values.
    """
    values = asdict(options)
    # Paths of files differ between machines.
    if options.skeleton and options.skeleton.endswith(".toml") and Path(options.skeleton).is_file():
        values["skeleton"] = digest_path(Path(options.skeleton))
    static = None if options.subject.static is None else result_file(Path(options.subject.static))
    if static is not None and static.is_file():
        values["subject"]["static"] = digest_path(static)
    whole = {"inputs": dict(inputs), "options": values, "posefuse": version("posefuse"), **more}
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def recording_keys(
    digests: Mapping[str, str],
    options: Options,
    *,
    edits: Path | None = None,
    also: Sequence[str] = (),
    window_s: float | None = None,
) -> RecordingKeys:
    """Return the keys of a reconstruction.

    Args:
        digests: file name to digest of each input, from :func:`posefuse.io.open_recording.input_digests`.
        options: options of the reconstruction.
        edits: file of edits to apply to the result.
        also: further formats to write.
        window_s: length of the windows into which the recording is divided, or None.
    """
    versions = {name: version(name) for name in ("numpy", "numba", "llvmlite", "scipy")} | {"python": python_version()}
    # Kernels that are compiled on the machine can differ in the last digits.
    versions["kernels"] = "of the machine" if prebuilt.why_unused() else "of the package"
    edited = "" if edits is None else digest_path(edits)
    common = fingerprint(digests, options, window_s=window_s)
    result = fingerprint(digests, options, window_s=window_s, also=sorted(set(also)), edits=edited)
    return RecordingKeys(result, digest_of({"recording": common, "versions": versions}))


def write_mark(folder: Path, key: str, files: Sequence[str], remembered: Mapping[str, Any]) -> None:
    """Mark a result as complete.

    Args:
        folder: folder of the result.
        key: :attr:`RecordingKeys.result`.
        files: names of the files and folders of the result.
        remembered: further JSON values to store.
    """
    mark = Mark(key, digest_path(folder / RESULT), tuple(files), remembered)
    with replacing(folder / MARK) as temporary:
        temporary.write_text(json.dumps(asdict(mark), indent=1, sort_keys=True) + "\n", "utf-8")


def read_mark(folder: Path) -> Mark | None:
    """Return the mark of a result, or None if there is none or it is damaged."""
    try:
        values = json.loads((folder / MARK).read_text("utf-8"))
        return Mark(**{**values, "files": tuple(values["files"])})
    except (OSError, ValueError, TypeError, KeyError):
        return None


def find_earlier(output: Path, candidates: Sequence[RecordingKeys]) -> Mark | None:
    """Return the mark of a complete earlier result of the same inputs and options.

    Args:
        output: folder of the result, which exists and is not empty.
        candidates: keys that count as the same.

    Returns:
        The mark; None if the reconstruction is to be run: its checkpoint is there, some of its files are missing, or an
        interrupted run stored nothing.

    Raises:
        OutputExistsError: if the folder contains another result, or the checkpoint of another reconstruction.
        FileError: if the folder contains other files.
    """
    mark, file = read_mark(output), output / RESULT
    names = check_folder_marker(output, RESULT if mark is None else MARK)
    if mark is not None and mark.key in [keys.result for keys in candidates]:
        if not file.is_file():
            return None
        if digest_path(file) == mark.result:
            return mark if all((output / name).exists() for name in mark.files) else None
    parts = output / CHECKPOINT_FOLDER
    if parts.is_dir() and key_in(parts) in [keys.parts for keys in candidates]:
        return None
    found = sorted((name for name in names if name != CHECKPOINT_FOLDER), key=lambda name: name != RESULT)
    if not found and not holds_parts(parts):
        # A run was interrupted before it stored its first part.
        return None
    what = f"a result ({choices(found, _MOST_NAMES)})" if found else "an unfinished reconstruction"
    raise exists_error(f"{output} already contains {what} of other inputs, options or versions")


def is_occupied(output: Path) -> bool:
    """Return whether a folder exists and is not empty."""
    return output.is_dir() and any(output.iterdir())
