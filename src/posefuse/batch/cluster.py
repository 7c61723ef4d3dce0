"""Jobs on a Dask cluster: one recording a task, long ones in pieces."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from posefuse.errors import StreamError
from posefuse.model.batch import Job, Outcome
from posefuse.pipeline.distributed import Do

_CONNECT_S = 20
_RETRIES = 3


def on_cluster(
    work: Callable[[Job], Outcome | None],
    jobs: Sequence[Job],
    address: str,
    divided: Callable[[Job, Do], Outcome] | None = None,
) -> Iterator[Outcome]:
    """Do all jobs on a cluster; what came of each, in the order in which they end.

    Workers see the recordings and the output under the same paths, and have this posefuse. Who dies has its recordings
    and pieces done by others. Long recordings are put together here, one after the other, while workers do the rest.

    Args:
        work: does a job in another process, or says by None that it is too long for one; importable by name.
        jobs: to do.
        address: of the scheduler.
        divided: does a long job here, with whoever does its pieces.

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

    def do(piece_work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        client.gather(client.map(piece_work, pieces, pure=False, retries=_RETRIES))

    with client:
        futures = {client.submit(work, job, pure=False, retries=_RETRIES): job for job in jobs}
        for future in as_completed(list(futures)):
            job = futures[future]
            try:
                outcome = future.result()
            except Exception as error:
                why = f"The cluster gave it up: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
                outcome = Outcome(job.name, "failed", why)
            if outcome is None:
                assert divided is not None
                outcome = divided(job, do)
            yield outcome
