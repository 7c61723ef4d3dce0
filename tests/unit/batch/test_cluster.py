"""Jobs on a cluster."""

import os
import signal

import pytest

from posefuse.batch.cluster import on_cluster
from posefuse.errors import StreamError
from tests.unit.batch.job_functions import do, jobs


def test_tasks_of_a_dying_cluster_worker_run_elsewhere(tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    names = [f"slow_{i}" for i in range(6)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        actual = {}
        for outcome in on_cluster(do, jobs(tmp_path, *names), cluster.scheduler_address):
            if not actual:
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
            actual[outcome.name] = outcome
    assert {name: outcome.state for name, outcome in actual.items()} == dict.fromkeys(names, "done")


def test_missing_scheduler_is_an_error():
    pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    with pytest.raises(StreamError, match="No Dask scheduler answers at nowhere"):
        list(on_cluster(do, [], "nowhere"))
