"""``posefuse batch``."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, percent, print_problem, say, table, warn
from posefuse.cli.findings import CERTAIN_FAULT, AcceptFindings
from posefuse.cli.types import BoardSpec, OptionFlags, Output
from posefuse.errors import OptionsError, choices
from posefuse.model.batch import Job, JobResult, JobTreatment
from posefuse.model.options.options import Options

_INTERRUPTED = "The batch was interrupted before this recording."


@dataclass(frozen=True)
class _Treatment:
    """Flags of what happens to earlier and to wrong results."""

    again: Annotated[
        bool, Parameter(negative="", help="Reconstruct all recordings, even those that have not changed.")
    ] = False
    overwrite: Annotated[bool, Parameter(negative="", help="Replace results of other inputs, options or versions.")] = (
        False
    )
    accept_findings: AcceptFindings = False


@dataclass(frozen=True)
class _Cameras:
    """Flags of the calibration."""

    calibration: Annotated[
        Path | None, Parameter(help="Calibration of all recordings; by default the one in each recording.")
    ] = None
    board: BoardSpec = None


def batch(
    *folders: Annotated[Path, Parameter(help="Folders of the recordings.")],
    output: Output,
    cameras: Annotated[_Cameras, Parameter(name="*")] = _Cameras(),
    jobs: Annotated[int | None, Parameter(help="Number of processes; by default one per processor.")] = None,
    scheduler: Annotated[
        str | None, Parameter(help="Run on the Dask cluster of this scheduler, such as tcp://host:8786.")
    ] = None,
    window_s: Annotated[
        float,
        Parameter(help="On a cluster, divide recordings of at least two windows of this length, in seconds."),
    ] = 300.0,
    flags: Annotated[_Treatment, Parameter(name="*")] = _Treatment(),
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Reconstruct many recordings side by side, each as posefuse reconstruct does, into a folder of its own.

    A failed recording does not stop the others. The same command run again reconstructs only what is missing or has
    changed: inputs, options or version; --overwrite lets it replace the results of changed recordings. Writes batch.csv
    and batch.html.

    The exit code is 1 if a recording failed, else 3 if the recording check is certain that a result is wrong, else 0.
    --accept-findings accepts such results.
    """
    from posefuse.batch.calibrations import calibrate_jobs
    from posefuse.batch.jobs import jobs_of
    from posefuse.batch.work import with_earlier_result
    from posefuse.io.files import must_exist
    from posefuse.io.folder_locks import exclusive_folder

    if jobs is not None and jobs < 1:
        raise OptionsError(f"--jobs must be at least 1, got {jobs}.")
    if not window_s > 0:
        raise OptionsError(f"--window-s must be more than 0, got {window_s}.")
    if cameras.calibration is not None:
        must_exist(cameras.calibration, "calibration")
    if output.exists() and not output.is_dir():
        raise OptionsError(f"--output {output} is a file. Specify a folder.")
    window = None if scheduler is None else window_s
    treatment = JobTreatment(**asdict(flags))
    todo = jobs_of(folders, output, cameras.calibration, options, treatment, window_s=window)
    _check_overview(output, todo, flags.overwrite)
    output.mkdir(parents=True, exist_ok=True)
    with exclusive_folder(output, output):
        uncalibrated = calibrate_jobs(todo, cameras.board, Bars())
        found, interrupted = _collect(todo, _run(todo, uncalibrated, jobs, scheduler))
        missing = {job.name: JobResult(job.name, "not done", _INTERRUPTED) for job in todo if job.name not in found}
        by_name = found | missing
        results = [with_earlier_result(job, by_name[job.name]) for job in todo]
        _write(results, output)
    _report(results, output)
    if interrupted:
        warn("Interrupted. Finished results are kept; run the same command again for the rest.")
        sys.exit(130)
    if any(each.state == "failed" for each in results):
        sys.exit(1)
    if any(each.state == "failed check" for each in results):
        sys.exit(CERTAIN_FAULT)


