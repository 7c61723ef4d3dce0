"""The overview of a batch, ``batch.csv`` and ``batch.html``, in a folder or on an object store."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from posefuse.batch.jobs import PAGE, TABLE
from posefuse.batch.scratch import scratch_folder
from posefuse.errors import OptionsError, choices
from posefuse.io.files import replacing
from posefuse.io.folder_locks import exclusive_folder
from posefuse.io.object_stores import joined, list_entries, name_of, read_stored, upload
from posefuse.io.outputs import exists_error
from posefuse.model.batch import Job, JobResult, Place
from posefuse.report.batch import batch_csv, batch_page, names_in_csv


def check_overview(output: Place, todo: Sequence[Job], *, overwrite: bool) -> None:
    """Refuse to replace the overview of a batch with recordings that this batch does not have.

    Raises:
        OutputExistsError: if there is one, and it is not to be replaced.
        OptionsError: if the output is a file.
        StoreError: if an object store does not answer, or denies access.
    """
    if isinstance(output, Path):
        if output.exists() and not output.is_dir():
            raise OptionsError(f"`output` {output} is a file. Specify a folder.")
        _check(output, str(output / TABLE), todo, overwrite)
        return
    with scratch_folder() as scratch:
        existing = [name_of(file.url) for file in list_entries(output)[1]]
        for name in {TABLE, PAGE}.intersection(existing):
            (scratch / name).write_bytes(read_stored(joined(output, name)) or b"")
        _check(scratch, joined(output, TABLE), todo, overwrite)


def _check(folder: Path, shown: str, todo: Sequence[Job], overwrite: bool) -> None:
    names = names_in_csv(folder / TABLE) if (folder / TABLE).is_file() else None
    if names is None:
        found = [name for name in (TABLE, PAGE) if (folder / name).is_file()]
        if found and not overwrite:
            raise exists_error(f"{shown.removesuffix(TABLE)}{found[0]} already exists")
        return
    lost = [name for name in names if name not in [job.name for job in todo]]
    if lost and not overwrite:
        raise exists_error(f"{shown} lists recordings that are not in this batch ({choices(lost, 4)})")


@contextmanager
def exclusive_output(output: Place) -> Iterator[None]:
    """Create the folder of a batch, and let no other batch write to it; object stores have neither folders nor locks.

    Raises:
        FileError: if another batch writes to it.
    """
    if not isinstance(output, Path):
        yield
        return
    made = not output.exists()
    output.mkdir(parents=True, exist_ok=True)
    with exclusive_folder(output, output):
        try:
            yield
        except BaseException:
            if made:
                # A batch that fails before its first recording, for example without a scheduler, leaves no trace.
                with suppress(OSError):
                    output.rmdir()
            raise


def write_overview(results: Sequence[JobResult], output: Place) -> None:
    """Write the overview.

    Raises:
        FileError: if it cannot be written.
        StoreError: if an object store does not answer, or denies access.
    """
    texts = {TABLE: batch_csv(results), PAGE: batch_page(results)}
    if isinstance(output, Path):
        for name, text in texts.items():
            with replacing(output / name) as temporary:
                temporary.write_text(text, "utf-8")
        return
    with scratch_folder() as scratch:
        for name, text in texts.items():
            (scratch / name).write_text(text, "utf-8")
        upload({joined(output, name): scratch / name for name in texts})
