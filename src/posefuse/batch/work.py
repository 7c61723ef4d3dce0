"""Run one job of a batch in any process: nothing is printed, and errors become part of the job's result."""

import contextlib
import io
import math
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from posefuse.errors import OutputExistsError, PosefuseError, handle_warnings
from posefuse.io.open_recording import RecordingInputs, input_digests, open_recording
from posefuse.model.batch import Job, JobResult, JobState, ResultStatistics
from posefuse.model.findings import certain_faults
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.distributed import RunPieces, Workers, is_long
from posefuse.pipeline.fingerprints import RESULT, find_earlier, is_occupied, recording_keys
from posefuse.pipeline.reconstruct_recording import Execution, Outcome, Request, carry_out, kept_outcome
from posefuse.progress import Silent
from posefuse.report.summary import summarize

_T = TypeVar("_T")
_LOCK = threading.Lock()
"""Warnings and printed output belong to a process, so a process runs one job at a time."""


def run_job(job: Job) -> JobResult:
    """Reconstruct a recording unless its result is unchanged; errors become part of the result."""
    with _LOCK, _silence() as warned:
        return _catch_errors(job, lambda: _unchanged(job) or _reconstruct(job, warned, None))


def run_job_unless_long(job: Job) -> JobResult | None:
    """Do the same, but return None for a recording that is to be divided."""
    with _LOCK, _silence() as warned:
        return _catch_errors(
            job, lambda: _unchanged(job) or (None if _is_long(job) else _reconstruct(job, warned, None))
        )


def run_divided_job(job: Job, run_pieces: RunPieces) -> JobResult:
    """Reconstruct a long recording in pieces that workers run; errors become part of the result."""
    assert job.window_s is not None
    workers = Workers(run_pieces, job.window_s)
    with _LOCK, _silence() as warned:
        return _catch_errors(job, lambda: _reconstruct(job, warned, workers))


def _catch_errors(job: Job, work: Callable[[], _T]) -> _T | JobResult:
    """Return the result of some work, or a failed result with the reason."""
    try:
        return work()
    except PosefuseError as error:
        return failed(job, str(error))
    except OSError as error:
        named = f"{Path(error.filename).name}: " if error.filename else ""
        return failed(job, f"{named}{error.strerror or error}.")
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}, line {last.lineno}"
        what = " ".join(str(error).split())[:200]
        return failed(job, f"Unexpected error, please report it: {type(error).__name__}: {what} ({where})")


def failed(job: Job, why: str) -> JobResult:
    """Return a failed result; paths in its reason start at the recording's folder or the one above."""
    for path, shown in ((job.folder, job.folder.name), (job.output, job.name), (job.folder.parent, "..")):
        why = why.replace(str(path), shown)
    return JobResult(job.name, "failed", why)


def _unchanged(job: Job) -> JobResult | None:
    """Return the result of an earlier run on the same inputs, undivided or divided; None if there is work to do.

    Raises:
        OutputExistsError: if the folder contains a result that the job may not replace.
    """
    if job.treatment.again or not is_occupied(job.output):
        return None
    digests = input_digests(job.folder, RecordingInputs(job.calibration), job.options)
    windows = dict.fromkeys((None, job.window_s))
    try:
        mark = find_earlier(job.output, [recording_keys(digests, job.options, window_s=each) for each in windows])
    except OutputExistsError:
        if not job.treatment.overwrite:
            raise
        return None
    if mark is None:
        return None
    outcome = kept_outcome(job.output, mark)
    try:
        remembered = _Remembered.read(mark.remembered)
    except (TypeError, KeyError):
        # The command reconstruct stores no statistics.
        remembered = _Remembered.of(outcome.open(), ())
    return _result(job, "kept", remembered, outcome)


def _is_long(job: Job) -> bool:
    if job.window_s is None:
        return False
    opened = open_recording(job.folder, RecordingInputs(job.calibration), job.options)
    return is_long(opened.detections, job.options, job.window_s)


def _reconstruct(job: Job, warned: list[str], workers: Workers | None) -> JobResult:
    remembered: list[_Remembered] = []

    def remember(result: Reconstruction) -> Mapping[str, Any]:
        remembered.append(_Remembered.of(result, warned))
        return asdict(remembered[0])

    request = Request(job.folder, job.output, job.options, RecordingInputs(job.calibration), overwrite=True)
    outcome = carry_out(request, Silent(), Execution(workers=workers, remember=remember))
    return _result(job, "done", remembered[0], outcome)


@dataclass(frozen=True)
class _Remembered:
    """What a batch stores beside a result.

    Attributes:
        statistics: of the result.
        warnings: given while the recording was reconstructed, and findings.
    """

    statistics: ResultStatistics
    warnings: tuple[str, ...]

    @classmethod
    def of(cls, result: Reconstruction, warned: Sequence[str]) -> "_Remembered":
        return cls(_statistics(result), (*warned, *(str(finding) for finding in result.findings)))

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> "_Remembered":
        return cls(ResultStatistics(**values["statistics"]), tuple(values["warnings"]))


def _result(job: Job, state: JobState, remembered: _Remembered, outcome: Outcome) -> JobResult:
    faults = () if job.treatment.accept_findings else certain_faults(outcome.findings)
    if faults:
        why = f"{faults[0].sentence} `accept_findings=True` accepts the result."
        return JobResult(job.name, "failed check", why, remembered.statistics, remembered.warnings)
    return JobResult(job.name, state, "", remembered.statistics, remembered.warnings)


def _statistics(result: Reconstruction) -> ResultStatistics:
    layer, _ = result.best_layer(result.options.layer)
    summary = summarize(result.chunks(), layer)
    with_points = sum(n for code, n in summary.status_counts.items() if code.has_point)
    return ResultStatistics(
        frames=result.n_frames,
        seconds=result.n_frames / result.rate_hz if result.rate_hz else None,
        cameras=len(result.rig),
        people=len(result.person_ids),
        points_share=with_points / summary.n_points if summary.n_points else None,
        median_px=_rounded(summary.error_px.median),
        p90_px=_rounded(summary.error_px.p90),
        sd_mm=_rounded(summary.sd_mm.median),
    )


def _rounded(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None


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
    if result.state in ("failed", "not done") and (job.output / RESULT).exists():
        return replace(result, why=f"{result.why} ({job.name} contains an earlier result.)")
    return result
