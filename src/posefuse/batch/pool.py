"""Run jobs side by side in processes; the death of one does not affect the others."""

import contextlib
import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

from posefuse.batch.attempts import Attempts
from posefuse.model.batch import Job, JobResult
from posefuse.parallel import one_thread_each

Work = Callable[[Job], JobResult]


@dataclass
class _Worker:
    process: SpawnProcess
    pipe: Connection
    job: Job | None = None


def in_processes(work: Work, jobs: Sequence[Job], n: int, retries: int = 1) -> Iterator[JobResult]:
    """Run all jobs, ``n`` at a time, and return their results in the order in which they finish.

    A job whose process dies, or that fails for a reason outside of its recording, is run again, after the others.

    Args:
        work: runs a job in another process; importable by name.
        jobs: jobs to run.
        n: number of processes.
        retries: how often a job is run again.
    """
    waiting, attempts = deque(jobs), Attempts(retries)
    workers = [_start(work) for _ in range(min(n, len(jobs)))]
    try:
        while waiting or any(worker.job for worker in workers):
            for i, worker in enumerate(workers):
                if worker.job is None and waiting:
                    workers[i] = _give(worker, waiting.popleft(), work)
            busy = [worker for worker in workers if worker.job]
            ended = wait([each for worker in busy for each in (worker.pipe, worker.process.sentinel)])
            for worker in busy:
                if worker.pipe in ended or worker.process.sentinel in ended:
                    job, result = worker.job, _receive(worker)
                    assert job is not None
                    worker.job = None
                    result = result or JobResult(job.name, "failed", _death(worker.process), transient=True)
                    if attempts.again(result):
                        waiting.append(job)
                    else:
                        yield attempts.described(result)
    finally:
        _stop(workers)


def _start(work: Work) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    with one_thread_each():
        process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        process.start()
    theirs.close()
    return _Worker(process, ours)


def _give(worker: _Worker, job: Job, work: Work) -> _Worker:
    """Send a job to a worker, or to a new one if it is dead."""
    if not worker.process.is_alive():
        worker.pipe.close()
        worker = _start(work)
    worker.job = job
    with contextlib.suppress(OSError):
        worker.pipe.send(job)
    return worker


def _receive(worker: _Worker) -> JobResult | None:
    """Return the result that a worker sends; None if it died."""
    with contextlib.suppress(EOFError, OSError):
        if worker.pipe.poll():
            return worker.pipe.recv()
    worker.process.kill()
    worker.process.join()
    return None


def _death(process: SpawnProcess) -> str:
    code = process.exitcode or 0
    how = f"by {signal.Signals(-code).name}" if code < 0 else f"with code {code}"
    hint = " It may have run out of memory; `jobs=1` runs one recording at a time." if code == -signal.SIGKILL else ""
    return f"Its process ended {how}.{hint}"


def _stop(workers: list[_Worker]) -> None:
    for worker in workers:
        if worker.job is not None:
            worker.process.terminate()
        worker.pipe.close()
    for worker in workers:
        worker.process.join(10.0)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


def _serve(pipe: Connection, work: Work) -> None:
    """Receive jobs and send results until the parent closes the pipe."""
    # The parent handles Ctrl-C. On SIGTERM, cleanup code must run so that no partial results remain.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    while True:
        try:
            job = pipe.recv()
        except (EOFError, OSError):
            return
        with contextlib.suppress(BrokenPipeError):
            pipe.send(work(job))


def _leave(*_: Any) -> None:
    raise SystemExit(0)
