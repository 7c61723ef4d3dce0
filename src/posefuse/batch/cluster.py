"""Jobs on a Dask cluster, one recording a task."""

from collections.abc import Iterator, Sequence

from posefuse.batch.pool import Work
from posefuse.errors import StreamError
from posefuse.model.batch import Job, Outcome

_CONNECT_S = 20
_RETRIES = 3


def on_cluster(work: Work, jobs: Sequence[Job], address: str) -> Iterator[Outcome]:
    """Do all jobs on a cluster; what came of each, in the order in which they end.

    Workers see the recordings and the output under the same paths, and have this posefuse. Who dies has its recordings
    done by others.

    Args:
        work: does a job in another process; importable by name.
        jobs: to do.
        address: of the scheduler.

    Raises:
        StreamError: if distributed is not there, or no scheduler is at that address.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise StreamError(
            f"--scheduler {address} needs Dask, which is not there. Install it: pip install 'posefuse[cluster]'."
        ) from None
    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise StreamError(
            f"No Dask scheduler answers at {address}: {error}. Start one (dask scheduler), or leave --scheduler out."
        ) from None
    with client:
        futures = {client.submit(work, job, pure=False, retries=_RETRIES): job for job in jobs}
        for future in as_completed(list(futures)):
            try:
                yield future.result()
            except Exception as error:
                why = f"The cluster gave it up: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
                yield Outcome(futures[future].name, "failed", why)
