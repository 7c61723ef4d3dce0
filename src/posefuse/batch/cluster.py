"""Run jobs on a Dask cluster: one task per recording, long recordings in pieces."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from posefuse.batch.attempts import Attempts
from posefuse.batch.schedulers import Scheduler, connected
from posefuse.batch.stored_result import RunTasks
from posefuse.errors import PosefuseWarning
from posefuse.model.batch import Job, JobResult
from posefuse.parallel import logical_cores


def on_cluster(
    work: Callable[[Job], JobResult | None],
    jobs: Sequence[Job],
    scheduler: Scheduler,
    divided: Callable[[Job, RunTasks], JobResult] | None = None,
    *,
    retries: int = 2,
) -> Iterator[JobResult]:
    """Run all jobs on a cluster, and return their results in the order in which they finish.

    Local recordings and outputs must be on a file system that workers see under the same paths; those on object stores
    need not. Workers have the same posefuse installed, and may come and go: tasks of a worker that dies run elsewhere.
    Long recordings are assembled in this process, one after the other, while workers run the rest.

    Args:
        work: runs a job on a worker and returns None for a recording that is to be divided; importable by name.
        jobs: jobs to run.
        scheduler: the cluster.
        divided: runs a long job in this process, with a function that runs its pieces.
        retries: how often a job is run again that fails for a reason outside of its recording.

    Raises:
        StreamError: if Dask is not installed, the cluster cannot be started, or no scheduler answers at the address.
    """
    with connected(scheduler, min(logical_cores(), max(len(jobs), 1))) as client:
        from distributed import as_completed

        if not scheduler.is_started_here and not client.scheduler_info(n_workers=-1)["workers"]:
            warnings.warn(
                f"The scheduler at {scheduler.name} has no workers. The batch waits for them (dask worker "
                f"{scheduler.name}, or an adaptive cluster).", PosefuseWarning, stacklevel=2,
            )  # fmt: skip

        def run_tasks(task: Callable[[Any], None], values: Sequence[Any]) -> None:
            client.gather(client.map(task, values, pure=False, retries=retries))

        attempts = Attempts(retries)
        waiting = {client.submit(work, job, pure=False): job for job in jobs}
        completed = as_completed(list(waiting))
        for future in completed:
            job = waiting.pop(future)
            result = _result_of(future, job)
            if result is None:
                assert divided is not None
                result = divided(job, run_tasks)
                # A divided job that is run again begins with the parts that are finished.
                while attempts.again(result):
                    result = divided(job, run_tasks)
            elif attempts.again(result):
                future = client.submit(work, job, pure=False)
                waiting[future] = job
                completed.add(future)
                continue
            yield attempts.described(result)


def _result_of(future: Any, job: Job) -> JobResult | None:
    """Return the result of a task, or a failed one if its workers died."""
    try:
        return future.result()
    except Exception as error:
        why = f"The cluster failed: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
        return JobResult(job.name, "failed", why, transient=True)
