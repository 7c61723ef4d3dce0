"""Laws, by Hypothesis: a few examples, always the same ones, in ``make test``; many new ones in ``make test-long``."""

import os

from hypothesis import settings

FACTOR = int(os.environ.get("POSEFUSE_EXAMPLES_FACTOR", "1"))


def examples(n: int) -> settings:
    """Run ``n`` examples, or that many times the factor of the environment; each may take its time."""
    return settings(max_examples=n * FACTOR, deadline=None, derandomize=FACTOR == 1)
