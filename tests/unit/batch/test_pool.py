"""Jobs in processes."""

import os

from posefuse.batch.pool import in_processes
from tests.unit.batch.job_functions import do, jobs


def test_dying_process_does_not_affect_other_jobs(tmp_path):
    todo = jobs(tmp_path, "dies", "a", "diesonce", "b", "c")
    actual = {outcome.name: outcome for outcome in in_processes(do, todo, 2)}
    assert {name: outcome.state for name, outcome in actual.items()} == {
        "dies": "failed", "a": "done", "diesonce": "done", "b": "done", "c": "done",
    }  # fmt: skip
    assert "SIGKILL" in actual["dies"].why
    assert "`jobs=1`" in actual["dies"].why
    assert "(2 attempts)" in actual["dies"].why
    assert [name for name in os.environ if name == "NUMBA_NUM_THREADS"] == []


def test_jobs_that_fail_for_an_outside_reason_are_run_again(tmp_path):
    todo = jobs(tmp_path, "wrong", "unreachable", "unreachableonce")
    actual = {outcome.name: outcome for outcome in in_processes(do, todo, 1, retries=2)}
    assert {name: (outcome.state, outcome.why) for name, outcome in actual.items()} == {
        "wrong": ("failed", "wrong."),
        "unreachable": ("failed", "unreachable. (3 attempts)"),
        "unreachableonce": ("done", ""),
    }
