"""Results on an object store: files first, then the mark by which a later batch recognizes a complete result.

The mark, ``upload.json``, lists every file with the size and version that the store states. While a recording is being
processed, it says *running* and lists the files of the finished stages, from which another worker continues; *complete*
is written last. Stores cannot replace several files at once, so a result without this word must not be used.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from posefuse.batch.scratch import require_space, scratch_folder
from posefuse.errors import FileError, StoreError, choices
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.io.object_stores import download, joined, list_files, name_of, read_stored, remove, upload, write_stored
from posefuse.io.project import PROJECT_FILE
from posefuse.model.batch import JobResult, ResultStatistics, StoredFile

RunTasks = Callable[[Callable[[Any], None], Sequence[Any]], None]
"""Calls a function with each of some values, on workers."""

UPLOAD_MARK = "upload.json"
_RUNNING, _COMPLETE = "running", "complete"
_UNFINISHED = (0, "")
"""Size and version of a file whose upload may not be complete."""
_MOST_NAMES = 4


@dataclass(frozen=True)
class UploadMark:
    """The content of the mark.

    Attributes:
        state: running or complete.
        key: digest of what the result depends on: listed files, options and version.
        files: size and version of each file, by its name relative to the folder.
        result: the result of the job, as JSON values; None while it is running.
    """

    state: str
    key: str
    files: Mapping[str, tuple[int, str]]
    result: Mapping[str, Any] | None = None

    def intact(self, listed: Mapping[str, StoredFile]) -> dict[str, StoredFile]:
        """Return those of the files that the store still lists as they were uploaded."""
        return {
            name: listed[name]
            for name, (size, version) in self.files.items()
            if name in listed and (listed[name].size, listed[name].version) == (size, version)
        }


def read_upload_mark(url: str) -> UploadMark | None:
    """Return the mark of a folder, or None if it has none or it is damaged.

    Raises:
        StoreError: if the store does not answer, or denies access.
    """
    content = read_stored(joined(url, UPLOAD_MARK))
    try:
        values = json.loads(content or b"null")
        files = {str(name): (int(size), str(version)) for name, (size, version) in values["files"].items()}
        return UploadMark(values["state"], values["key"], files, values["result"])
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def is_complete(url: str) -> bool:
    """Return whether a folder has a complete result."""
    mark = read_upload_mark(url)
    return mark is not None and mark.state == _COMPLETE


@dataclass
class StoredResult:
    """The result of a job on an object store, and its local copy.

    Attributes:
        url: folder of the result.
        folder: local copy.
        key: digest of what the result depends on.
        places: local folders that files of the result may name, and the URLs that they are copies of.
    """

    url: str
    folder: Path
    key: str
    places: Mapping[Path, str]
    _uploaded: dict[str, tuple[int, int]] = field(default_factory=dict)
    _listed: dict[str, StoredFile] = field(default_factory=dict)
    _mark: UploadMark | None = None
    _owned: set[str] = field(default_factory=set)

    def examine(self) -> JobResult | None:
        """Look at the store, and return the earlier result if it is complete and nothing that it depends on changed.

        Raises:
            FileError: if the folder has other files and is not a result.
            StoreError: if the store does not answer, or denies access.
        """
        self._listed, self._mark = list_files(self.url), None
        if UPLOAD_MARK in self._listed:
            self._mark = read_upload_mark(self.url)
            self._owned = set() if self._mark is None else set(self._mark.files)
        elif self._listed:
            raise FileError(
                f"`output`: {self.url} already contains other files ({choices(self._listed, _MOST_NAMES)}) and is not "
                "a result of a batch. Choose a new or empty folder."
            )
        mark = self._mark
        if mark is None or mark.result is None or (mark.state, mark.key) != (_COMPLETE, self.key):
            return None
        return _result_of(mark.result) if len(mark.intact(self._listed)) == len(mark.files) else None

    def fetch(self) -> None:
        """Copy what an earlier run uploaded, so that it is continued, or replaced by the rules of local results.

        Raises:
            FileError: if the copy does not fit on the disk.
            StoreError: if the store does not answer, or denies access.
        """
        found = {} if self._mark is None else self._mark.intact(self._listed)
        # Workers of a divided recording upload its parts, which contain their own digests, without the mark.
        found |= {name: file for name, file in self._listed.items() if _is_part(name)}
        require_space(self.folder.parent, sum(file.size for file in found.values()), self.url)
        download({self.folder / name: file for name, file in found.items()})
        self._uploaded = {name: state for name, state in self._local_files().items() if name in found}

    def upload_changes(self) -> None:
        """Upload what changed since the last call, and mark it as the files of finished stages.

        Raises:
            StoreError: if the store has no such bucket, does not answer, or denies access.
        """
        self._write(_RUNNING, None)

    def finish(self, result: JobResult) -> None:
        """Upload everything, remove files of earlier results, and mark the result as complete.

        Raises:
            StoreError: if the store has no such bucket, does not answer, or denies access.
        """
        state = "done" if result.state == "kept" else result.state
        self._write(_COMPLETE, {**asdict(result), "state": state})

    def run_elsewhere(self, run: RunTasks, work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        """Run pieces of a divided recording on workers, which find them on the store.

        Args:
            run: calls a function with each of some values, on workers.
            work: processes a piece.
            pieces: files in the local copy, whose results are written beside them.
        """
        self.upload_changes()
        names = [piece.relative_to(self.folder).as_posix() for piece in pieces]
        run(partial(run_stored_piece, work), [joined(self.url, name) for name in names])
        listed = list_files(self.url)
        parts = [name.rpartition(".")[0] + ".part" for name in names]
        download({self.folder / name: listed[name] for name in parts if name in listed})
        self._uploaded |= {name: state for name, state in self._local_files().items() if name in parts}

    def _write(self, state: str, result: Mapping[str, Any] | None) -> None:
        local = self._local_files()
        changed = [name for name, known in local.items() if self._uploaded.get(name) != known]
        if changed and (self._mark is None or self._mark.state == _COMPLETE):
            # Names what is about to be uploaded, so that these files are recognized after a crash.
            begun = (
                {} if self._mark is None else {name: known for name, known in self._mark.files.items() if name in local}
            )
            self._write_mark(UploadMark(_RUNNING, self.key, begun | dict.fromkeys(changed, _UNFINISHED)))
        with scratch_folder() as scratch:
            upload({joined(self.url, name): self._portable(name, scratch) for name in changed})
        self._uploaded = local
        listed = list_files(self.url)
        lost = [name for name in local if name not in listed or not self._has_size(name, listed[name].size)]
        if lost:
            raise StoreError(f"{self.url} lacks what was uploaded: {choices(lost, _MOST_NAMES)}.", transient=True)
        if state == _COMPLETE:
            stale = [name for name in listed if name not in local and (name in self._owned or _is_part(name))]
            remove(listed[name].url for name in stale)
        files = {name: (listed[name].size, listed[name].version) for name in sorted(local)}
        self._write_mark(UploadMark(state, self.key, files, result))

    def _has_size(self, name: str, size: int) -> bool:
        """Return whether a file has a size; that of the project file depends on the names of folders."""
        return name == PROJECT_FILE or self._uploaded[name][0] == size

    def _write_mark(self, mark: UploadMark) -> None:
        content = json.dumps(asdict(mark), indent=1, sort_keys=True) + "\n"
        write_stored(joined(self.url, UPLOAD_MARK), content.encode())
        self._mark = mark
        self._owned |= mark.files.keys()

    def _local_files(self) -> dict[str, tuple[int, int]]:
        """Return size and time of change of each complete file, by its name."""
        found = {}
        for path in sorted(self.folder.rglob("*")):
            if path.is_file() and ".partial" not in path.name:
                status = path.stat()
                found[path.relative_to(self.folder).as_posix()] = (status.st_size, status.st_mtime_ns)
        return found

    def _portable(self, name: str, scratch: Path) -> Path:
        """Return a file to upload; the project file of a run names URLs instead of their local copies."""
        if name != PROJECT_FILE:
            return self.folder / name
        text = (self.folder / name).read_text("utf-8")
        for path, url in self.places.items():
            text = text.replace(str(path), url)
        (scratch / name).write_text(text, "utf-8")
        return scratch / name


def run_stored_piece(work: Callable[[Path], None], url: str) -> None:
    """Process a piece of a divided recording that lies on an object store, and upload its result beside it.

    Raises:
        StoreError: if the piece is missing, or the store does not answer.
    """
    with scratch_folder() as scratch:
        content = read_stored(url)
        if content is None:
            raise StoreError(f"{url} was removed while it was needed.")
        piece = scratch / name_of(url)
        piece.write_bytes(content)
        work(piece)
        part = piece.with_suffix(".part")
        upload({joined(url.rpartition("/")[0], part.name): part})


def _is_part(name: str) -> bool:
    return CHECKPOINT_FOLDER in name.split("/")


def _result_of(values: Mapping[str, Any]) -> JobResult:
    """Return the result of an earlier run."""
    statistics = values["statistics"]
    return JobResult(
        values["name"],
        "kept" if values["state"] == "done" else values["state"],
        values["why"],
        None if statistics is None else ResultStatistics(**statistics),
        tuple(values["warnings"]),
        values["report"],
    )
