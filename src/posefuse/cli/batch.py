"""``posefuse batch``."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, percent, print_problem, say, table, warn
from posefuse.cli.types import OptionFlags, Output
from posefuse.errors import OptionsError
from posefuse.model.batch import Job, Outcome
from posefuse.model.options.options import Options

_ENDED = "The batch was interrupted before it was done."


def batch(
    *folders: Annotated[Path, Parameter(help="The recordings' folders.")],
    output: Output,
    calibration: Annotated[Path | None, Parameter(help="For all; by default the one in each recording.")] = None,
    jobs: Annotated[int | None, Parameter(help="So many at a time; by default one a processor.")] = None,
    scheduler: Annotated[
        str | None, Parameter(help="Do it on the Dask cluster of this scheduler, such as tcp://host:8786.")
    ] = None,
    window_s: Annotated[
        float, Parameter(help="On a cluster, divide recordings that hold two such windows, in seconds.")
    ] = 300.0,
    again: Annotated[bool, Parameter(negative=(), help="Do all, whether anything has changed or not.")] = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Reconstruct many recordings side by side, each as posefuse reconstruct does, into a folder of its own.

    One that fails stops no other. Called again, it does what is missing or has changed: contents, options or version.
    Writes batch.csv and batch.html over all. Exit code 1 if any recording failed.
    """
    from posefuse.batch.jobs import jobs_of
    from posefuse.cli.batch_work import as_before
    from posefuse.io.files import exclusive_folder, must_exist

    if jobs is not None and jobs < 1:
        raise OptionsError(f"--jobs must be at least 1, got {jobs}.")
    if not window_s > 0:
        raise OptionsError(f"--window-s must be more than 0, got {window_s}.")
    if calibration is not None:
        must_exist(calibration, "calibration")
    if output.exists() and not output.is_dir():
        raise OptionsError(f"--output {output} is a file; give a folder.")
    window = None if scheduler is None else window_s
    todo = jobs_of(folders, output, calibration, options, again=again, window_s=window)
    output.mkdir(parents=True, exist_ok=True)
    with exclusive_folder(output, output):
        found, ended = _done(todo, _outcomes(todo, jobs, scheduler))
        missing = [Outcome(job.name, "not done", _ENDED) for job in todo if job.name not in found]
        by_name = found | {each.name: each for each in missing}
        outcomes = [as_before(job, by_name[job.name]) for job in todo]
        _write(outcomes, output)
    _tell(outcomes, output)
    if ended:
        warn("Interrupted. What is done stays, and the same command does the rest.")
        sys.exit(130)
    if any(outcome.state == "failed" for outcome in outcomes):
        sys.exit(1)


def _done(todo: Sequence[Job], outcomes: Iterator[Outcome]) -> tuple[dict[str, Outcome], bool]:
    """What came of jobs, by name, and whether that was interrupted."""
    progress, found = Bars(), {}
    progress.start("recordings", len(todo))
    try:
        for outcome in outcomes:
            found[outcome.name] = outcome
            progress.advance(1)
    except KeyboardInterrupt:
        return found, True
    finally:
        progress.finish()
    return found, False


def _outcomes(todo: Sequence[Job], jobs: int | None, scheduler: str | None) -> Iterator[Outcome]:
    from posefuse.batch.cluster import on_cluster
    from posefuse.batch.pool import in_processes, processors
    from posefuse.cli.batch_work import do_divided, do_job, do_unless_long

    if scheduler is not None:
        if jobs is not None:
            raise OptionsError("--jobs is for this machine; on a cluster (--scheduler) its workers say how many.")
        return on_cluster(do_unless_long, todo, scheduler, do_divided)
    return in_processes(do_job, todo, jobs or processors())


def _write(outcomes: Sequence[Outcome], output: Path) -> None:
    from posefuse.batch.jobs import PAGE, TABLE
    from posefuse.io.files import replacing
    from posefuse.report.batch import batch_csv, batch_page

    for name, text in ((TABLE, batch_csv(outcomes)), (PAGE, batch_page(outcomes))):
        with replacing(output / name) as temporary:
            temporary.write_text(text, "utf-8")


def _tell(outcomes: Sequence[Outcome], output: Path) -> None:
    from posefuse.batch.jobs import PAGE, TABLE

    table(None, ["recording", "outcome", "frames", "people", "points", "median px"], [_row(each) for each in outcomes])
    for each in outcomes:
        for warning in each.warnings:
            print_problem("warning: ", "yellow", f"{each.name}: {warning}")
    for each in outcomes:
        if each.state == "failed":
            print_problem("failed: ", "bold red", f"{each.name}: {each.why}")
    states = Counter(each.state for each in outcomes)
    say(
        f"{count(len(outcomes), 'recording')}: {states['done']} done, {states['kept']} kept (nothing changed), "
        f"{states['failed']} failed" + (f", {states['not done']} not done" if states["not done"] else "")
    )
    say(f"Wrote {TABLE} and {PAGE} to {output}")


def _row(each: Outcome) -> list[str]:
    n = each.numbers
    if n is None:
        return [each.name, each.state, "-", "-", "-", "-"]
    share = "-" if n.points_share is None else percent(n.points_share)
    error = "-" if n.median_px is None else f"{n.median_px:.2f}"
    return [each.name, each.state, str(n.frames), str(n.people), share, error]
