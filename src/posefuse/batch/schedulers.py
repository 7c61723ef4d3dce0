"""Dask clusters: an existing one by its address, one on this machine, or one of another class, fixed or adaptive."""

import importlib
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from posefuse.errors import OptionsError, StreamError

LOCAL = "local"
_CONNECT_S = 20
_LOCAL_OPTIONS: dict[str, Any] = {
    "threads_per_worker": 1,
    "memory_limit": 0,
    # Without an address, Dask serves its status on port 8787 of all networks, for one cluster per machine.
    "dashboard_address": "127.0.0.1:0",
    "scheduler_kwargs": {"dashboard": False},
    "silence_logs": 50,
}
"""Workers are processes without a limit of memory, as those of a batch without Dask."""
_WORKERS = re.compile(r"(\d+)(?:\.\.(\d+))?")
_ADDRESS = re.compile(r"://|:\d+$")
_CLASS = re.compile(r"[A-Za-z_][\w.]*\.[A-Z]\w*")
_TASK_DURATION = "10 minutes"
"""Assumed duration of the first tasks. With Dask's half a second, an adaptive cluster starts too few workers."""


@dataclass(frozen=True)
class WorkerCount:
    """Number of workers of a cluster.

    Attributes:
        least: number of workers that are always there.
        most: number of workers that there are at most; a cluster with more than the least is adaptive.
    """

    least: int
    most: int

    @classmethod
    def of(cls, text: str) -> "WorkerCount":
        """Return the number in a text such as ``4``, or the range in one such as ``0..16``.

        Raises:
            OptionsError: if it is neither.
        """
        match = _WORKERS.fullmatch(text.strip())
        least, most = (0, 0) if match is None else (int(match[1]), int(match[2] or match[1]))
        if most < max(least, 1):
            raise OptionsError(
                f"`workers` must be a number such as 4, or a range such as 0..16 for an adaptive cluster, got {text!r}."
            )
        return cls(least, most)

    @property
    def is_adaptive(self) -> bool:
        """Whether the number follows the work."""
        return self.most > self.least


@dataclass(frozen=True)
class Scheduler:
    """Which cluster runs a batch.

    Attributes:
        name: address of a scheduler, ``local``, or a class of clusters such as ``dask_jobqueue.SLURMCluster``.
        workers: number of workers; None for the default of the cluster.
    """

    name: str
    workers: WorkerCount | None = None

    def __post_init__(self) -> None:
        if not self.is_started_here and _ADDRESS.search(self.name) is None:
            raise OptionsError(
                f"`scheduler` must be {LOCAL!r}, the address of a scheduler such as tcp://host:8786, or a class of "
                f"clusters such as dask_jobqueue.SLURMCluster, got {self.name!r}."
            )
        if self.workers is not None and not self.is_started_here:
            raise OptionsError(
                f"The scheduler at {self.name} has workers already; their number is set where they were started "
                "(dask worker, or cluster.adapt). Remove `workers`, or give `scheduler='local'` or a class of clusters "
                "such as dask_jobqueue.SLURMCluster."
            )

    @property
    def is_started_here(self) -> bool:
        """Whether the cluster is started for this batch."""
        return self.name == LOCAL or _CLASS.fullmatch(self.name) is not None


@contextmanager
def connected(scheduler: Scheduler, default_workers: int) -> Iterator[Any]:
    """Yield a Dask client of a cluster, which is started first and closed at the end unless it existed.

    Args:
        scheduler: the cluster.
        default_workers: number of workers of a cluster on this machine.

    Raises:
        StreamError: if Dask or the class of the cluster is not installed, the cluster cannot be started, or no
            scheduler answers at the address.
    """
    try:
        import dask.config
        from distributed import Client
    except ImportError:
        raise StreamError(
            f"`scheduler={scheduler.name!r}` needs Dask, which is not installed. Install it: pip install "
            "'posefuse[cluster]'."
        ) from None
    with ExitStack() as stack:
        if scheduler.is_started_here:
            stack.enter_context(dask.config.set({"distributed.scheduler.unknown-task-duration": _TASK_DURATION}))
            yield stack.enter_context(Client(stack.enter_context(_started(scheduler, default_workers))))
            return
        try:
            client = Client(scheduler.name, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise StreamError(
                f"No Dask scheduler answers at {scheduler.name}: {error}. Start one (dask scheduler), give "
                "`scheduler='local'`, or remove `scheduler`."
            ) from None
        yield stack.enter_context(client)


def _started(scheduler: Scheduler, default_workers: int) -> Any:
    """Start a cluster."""
    workers = scheduler.workers
    if scheduler.name == LOCAL:
        from distributed import LocalCluster

        workers = workers or WorkerCount(default_workers, default_workers)
        cluster = LocalCluster(n_workers=workers.least, **_LOCAL_OPTIONS)
    else:
        cluster = _cluster_of_class(scheduler.name)
    if workers is not None and workers.is_adaptive:
        cluster.adapt(minimum=workers.least, maximum=workers.most)
    elif workers is not None and scheduler.name != LOCAL:
        cluster.scale(workers.least)
    return cluster


def _cluster_of_class(name: str) -> Any:
    """Return a cluster of a class, configured by Dask's files of configuration."""
    module, _, class_name = name.rpartition(".")
    try:
        make = getattr(importlib.import_module(module), class_name)
    except (ImportError, AttributeError) as error:
        raise StreamError(
            f"`scheduler={name!r}`: {error}. Install the package of this class of clusters, such as dask-jobqueue for "
            "dask_jobqueue.SLURMCluster."
        ) from None
    try:
        return make()
    except Exception as error:
        what = " ".join(str(error).split())[:200]
        raise StreamError(
            f"{name}() cannot be started: {what.rstrip('.')}. Its arguments are read from Dask's configuration "
            "(~/.config/dask/*.yaml)."
        ) from None
