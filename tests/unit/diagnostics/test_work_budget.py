"""Bound of the work of a search."""

from posefuse.diagnostics.work_budget import WorkBudget


def test_work_beyond_the_limit_is_skipped_and_noted_once():
    budget = WorkBudget(10)
    assert budget.allow(6, "a")
    assert not budget.allow(5, "b")
    assert not budget.allow(5, "b")
    assert budget.allow(4, "c")
    assert (budget.spent, budget.skipped) == (10, ["b"])