def _check_overview(output: Path, todo: Sequence[Job], overwrite: bool) -> None:
    """Refuse to replace the overview of a batch with recordings that this batch does not have."""
    from posefuse.batch.jobs import PAGE, TABLE
    from posefuse.io.outputs import check_new_files, exists_error
    from posefuse.report.batch import names_in_csv

    names = names_in_csv(output / TABLE) if (output / TABLE).is_file() else None
    if names is None:
        check_new_files([output / TABLE, output / PAGE], overwrite=overwrite)
        return
    lost = [name for name in names if name not in [job.name for job in todo]]
    if lost and not overwrite:
        raise exists_error(f"{output / TABLE} lists recordings that are not in this batch ({choices(lost, 4)})")


def _collect(todo: Sequence[Job], results: Iterator[JobResult]) -> tuple[dict[str, JobResult], bool]:
    """Return the results of jobs by name, and whether the batch was interrupted."""
    progress, found = Bars(), {}
    progress.start("recordings", len(todo))
    try:
        for result in results:
            found[result.name] = result
            progress.advance(1)
    except KeyboardInterrupt:
        return found, True
    finally:
        progress.finish()
    return found, False


def _run(
    todo: Sequence[Job], uncalibrated: Sequence[JobResult], jobs: int | None, scheduler: str | None
) -> Iterator[JobResult]:
    from posefuse.batch.cluster import on_cluster
    from posefuse.batch.pool import in_processes
    from posefuse.batch.work import run_divided_job, run_job, run_job_unless_long
    from posefuse.parallel import logical_cores

    failed = [each.name for each in uncalibrated]
    ready = [job for job in todo if job.name not in failed]
    if scheduler is not None:
        if jobs is not None:
            raise OptionsError(
                "--jobs applies only to this machine; on a cluster (--scheduler), the number of workers determines "
                "the number of jobs. Remove --jobs."
            )
        return chain(uncalibrated, on_cluster(run_job_unless_long, ready, scheduler, run_divided_job))
    return chain(uncalibrated, in_processes(run_job, ready, jobs or logical_cores()))


def _write(results: Sequence[JobResult], output: Path) -> None:
    from posefuse.batch.jobs import PAGE, TABLE
    from posefuse.io.files import replacing
    from posefuse.report.batch import batch_csv, batch_page

    for name, text in ((TABLE, batch_csv(results)), (PAGE, batch_page(results))):
        with replacing(output / name) as temporary:
            temporary.write_text(text, "utf-8")


def _report(results: Sequence[JobResult], output: Path) -> None:
    from posefuse.batch.jobs import PAGE, TABLE

    table(None, ["recording", "outcome", "frames", "people", "points", "median px"], [_row(each) for each in results])
    for each in results:
        for warning in each.warnings:
            print_problem("warning: ", "yellow", f"{each.name}: {warning}")
    for each in results:
        if each.state == "failed":
            print_problem("failed: ", "bold red", f"{each.name}: {each.why}")
        elif each.state == "failed check":
            print_problem("failed check: ", "bold red", f"{each.name}: {each.why}")
    states = Counter(each.state for each in results)
    say(
        f"{count(len(results), 'recording')}: {states['done']} done, {states['kept']} kept (nothing changed), "
        f"{states['failed']} failed"
        + "".join(f", {states[each]} {each}" for each in ("failed check", "not done") if states[each])
    )
    say(f"Wrote {TABLE} and {PAGE} to {output}")


def _row(each: JobResult) -> list[str]:
    n = each.statistics
    if n is None:
        return [each.name, each.state, "-", "-", "-", "-"]
    share = "-" if n.points_share is None else percent(n.points_share)
    error = "-" if n.median_px is None else f"{n.median_px:.2f}"
    return [each.name, each.state, str(n.frames), str(n.people), share, error]
