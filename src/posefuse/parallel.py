"""Run independent pieces of one recording in worker processes.

Results do not depend on the number of processes: a piece is computed by the same function wherever it runs, and results
are returned in the order of the pieces.
"""

import contextlib
import multiprocessing
import os
import shutil
import signal
import sys
import threading
import types
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import forkserver
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

from posefuse.errors import OptionsError, PosefuseError, PosefuseWarning, handle_warnings
from posefuse.transfer import Transfer

Item = TypeVar("Item")
Result = TypeVar("Result")
Kept = TypeVar("Kept")

JobCount = int | Literal["auto"]
"""Number of processes that a user asks for."""

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_PRELOADED = ["posefuse.pipeline.reconstruct"]
_CORES = Path("/sys/devices/system/cpu")
_DEATH = (
    "A worker process ended unexpectedly; it may have run out of memory. Run the same command again to resume, with "
    "fewer processes (`jobs=1` runs everything in one)."
)


def logical_cores() -> int:
    """Return the number of logical cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def physical_cores() -> int:
    """Return the number of physical cores that this process may use, or of logical ones where that is unknown."""
    if not hasattr(os, "sched_getaffinity"):
        return logical_cores()
    try:
        pairs = [_CORES / f"cpu{i}/topology/thread_siblings_list" for i in os.sched_getaffinity(0)]
        return len({pair.read_text() for pair in pairs})
    except OSError:
        return logical_cores()


def number_of_jobs(jobs: JobCount, useful: int) -> int:
    """Return the number of processes to use.

    Args:
        jobs: number that the user asks for; "auto" uses the physical cores as far as they are useful.
        useful: number of processes beyond which the recording does not profit.

    Raises:
        OptionsError: if the number is less than 1.
    """
    if jobs == "auto":
        return max(min(physical_cores(), useful), 1)
    if jobs < 1:
        raise OptionsError(f'jobs must be at least 1 or "auto", got {jobs}.')
    return jobs


class Jobs:
    """Worker processes; with one job, everything runs in the calling process, when its result is asked for.

    Use it as a context manager: the processes end with it.

    Args:
        number: number of processes.
    """

    def __init__(self, number: int = 1) -> None:
        self.number = number
        self._pool: ProcessPoolExecutor | None = None
        self._transfer: Transfer | None = None
        self._started, self._lock = False, threading.Lock()

    def __enter__(self) -> Self:
        """Begin to start the processes; they import posefuse while the caller continues."""
        if self.number > 1:
            context = multiprocessing.get_context(_start_method())
            self._transfer = Transfer()
            self._pool = ProcessPoolExecutor(self.number, context, _begin, (self._transfer.folder,))
            with one_thread_each():
                if context.get_start_method() == "forkserver":
                    # Processes are forked at first use, from a server that imports posefuse until then.
                    context.set_forkserver_preload(_PRELOADED)
                    forkserver.ensure_running()
                else:
                    self._start()
        return self

    def _start(self) -> None:
        """Start the processes, unless they run."""
        assert self._pool is not None
        with self._lock:
            if not self._started:
                with _without_main():
                    for _ in range(self.number):
                        self._pool.submit(_do_nothing)
                self._started = True

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the processes; after an error, without waiting for their work."""
        if self._pool is not None:
            processes = list((self._pool._processes or {}).values())
            if kind is not None:
                for process in processes:
                    process.terminate()
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool, self._started = None, False
        if self._transfer is not None:
            self._transfer.remove()
            self._transfer = None

    def in_order(
        self, work: Callable[[Item], Result], items: Iterable[Item], lead: int | None = None
    ) -> Iterator[Result]:
        """Yield the result of ``work`` for each item, in the order of the items.

        Items are taken in the calling thread. An error of an item is raised, and its warnings are given, where its
        result is yielded.

        Args:
            work: computes a result; a function of a module, whose argument and result can be pickled.
            items: what to compute results of.
            lead: number of items that are taken before the result of the first of them is asked for, by default
                ``number``, which bounds the memory. More keep all processes busy while one item takes long.

        Raises:
            PosefuseError: if a process dies.
        """
        for _, result in self.in_order_with(work, ((None, item) for item in items), lead):
            yield result

    def in_order_with(
        self, work: Callable[[Item], Result], items: Iterable[tuple[Kept, Item]], lead: int | None = None
    ) -> Iterator[tuple[Kept, Result]]:
        """Do the same for pairs of a value that stays in this process and an item; yield the value and the result."""
        if self._pool is None:
            for kept, item in items:
                yield kept, work(item)
                del kept, item
            return
        running: deque[tuple[Kept, Future[Any]]] = deque()
        try:
            for kept, item in items:
                running.append((kept, self._submit(work, item)))
                # Large values must not stay here while the caller uses the next ones.
                del kept, item
                if len(running) > (lead or self.number):
                    yield _next_of(running)
            while running:
                yield _next_of(running)
        finally:
            for _, future in running:
                future.cancel()

    def begin(self, work: Callable[[Item], Result], item: Item) -> Callable[[], Result]:
        """Begin a piece of work; the function that is returned waits for its result, and is to be called once."""
        if self._pool is None:
            return partial(work, item)
        return partial(_result_of, self._submit(work, item))

    def begin_made(self, work: Callable[[Item], Result], make: Callable[[], Item]) -> Callable[[], Result]:
        """Do the same for an item that a thread makes meanwhile; with one job, it is made when its result is asked for.

        Args:
            work: computes the result.
            make: returns the item.
        """
        if self._pool is None:
            return lambda: work(make())
        thread = ThreadPoolExecutor(1)
        submitted = thread.submit(lambda: self._submit(work, make()))
        thread.shutdown(wait=False)
        return lambda: _result_of(submitted.result())

    def ahead(self, items: Iterator[Item]) -> Iterator[Item]:
        """Yield the items; with several jobs, a thread computes the next one meanwhile.

        Args:
            items: what to yield. It should wait for workers most of the time.
        """
        if self._pool is None:
            yield from items
            return
        with ThreadPoolExecutor(1) as thread:
            end = object()
            following = thread.submit(next, items, end)
            while (item := following.result()) is not end:
                following = thread.submit(next, items, end)
                yield item  # type: ignore[misc]

    @contextlib.contextmanager
    def thread(self) -> Iterator[ThreadPoolExecutor | None]:
        """Provide a thread for work that needs no interpreter most of the time; with one job, None.

        Leaving the context waits for its work.
        """
        if self._pool is None:
            yield None
            return
        with ThreadPoolExecutor(1) as thread:
            yield thread

    def together(self, *calls: Callable[[], Result]) -> list[Result]:
        """Return the results of calls that wait for workers most of the time; each runs in a thread of its own."""
        if self._pool is None or len(calls) < 2:
            return [call() for call in calls]
        with ThreadPoolExecutor(len(calls)) as threads:
            return [future.result() for future in [threads.submit(call) for call in calls]]

    def _submit(self, work: Callable[[Item], Result], item: Item) -> "Future[Any]":
        """Begin work on an item; :func:`_result_of` returns its result."""
        assert self._pool is not None
        assert self._transfer is not None
        with _explain_death():
            self._start()
            return self._pool.submit(_run, self._transfer.pack((work, item)), self._transfer)


