"""Property tests with Hypothesis: few fixed examples in ``make test``, many random ones in ``make test-long``."""

import os

from hypothesis import settings

FACTOR = int(os.environ.get("POSEFUSE_EXAMPLES_FACTOR", "1"))


def examples(n: int) -> settings:
    """Run ``n`` examples times the factor given by the environment, without a deadline."""
    return settings(max_examples=n * FACTOR, deadline=None, derandomize=FACTOR == 1)
