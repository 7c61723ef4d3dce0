"""Bound of the work of a search, counted in comparisons of two views, so that every run stops at the same place."""

from dataclasses import dataclass, field


@dataclass(eq=False)
class WorkBudget:
    """Count the work of a search against a limit.

    Attributes:
        limit: largest number of comparisons of two views; a comparison takes about 0.3 ms.
        spent: comparisons so far.
        skipped: what was not examined because it exceeds the limit, in order.
    """

    limit: int
    spent: int = 0
    skipped: list[str] = field(default_factory=list)

    def allow(self, comparisons: int, what: str) -> bool:
        """Return whether work of this size fits and count it; otherwise, note what is skipped."""
        if self.spent + comparisons <= self.limit:
            self.spent += comparisons
            return True
        if what not in self.skipped:
            self.skipped.append(what)
        return False