ONE_JOB = Jobs()
"""Runs everything in the calling process."""


def _start_method() -> str:
    """Return how processes start: never by a fork of this process, whose libraries may have threads."""
    return "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"


def _begin(folder: Path) -> None:
    """Prepare a worker: the parent handles Ctrl-C, and the worker ends with its parent, however that ends.

    Args:
        folder: what is removed if the parent ends without removing it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel, folder), daemon=True).start()


def _end_with(sentinel: int, folder: Path) -> None:
    wait([sentinel])
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _do_nothing() -> None:
    """Return at once: the pool starts a process for each piece of work that waits."""


def _run(message: Any, transfer: Transfer) -> Any:
    """Run packed work; return its packed result and warnings."""
    work, item = message.unpack()
    given: list[str] = []
    with handle_warnings(given.append):
        result = work(item)
    return transfer.pack((result, given))


def _next_of(running: "deque[tuple[Kept, Future[Any]]]") -> tuple[Kept, Any]:
    kept, future = running.popleft()
    return kept, _result_of(future)


def _result_of(future: "Future[Any]") -> Any:
    """Return the result of a worker, and repeat its warnings here."""
    with _explain_death():
        result, given = future.result().unpack()
    for text in given:
        warnings.warn(text, PosefuseWarning, stacklevel=4)
    return result


@contextlib.contextmanager
def _explain_death() -> Iterator[None]:
    try:
        yield
    except (BrokenProcessPool, CancelledError):
        raise PosefuseError(_DEATH) from None


@contextlib.contextmanager
def one_thread_each() -> Iterator[None]:
    """Limit numerical libraries of processes started within to one thread, unless the user sets another number."""
    ours = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(ours, "1"))
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Keep workers started within from importing the user's script, which may have no ``__main__`` guard."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
