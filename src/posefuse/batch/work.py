"""Run one job of a batch in any process: nothing is printed, and errors become part of the job's result."""

import contextlib
import io
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from posefuse.batch.recipes import Processing, process, with_short_paths
from posefuse.batch.staging import Result, on_copies
from posefuse.batch.stored_result import RunTasks, is_complete
from posefuse.errors import PosefuseError, StoreError, handle_warnings
from posefuse.io.results.open_result import RESULT_OF_RUN
from posefuse.model.batch import Job, JobResult
from posefuse.pipeline.distributed import Workers
from posefuse.pipeline.fingerprints import RESULT

_LOCK = threading.Lock()
"""Warnings and printed output belong to a process, so a process runs one job at a time."""


def run_job(job: Job) -> JobResult:
    """Process a recording unless its result is unchanged; errors become part of the result."""
    result = _run_job(job, lambda _, warned: Processing(warned))
    assert result is not None
    return result


def run_job_unless_long(job: Job) -> JobResult | None:
    """Do the same, but return None for a recording that is to be divided."""
    return _run_job(job, lambda _, warned: Processing(warned, leaves_long=job.window_s is not None))


def run_divided_job(job: Job, run_tasks: RunTasks) -> JobResult:
    """Process a long recording in pieces that workers run; errors become part of the result."""

    def how(result: Result, warned: list[str]) -> Processing:
        assert job.window_s is not None
        return Processing(warned, Workers(result.pieces(run_tasks), job.window_s))

    result = _run_job(job, how)
    assert result is not None
    return result


def _run_job(job: Job, how: Callable[[Result, list[str]], Processing]) -> JobResult | None:
    with _LOCK, _silence() as warned:

        def work(local: Job, result: Result) -> JobResult | None:
            processing = replace(how(result, warned), stage_finished=result.upload_changes)
            return _catch_errors(local, lambda: process(local, processing))

        return _catch_errors(job, lambda: on_copies(job, work))


def _catch_errors(job: Job, work: Callable[[], JobResult | None]) -> JobResult | None:
    """Return the result of some work, or a failed result with the reason."""
    try:
        return work()
    except StoreError as error:
        return replace(failed(job, str(error)), transient=error.transient)
    except PosefuseError as error:
        return failed(job, str(error))
    except OSError as error:
        named = f"{Path(error.filename).name}: " if error.filename else ""
        return replace(failed(job, f"{named}{error.strerror or error}."), transient=True)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}, line {last.lineno}"
        what = " ".join(str(error).split())[:200]
        why = f"Unexpected error, please report it: {type(error).__name__}: {what} ({where})"
        return replace(failed(job, why), transient=True)


def failed(job: Job, why: str) -> JobResult:
    """Return a failed result; paths in its reason start at the recording's folder or the one above."""
    return JobResult(job.name, "failed", with_short_paths(job, why))


@contextlib.contextmanager
def _silence() -> Iterator[list[str]]:
    """Discard printed output, and collect each distinct warning."""
    warned: list[str] = []
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
        handle_warnings(warned.append),
    ):
        yield warned


def with_earlier_result(job: Job, result: JobResult) -> JobResult:
    """Add to a failure that the result of an earlier run is still there."""
    if result.state not in ("failed", "not done") or not _has_result(job):
        return result
    return replace(result, why=f"{result.why} ({job.name} contains an earlier result.)")


def _has_result(job: Job) -> bool:
    if isinstance(job.output, str):
        with contextlib.suppress(StoreError):
            return is_complete(job.output)
        return False
    return any((job.output / name).exists() for name in (RESULT, f"{RESULT_OF_RUN}/{RESULT}"))
