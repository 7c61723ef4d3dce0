"""Jobs side by side in processes, of which one may die without taking the others along."""

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

from posefuse.model.batch import Job, Outcome

Work = Callable[[Job], Outcome]
_TRIES = 2
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class _Worker:
    process: SpawnProcess
    pipe: Connection
    job: Job | None = None


def in_processes(work: Work, jobs: Sequence[Job], n: int) -> Iterator[Outcome]:
    """Do all jobs, ``n`` at a time; what came of each, in the order in which they end.

    A job whose process dies is tried once more, in a new one.

    Args:
        work: does a job in another process; importable by name.
        jobs: to do.
        n: how many processes.
    """
    waiting = deque(jobs)
    tries = {job.name: 0 for job in jobs}
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
                    job, outcome = worker.job, _heard(worker)
                    assert job is not None
                    tries[job.name] += 1
                    worker.job = None
                    if outcome is not None:
                        yield outcome
                    elif tries[job.name] < _TRIES:
                        waiting.append(job)
                    else:
                        yield Outcome(job.name, "failed", _death(worker.process))
    finally:
        _stop(workers)


def _start(work: Work) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    with _one_thread_each():
        process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that start within have one thread for their sums, unless the user said otherwise."""
    ours = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(ours, "1"))
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


def _give(worker: _Worker, job: Job, work: Work) -> _Worker:
    """Hand a job over; to a new worker if this one is dead."""
    if not worker.process.is_alive():
        worker.pipe.close()
        worker = _start(work)
    worker.job = job
    with contextlib.suppress(OSError):
        worker.pipe.send(job)
    return worker


def _heard(worker: _Worker) -> Outcome | None:
    """What a worker says; None if it died, and then it is over."""
    with contextlib.suppress(EOFError, OSError):
        if worker.pipe.poll():
            return worker.pipe.recv()
    worker.process.kill()
    worker.process.join()
    return None


def _death(process: SpawnProcess) -> str:
    code = process.exitcode or 0
    how = f"by {signal.Signals(-code).name}" if code < 0 else f"with code {code}"
    hint = " Was memory short? --jobs 1 leaves it to one recording." if code == -signal.SIGKILL else ""
    return f"Its process ended {how}, {_TRIES} times.{hint}"


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
    """A worker's life: jobs in, outcomes out, until nobody is at the other end."""
    # Ctrl-C is the parent's; who is asked to end leaves no half results behind.
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
