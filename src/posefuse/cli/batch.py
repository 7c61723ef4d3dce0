"""``posefuse batch``."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import chain
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from posefuse.cli.console import Bars, count, percent, print_problem, say, table, warn
from posefuse.cli.findings import CERTAIN_FAULT, AcceptFindings
from posefuse.cli.help import RECONSTRUCTION_GROUP, VIDEOS_GROUP
from posefuse.cli.run import Shortcuts
from posefuse.errors import OptionsError, choices
from posefuse.model.batch import Job, JobResult, JobTreatment
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunInputs, RunOptions
from posefuse.parallel import JobCount, logical_cores, number_of_jobs

if TYPE_CHECKING:
    from posefuse.batch.schedulers import Scheduler

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
class _Where:
    """Flags of the processes or machines that do the work."""

    jobs: Annotated[
        JobCount | None,
        Parameter(help="Number of processes: by default one per logical core; auto takes one per physical core."),
    ] = None
    scheduler: Annotated[
        str | None,
        Parameter(
            help="Run on a Dask cluster: the address of a scheduler such as tcp://host:8786, local, or a class of "
            "clusters such as dask_jobqueue.SLURMCluster."
        ),
    ] = None
    workers: Annotated[
        str | None,
        Parameter(help="Workers of a cluster that is started for the batch: 4, or 0..16 for an adaptive one."),
    ] = None
    retries: Annotated[
        int,
        Parameter(help="Times that a recording is run again after a lost worker or another failure outside of it."),
    ] = 2
    window_s: Annotated[
        float,
        Parameter(help="On a cluster, divide recordings of at least two windows of about this length, in seconds."),
    ] = 300.0

    def check(self) -> "Scheduler | None":
        """Return the cluster, or None if the work is done by processes of this machine.

        Raises:
            OptionsError: if the flags contradict each other.
        """
        from posefuse.batch.schedulers import Scheduler, WorkerCount

        if self.jobs is not None:
            number_of_jobs(self.jobs, useful=1)
        if self.retries < 0:
            raise OptionsError(f"--retries must be at least 0, got {self.retries}.")
        if not self.window_s > 0:
            raise OptionsError(f"--window-s must be more than 0, got {self.window_s}.")
        if self.scheduler is None:
            if self.workers is not None:
                raise OptionsError("--workers needs --scheduler local, or --scheduler with a class of clusters.")
            return None
        if self.jobs is not None:
            raise OptionsError(
                "--jobs applies only to this machine; on a cluster (--scheduler), the number of workers determines "
                "the number of jobs. Remove --jobs."
            )
        return Scheduler(self.scheduler, None if self.workers is None else WorkerCount.of(self.workers))


def batch(
    *folders: Annotated[str, Parameter(help="Folders of the recordings, or URLs such as s3://bucket/recordings/*.")],
    output: Annotated[str, Parameter(name=["--output", "-o"], help="Folder for the results, or its URL.")],
    from_videos: Annotated[
        bool, Parameter(negative="", help="Process each recording from its videos, as posefuse run does.")
    ] = False,
    where: Annotated[_Where, Parameter(name="*")] = _Where(),
    flags: Annotated[_Treatment, Parameter(name="*")] = _Treatment(),
    shortcuts: Annotated[Shortcuts, Parameter(name="*", group=Group(VIDEOS_GROUP, sort_key=1))] = Shortcuts(),  # noqa: B008
    run: Annotated[RunOptions, Parameter(name="*", group=Group(VIDEOS_GROUP, sort_key=1))] = RunOptions(),  # noqa: B008
    options: Annotated[Options, Parameter(name="*", group=Group(RECONSTRUCTION_GROUP, sort_key=2))] = Options(),  # noqa: B008
) -> None:
    """Reconstruct many recordings side by side, each as posefuse reconstruct does, into a folder of its own.

    A failed recording does not stop the others. The same command run again reconstructs only what is missing or has
    changed: inputs, options or version; --overwrite lets it replace the results of changed recordings. Writes batch.csv
    and batch.html.

    --from-videos does what posefuse run does instead, and repeats the stages whose inputs or options changed.
    Recordings and results on object stores (s3://, gs://) are copied to the workers and back.

    The exit code is 1 if a recording failed, else 3 if the recording check is certain that a result is wrong, else 0.
    --accept-findings accepts such results.
    """
    from posefuse.batch.jobs import checked_calibration, jobs_of, place_of, places_of, resolved_run
    from posefuse.batch.overview import check_overview, exclusive_output, write_overview
    from posefuse.batch.work import with_earlier_result

    scheduler = where.check()
    run = replace(shortcuts.applied_to(run), inputs=RunInputs())
    calibration = None if from_videos else checked_calibration(run.calibration_file)
    _check_recipe(from_videos, run, flags)
    place, recordings = place_of(output), places_of(folders)
    todo = jobs_of(
        recordings, place, calibration, options, JobTreatment(**asdict(flags)),
        window_s=None if scheduler is None else where.window_s,
        run=resolved_run(run, recordings) if from_videos else None,
    )  # fmt: skip
    check_overview(place, todo, overwrite=flags.overwrite)
    with exclusive_output(place):
        ready, uncalibrated = _calibrated(todo, None if from_videos else run.board)
        found, interrupted = _collect(todo, chain(uncalibrated, _run(ready, where, scheduler)))
        missing = {job.name: JobResult(job.name, "not done", _INTERRUPTED) for job in todo if job.name not in found}
        by_name = found | missing
        results = [with_earlier_result(job, by_name[job.name]) for job in todo]
        write_overview(results, place)
    _report(results, output)
    if interrupted:
        warn("Interrupted. Finished results are kept; run the same command again for the rest.")
        sys.exit(130)
    if any(each.state == "failed" for each in results):
        sys.exit(1)
    if any(each.state == "failed check" for each in results):
        sys.exit(CERTAIN_FAULT)


def _check_recipe(from_videos: bool, run: RunOptions, flags: _Treatment) -> None:
    """Refuse flags that the recipe does not have."""
    if from_videos:
        if flags.again:
            raise OptionsError(
                "--again does not apply to --from-videos, which repeats the stages whose inputs or options changed. To "
                "repeat all of them, remove the folders of the results."
            )
        return
    if run.calibration in ("people", "none", "board"):
        raise OptionsError(f"--calibration {run.calibration} needs --from-videos.")
    others = [name for name, value in _changed(run) if name not in ("calibration", "board")]
    if others:
        names = choices(f"--{name.replace('_', '-')}" for name in others)
        raise OptionsError(f"Only --from-videos takes {names}. Add --from-videos, or remove it.")


def _changed(run: RunOptions) -> list[tuple[str, object]]:
    """Return the options that differ from their defaults."""
    default = RunOptions()
    return [
        (field.name, getattr(run, field.name))
        for field in fields(run)
        if getattr(run, field.name) != getattr(default, field.name)
    ]


def _calibrated(todo: Sequence[Job], board: str | None) -> tuple[list[Job], list[JobResult]]:
    """Return the jobs whose cameras are calibrated where they can be, and the results of the others."""
    from posefuse.batch.above import with_files_above
    from posefuse.batch.calibrations import calibrate_jobs

    uncalibrated = calibrate_jobs(todo, board, Bars())
    names = [each.name for each in uncalibrated]
    ready = [replace(job, board=board) for job in todo if job.name not in names]
    return with_files_above(ready, board, Bars()), uncalibrated


def _run(ready: Sequence[Job], where: _Where, scheduler: "Scheduler | None") -> Iterator[JobResult]:
    from posefuse.batch.cluster import on_cluster
    from posefuse.batch.pool import in_processes
    from posefuse.batch.work import run_divided_job, run_job, run_job_unless_long

    if scheduler is not None:
        return on_cluster(run_job_unless_long, ready, scheduler, run_divided_job, retries=where.retries)
    number = logical_cores() if where.jobs is None else number_of_jobs(where.jobs, useful=len(ready))
    return in_processes(run_job, ready, number, where.retries)


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


def _report(results: Sequence[JobResult], output: str) -> None:
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
