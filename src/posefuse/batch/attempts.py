"""How often jobs are run again that fail for a reason outside of their recordings."""

from collections import Counter
from dataclasses import dataclass, field, replace

from posefuse.model.batch import JobResult


@dataclass
class Attempts:
    """Counts the attempts at each job.

    Attributes:
        retries: how often a job is run again.
    """

    retries: int
    _failed: Counter[str] = field(default_factory=Counter)

    def again(self, result: JobResult) -> bool:
        """Return whether a job is to be run again: another attempt may succeed, and is allowed."""
        if result.state != "failed" or not result.transient:
            return False
        self._failed[result.name] += 1
        return self._failed[result.name] <= self.retries

    def described(self, result: JobResult) -> JobResult:
        """Return the last result of a job, whose reason states the number of attempts if there were several."""
        count = self._failed[result.name]
        if result.state != "failed" or count < 2:
            return result
        return replace(result, why=f"{result.why} ({count} attempts)")
