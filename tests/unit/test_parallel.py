"""Work in processes: order, bounded lead, errors, warnings, and processes that die."""

import os
import signal
import subprocess
import sys
import threading
import time
import warnings

import numpy as np
import pytest

from posefuse.errors import DetectionsError, OptionsError, PosefuseError, PosefuseWarning
from posefuse.parallel import ONE_JOB, Jobs, logical_cores, number_of_jobs, physical_cores


def slower_for_some(item: int) -> int:
    time.sleep(0.02 if item % 3 == 0 else 0.0)
    return item**2


def inverse(item: int) -> float:
    if item == 0:
        raise DetectionsError("No keypoint.")
    return 1.0 / item


def warn_of(item: int) -> int:
    warnings.warn(f"item {item}", PosefuseWarning, stacklevel=1)
    return item


def die(item: int) -> int:
    if item == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def doubled(numbers: np.ndarray) -> np.ndarray:
    return 2.0 * numbers


def process_of(_: int) -> int:
    time.sleep(0.2)
    return os.getpid()


@pytest.fixture(scope="module")
def two_jobs():
    with Jobs(2) as jobs:
        yield jobs


@pytest.fixture(params=[1, 2])
def jobs(request, two_jobs):
    return ONE_JOB if request.param == 1 else two_jobs


def test_results_are_in_the_order_of_the_items(jobs):
    assert list(jobs.in_order(slower_for_some, range(20))) == [item**2 for item in range(20)]
    pairs = ((str(item), item) for item in range(5))
    assert list(jobs.in_order_with(slower_for_some, pairs)) == [(str(item), item**2) for item in range(5)]
    assert jobs.begin(slower_for_some, 7)() == 49


def test_work_runs_in_other_processes(two_jobs):
    processes = set(two_jobs.in_order(process_of, range(4)))
    assert len(processes) == 2
    assert os.getpid() not in processes
    assert set(ONE_JOB.in_order(process_of, range(1))) == {os.getpid()}


def test_few_items_are_taken_in_advance(jobs):
    taken = []

    def items():
        for item in range(20):
            taken.append(item)
            yield item

    for done, _ in enumerate(jobs.in_order(slower_for_some, items()), 1):
        assert len(taken) <= done + 2


def test_more_items_are_taken_in_advance_on_request(two_jobs):
    taken = []
    results = two_jobs.in_order(slower_for_some, (taken.append(item) or item for item in range(8)), lead=6)
    assert next(results) == 0
    assert taken == list(range(7))
    assert list(results) == [item**2 for item in range(1, 8)]


def test_a_thread_makes_the_item_of_a_piece_of_work(jobs):
    assert jobs.begin_made(slower_for_some, lambda: 7)() == 49
    wait = jobs.begin_made(inverse, lambda: 0)
    with pytest.raises(DetectionsError, match="No keypoint"):
        wait()
    made, may_be_made = [], threading.Event()

    def make() -> int:
        made.append(threading.current_thread())
        assert may_be_made.wait(10.0)
        return 2

    wait = jobs.begin_made(inverse, make)
    may_be_made.set()
    assert wait() == 0.5
    assert (made == [threading.main_thread()]) == (jobs is ONE_JOB)


def test_an_error_is_raised_in_its_place(jobs):
    results = jobs.in_order(inverse, [2, 1, 0, 1])
    assert [next(results), next(results)] == [0.5, 1.0]
    with pytest.raises(DetectionsError, match="No keypoint"):
        next(results)


def test_warnings_are_given_with_the_result(jobs):
    results = jobs.in_order(warn_of, [3, 4])
    for item in (3, 4):
        with pytest.warns(PosefuseWarning, match=f"item {item}"):
            assert next(results) == item


def test_the_next_item_is_computed_ahead(two_jobs):
    begun = [threading.Event() for _ in range(4)]

    def items():
        for item in range(3):
            begun[item].set()
            yield item

    ahead = two_jobs.ahead(items())
    assert next(ahead) == 0
    assert begun[1].wait(10.0)
    assert not begun[2].is_set()
    assert list(ahead) == [1, 2]
    lazy = ONE_JOB.ahead(items())
    begun[1].clear()
    assert next(lazy) == 0
    assert not begun[1].is_set()


def test_calls_run_together(two_jobs):
    both = threading.Barrier(2, timeout=10.0)
    assert sorted(two_jobs.together(both.wait, both.wait)) == [0, 1]
    assert ONE_JOB.together(lambda: 1, lambda: 2) == [1, 2]


def test_a_thread_ends_its_work(two_jobs):
    with two_jobs.thread() as thread:
        work = thread.submit(time.sleep, 0.05)
    assert work.done()
    with ONE_JOB.thread() as none:
        assert none is None


def test_a_process_that_dies_is_an_error_that_says_what_to_do():
    with pytest.raises(PosefuseError, match="may have run out of memory.*jobs=1"), Jobs(2) as jobs:
        list(jobs.in_order(die, range(4)))


def test_workers_and_their_files_end_with_a_parent_that_is_killed():
    """A script without a main guard starts workers, prints their processes and folder, and is killed."""
    script = (
        "import os\nfrom posefuse.parallel import Jobs\nfrom tests.unit.test_parallel import process_of\n"
        "jobs = Jobs(2).__enter__()\nprint(*set(jobs.in_order(process_of, range(4))), flush=True)\n"
        "jobs._transfer.pack(bytearray(10**7))\nprint(jobs._transfer.folder, flush=True)\nos.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=120)
    first, folder = done.stdout.splitlines()
    workers = [f"/proc/{each}" for each in first.split()]
    assert len(workers) == 2, done.stderr
    until = time.monotonic() + 20.0
    while any(os.path.exists(each) for each in (*workers, folder)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(os.path.exists(each) for each in (*workers, folder))


def test_large_arrays_arrive_whole(jobs):
    numbers = [np.full((300, 1000), float(i)) for i in range(5)]
    for i, got in enumerate(jobs.in_order(doubled, numbers)):
        np.testing.assert_array_equal(got, 2.0 * numbers[i])
    assert jobs._transfer is None or list(jobs._transfer.folder.iterdir()) == []


def test_the_number_of_processes_is_checked():
    assert 1 <= physical_cores() <= logical_cores()
    assert number_of_jobs("auto", 1) == 1
    assert number_of_jobs("auto", 1000) == physical_cores()
    assert number_of_jobs(3, 1) == 3
    with pytest.raises(OptionsError, match="jobs must be at least 1"):
        number_of_jobs(0, 1)
