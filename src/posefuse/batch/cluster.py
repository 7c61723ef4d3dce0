"""Run jobs on a Dask cluster: one task per recording, long recordings in pieces."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from posefuse.errors import StreamError
from posefuse.model.batch import Job, JobResult
from posefuse.pipeline.distributed import RunPieces

_CONNECT_S = 20
_RETRIES = 3


def on_cluster(
    work: Callable[[Job], JobResult | None],
    jobs: Sequence[Job],
    address: str,
    divided: Callable[[Job, RunPieces], JobResult] | None = None,
) -> Iterator[JobResult]:
    """Run all jobs on a cluster, and return their results in the order in which they finish.

    Workers must see the recordings and the output under the same paths and have the same posefuse installed. Tasks of a
    worker that dies run elsewhere. Long recordings are assembled in this process, one after the other, while workers
    run the rest.

    Args:
        work: runs a job on a worker and returns None for a recording that is to be divided; importable by name.
        jobs: jobs to run.
        address: address of the scheduler.
        divided: runs a long job in this process, with a function that runs its pieces.

    Raises:
        StreamError: if Dask is not installed, or no scheduler answers at the address.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise StreamError(
            f"`scheduler={address!r}` needs Dask, which is not installed. Install it: pip install 'posefuse[cluster]'."
        ) from None
    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise StreamError(
            f"No Dask scheduler answers at {address}: {error}. Start one (dask scheduler), or remove `scheduler`."
        ) from None

    def run_pieces(piece_work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        client.gather(client.map(piece_work, pieces, pure=False, retries=_RETRIES))

    with client:
        futures = {client.submit(work, job, pure=False, retries=_RETRIES): job for job in jobs}
        for future in as_completed(list(futures)):
            job = futures[future]
            try:
                result = future.result()
            except Exception as error:
                why = f"The cluster failed: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
                result = JobResult(job.name, "failed", why)
            if result is None:
                assert divided is not None
                result = divided(job, run_pieces)
            yield result
