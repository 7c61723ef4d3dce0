"""Which cluster runs a batch."""

import sys

import pytest

from posefuse.batch.schedulers import Scheduler, WorkerCount, connected
from posefuse.errors import OptionsError, StreamError


def test_numbers_of_workers_are_fixed_or_adaptive():
    assert WorkerCount.of("4") == WorkerCount(4, 4)
    assert not WorkerCount.of("4").is_adaptive
    assert WorkerCount.of("0..16") == WorkerCount(0, 16)
    assert WorkerCount.of("0..16").is_adaptive
    for text in ("0", "4..2", "many", "1..", ""):
        with pytest.raises(OptionsError, match="must be a number such as 4, or a range such as 0..16"):
            WorkerCount.of(text)


def test_workers_of_an_existing_scheduler_are_not_counted():
    with pytest.raises(OptionsError, match="has workers already"):
        Scheduler("tcp://host:8786", WorkerCount(1, 1))
    assert Scheduler("dask_jobqueue.SLURMCluster", WorkerCount(0, 8)).is_started_here
    assert not Scheduler("tls://host.example.com:8786").is_started_here


def test_class_of_clusters_is_started_and_scaled():
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    module = type(sys)("own_clusters")
    made = []

    def start() -> object:
        made.append(
            distributed.LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", processes=False, silence_logs=50)
        )
        return made[0]

    module.OwnCluster = start
    sys.modules["own_clusters"] = module
    try:
        with connected(Scheduler("own_clusters.OwnCluster", WorkerCount(1, 1)), 1) as client:
            assert client.submit(sum, (1, 2)).result() == 3
        assert made[0].status.name == "closed"
        with (
            pytest.raises(StreamError, match="has no attribute 'Other'"),
            connected(Scheduler("own_clusters.Other"), 1),
        ):
            pass
        module.OwnCluster = lambda: 1 / 0
        with pytest.raises(StreamError, match="division by zero"), connected(Scheduler("own_clusters.OwnCluster"), 1):
            pass
    finally:
        del sys.modules["own_clusters"]


def test_missing_dask_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(StreamError, match=r"pip install 'posefuse\[cluster\]'"), connected(Scheduler("local"), 1):
        pass
