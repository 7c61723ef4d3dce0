"""Jobs on a cluster."""

import os
import signal
import threading

import pytest

from posefuse.batch.cluster import on_cluster
from posefuse.batch.schedulers import Scheduler, WorkerCount
from posefuse.errors import PosefuseWarning, StreamError
from tests.unit.batch.job_functions import do, jobs

OPTIONS = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": 50}


@pytest.fixture
def distributed():
    return pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")


def states(outcomes) -> dict[str, str]:
    return {outcome.name: outcome.state for outcome in outcomes}


def test_tasks_of_a_dying_cluster_worker_run_elsewhere(tmp_path, distributed):
    names = [f"slow_{i}" for i in range(6)]
    with distributed.LocalCluster(n_workers=2, **OPTIONS) as cluster:
        actual = {}
        for outcome in on_cluster(do, jobs(tmp_path, *names), Scheduler(cluster.scheduler_address)):
            if not actual:
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
            actual[outcome.name] = outcome
    assert states(actual.values()) == dict.fromkeys(names, "done")


def test_adaptive_cluster_of_this_machine_starts_workers_and_runs_failed_jobs_again(tmp_path, distributed):
    names = ["slow_0", "slow_1", "wrong", "unreachable", "unreachableonce", "diesonce"]
    local = Scheduler("local", WorkerCount.of("0..2"))
    actual = {outcome.name: outcome for outcome in on_cluster(do, jobs(tmp_path, *names), local, retries=1)}
    assert states(actual.values()) == {
        **dict.fromkeys(names, "done"), "wrong": "failed", "unreachable": "failed",
    }  # fmt: skip
    assert actual["wrong"].why == "wrong."
    assert actual["unreachable"].why == "unreachable. (2 attempts)"


def test_existing_scheduler_may_be_adaptive_and_without_workers(tmp_path, distributed):
    with distributed.LocalCluster(n_workers=0, **OPTIONS) as cluster:
        threading.Timer(1.0, cluster.adapt, kwargs={"minimum": 0, "maximum": 2}).start()
        with pytest.warns(PosefuseWarning, match="has no workers. The batch waits for them"):
            actual = list(on_cluster(do, jobs(tmp_path, "a", "b", "c"), Scheduler(cluster.scheduler_address)))
    assert states(actual) == dict.fromkeys("abc", "done")


def test_job_that_kills_its_workers_fails(tmp_path, distributed):
    local = Scheduler("local", WorkerCount(1, 1))
    (outcome,) = on_cluster(do, jobs(tmp_path, "dies"), local, retries=0)
    assert (outcome.state, "KilledWorker" in outcome.why) == ("failed", True)


def test_missing_scheduler_is_an_error(distributed):
    with pytest.raises(StreamError, match="No Dask scheduler answers at nowhere:1"):
        list(on_cluster(do, [], Scheduler("nowhere:1")))
