"""Process a job whose recording or result is on an object store, on local copies.

A worker downloads the recording into a temporary folder, runs the same recipe as for local folders, and uploads the
result. Nothing is downloaded if the store lists the files of an earlier complete result and of its inputs unchanged.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Protocol

from posefuse.batch.scratch import require_space, scratch_folder
from posefuse.batch.stored_result import RunTasks, StoredResult
from posefuse.errors import FileError
from posefuse.io.object_stores import download, is_url, list_files, name_of
from posefuse.io.open_recording import digest_path
from posefuse.model.batch import Job, JobResult, Place, StoredFile
from posefuse.model.options.run import RunOptions
from posefuse.pipeline.distributed import RunPieces
from posefuse.pipeline.fingerprints import fingerprint

FILE_OPTIONS = ("calibration", "board", "intrinsics", "keypoints", "timestamps", "synchronize")
"""Options of a run that may name a file."""


class Result(Protocol):
    """Where the result of a job goes."""

    def upload_changes(self) -> None:
        """Make the files of finished stages available to other workers."""
        ...

    def pieces(self, run: RunTasks) -> RunPieces:
        """Return a function that runs the pieces of a divided recording."""
        ...


class LocalResult:
    """A result in a local folder, which all workers see under the same path."""

    def upload_changes(self) -> None:
        """Do nothing: the files are there."""

    def pieces(self, run: RunTasks) -> RunPieces:
        """Return the function as it is: workers see the pieces under the same paths."""
        return run


class _UploadedResult:
    def __init__(self, stored: StoredResult) -> None:
        self.stored = stored

    def upload_changes(self) -> None:
        self.stored.upload_changes()

    def pieces(self, run: RunTasks) -> RunPieces:
        return lambda work, pieces: self.stored.run_elsewhere(run, work, pieces)


Work = Callable[[Job, Result], JobResult | None]
"""Processes a job in local folders; returns None for a long recording that is to be divided."""


def on_copies(job: Job, work: Work) -> JobResult | None:
    """Process a job, on local copies of what is on an object store.

    Raises:
        StoreError: if a store has no such bucket, does not answer, or denies access.
        FileError: if there are no files of the recording, or the copies do not fit on the disk.
        OutputExistsError: if there is an earlier result that the job may not replace.
    """
    if not any(is_url(place) for place in (job.folder, job.output, *_given(job).values())):
        return work(job, LocalResult())
    with scratch_folder() as scratch:
        copies = _Copies(job, scratch)
        local = copies.job()
        if not is_url(job.output):
            copies.fetch()
            return work(local, LocalResult())
        assert isinstance(local.output, Path)
        stored = StoredResult(job.output, local.output, copies.key(), copies.places)
        earlier = stored.examine()
        if earlier is not None and not job.treatment.again:
            return earlier
        copies.fetch()
        local.output.mkdir(parents=True)
        if not job.treatment.again:
            stored.fetch()
        result = work(local, _UploadedResult(stored))
        if result is not None and result.statistics is not None:
            stored.finish(result)
        elif result is None:
            stored.upload_changes()
        return result


class _Copies:
    """Local copies of the inputs of a job.

    Attributes:
        places: folders of copies, and the URLs that they are copies of.
    """

    def __init__(self, job: Job, scratch: Path) -> None:
        self._job, self._scratch = job, scratch
        self._inputs: dict[str, StoredFile] = {}
        self._files: dict[Path, StoredFile] = {}
        self.places: dict[Path, str] = {}
        self._local = self._planned()

    def job(self) -> Job:
        """Return the job with local paths."""
        return self._local

    def key(self) -> str:
        """Return the digest of what the result depends on, as far as it is known without downloading anything."""
        job = self._job
        inputs = {url: f"{file.size} {file.version}" for url, file in self._inputs.items()}
        for name, place in {"recording": job.folder, **_given(job)}.items():
            if not is_url(place) and Path(place).exists():
                inputs[name] = digest_path(Path(place))
        more = {"window_s": job.window_s, "board": job.board, "accepted": job.treatment.accept_findings}
        return fingerprint(inputs, job.options, run=None if job.run is None else asdict(job.run), **more)

    def fetch(self) -> None:
        """Download the inputs.

        Raises:
            StoreError: if the store does not answer, or denies access.
            FileError: if they do not fit on the disk.
        """
        require_space(self._scratch, sum(file.size for file in self._files.values()), str(self._job.folder))
        download(self._files)

    def _planned(self) -> Job:
        job, scratch = self._job, self._scratch
        folder = self._recording() if is_url(job.folder) else job.folder
        given = {name: self._file(name, place) for name, place in _given(job).items()}
        run = job.run
        if run is not None:
            weights = tuple(str(given[f"weights {i}"]) for i in range(len(run.detect.weights)))
            names = {name: str(given[name]) for name in FILE_OPTIONS if name in given}
            run = replace(run, **names, detect=replace(run.detect, weights=weights))
        board = str(given["job board"]) if "job board" in given else job.board
        output = scratch / "out" / job.name if is_url(job.output) else job.output
        calibration = None if job.calibration is None else Path(given["calibration of all"])
        return replace(job, folder=folder, output=output, calibration=calibration, run=run, board=board)

    def _recording(self) -> Path:
        """Plan the copy of a recording, with the files above it that belong to it."""
        url = str(self._job.folder)
        found = list_files(url)
        if not found:
            raise FileError(f"There are no files in {url}. Is it the folder of a recording?")
        root = self._scratch / "in"
        folder = _copy_of(url, root)
        self.places[root] = f"{url.partition('://')[0]}:/"
        for file in (*found.values(), *self._job.above):
            self._add(file, _copy_of(file.url, root))
        return folder

    def _file(self, name: str, place: Place) -> Place:
        """Plan the copy of a file, or of a folder of files, that an option names."""
        if not is_url(place):
            return place
        root = self._scratch / "given" / name.replace(" ", "_")
        self.places[root] = place.rpartition("/")[0]
        found = list_files(place)
        if not found:
            raise FileError(f"There is no file {place}.")
        for inside, file in found.items():
            self._add(StoredFile(file.url.rstrip("/"), file.size, file.version), root / name_of(place) / inside)
        return root / name_of(place)

    def _add(self, file: StoredFile, path: Path) -> None:
        self._inputs[file.url] = self._files[path] = file


def _copy_of(url: str, root: Path) -> Path:
    """Return the path of a copy, with the bucket and all folders of the URL."""
    return root.joinpath(*url.partition("://")[2].split("/"))


def _given(job: Job) -> Mapping[str, Place]:
    """Return the files that the options of a job name, which are URLs or local paths."""
    found: dict[str, Place] = {}
    if job.calibration is not None:
        found["calibration of all"] = job.calibration
    if job.board is not None and (is_url(job.board) or Path(job.board).is_file()):
        found["job board"] = job.board
    if isinstance(job.run, RunOptions):
        values = {name: getattr(job.run, name) for name in FILE_OPTIONS}
        found |= {name: text for name, text in values.items() if text and (is_url(text) or Path(text).is_absolute())}
        found |= {f"weights {i}": text for i, text in enumerate(job.run.detect.weights)}
    return found
