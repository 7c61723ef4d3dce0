"""Run one job of a batch in any process: nothing is printed, and errors become part of the job's result."""

import contextlib
import io
import math
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from posefuse.batch.fingerprints import MARK, RESULT, fingerprint, remove_mark, unchanged_result, write_mark
from posefuse.errors import PosefuseError, RecordingError, handle_warnings
from posefuse.io.checkpoints import remove_parts
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.io.open_recording import (
    RecordingInputs,
    calibration_and_keypoints,
    digest_path,
    open_recording,
    timestamps_in,
)
from posefuse.model.batch import Job, JobResult, ResultStatistics
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.distributed import RunPieces, Workers, is_long
from posefuse.pipeline.reconstruct_recording import Delivery, Outcome, reconstruct_recording
from posefuse.report.summary import summarize

_T = TypeVar("_T")
_LOCK = threading.Lock()
"""Warnings and printed output belong to a process, so a process runs one job at a time."""
_CHANGED = "Its files changed while it was reconstructed. Run the same command again."


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
        return _failed(job, str(error))
    except OSError as error:
        named = f"{Path(error.filename).name}: " if error.filename else ""
        return _failed(job, f"{named}{error.strerror or error}.")
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}, line {last.lineno}"
        what = " ".join(str(error).split())[:200]
        return _failed(job, f"Unexpected error, please report it: {type(error).__name__}: {what} ({where})")


def _failed(job: Job, why: str) -> JobResult:
    """Return a failed result; paths in it start at the recording's folder or the one above."""
    for path, shown in ((job.folder, job.folder.name), (job.output, job.name), (job.folder.parent, "..")):
        why = why.replace(str(path), shown)
    return JobResult(job.name, "failed", why)


def _unchanged(job: Job) -> JobResult | None:
    """Return the result of an earlier run on the same inputs, undivided or divided."""
    if job.again or not (job.output / MARK).is_file():
        return None
    inputs = _digests(job)
    keys = (_key(job, inputs, window_s) for window_s in dict.fromkeys((None, job.window_s)))
    results = (unchanged_result(job.name, job.output, key, digest_path) for key in keys)
    found = next((each for each in results if each), None)
    if found is not None:
        # A run may have ended after writing the mark and before removing its checkpoint.
        remove_parts(job.output / CHECKPOINT_FOLDER)
    return found


def _is_long(job: Job) -> bool:
    if job.window_s is None:
        return False
    opened = open_recording(job.folder, RecordingInputs(job.calibration), job.options)
    return is_long(opened.detections, job.options, job.window_s)


def _reconstruct(job: Job, warned: list[str], workers: Workers | None) -> JobResult:
    results: list[JobResult] = []
    inputs: dict[str, str] = {}

    def verify(result: Reconstruction) -> None:
        inputs.update(_digests(job))
        if not set(result.provenance.inputs.values()) <= set(inputs.values()):
            remove_parts(job.output / CHECKPOINT_FOLDER)
            raise RecordingError(_CHANGED)
        warnings = (*warned, *(str(finding) for finding in result.findings))
        results.append(JobResult(job.name, "done", "", _statistics(result), warnings))
        # The folder changes from here on, and its new result is complete only when its mark is written.
        remove_mark(job.output)

    def finish(_: Outcome) -> None:
        # Before the checkpoint is removed: an interruption in between leaves one of the two.
        write_mark(job.output, _key(job, inputs, window_s), results[0], digest_path)

    window_s = None if workers is None else workers.window_s
    marker = MARK if (job.output / MARK).exists() else RESULT
    reconstruct_recording(
        job.folder, job.output, job.options, inputs=RecordingInputs(job.calibration), workers=workers,
        delivery=Delivery(marker, verify, finish),
    )  # fmt: skip
    return results[0]


def _digests(job: Job) -> dict[str, str]:
    """Return the digests of a recording's inputs, by their role and name."""
    calibration, keypoints = calibration_and_keypoints(job.folder, RecordingInputs(job.calibration), job.options)
    files = {"keypoints": keypoints} if calibration is None else {"calibration": calibration, "keypoints": keypoints}
    timestamps = timestamps_in(job.folder, keypoints, job.options)
    if timestamps is not None:
        files["timestamps"] = timestamps
    return {f"{role} {path.name}": digest_path(path) for role, path in files.items()}


def _key(job: Job, inputs: Mapping[str, str], window_s: float | None) -> str:
    options = job.options
    skeleton = Path(options.skeleton) if options.skeleton and options.skeleton.endswith(".toml") else None
    digest = digest_path(skeleton) if skeleton is not None and skeleton.is_file() else ""
    return fingerprint(inputs, options, digest, window_s)


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
