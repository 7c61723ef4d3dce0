"""Run all benchmarks: accuracy against the oracle and its gate, then speed in comparison with other programs."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks import (
    accuracy,
    fast_motion,
    left_right_correction,
    long_trajectory,
    pairs,
    rejection,
    side_assignment,
    speed,
    trajectory,
)


def main() -> int:
    """Run all benchmarks; return 1 if the accuracy gate fails."""
    failed = accuracy.main()
    speed.main()
    rejection.main()
    pairs.main()
    side_assignment.main()
    left_right_correction.main()
    trajectory.main()
    fast_motion.main()
    long_trajectory.main()
    return failed


if __name__ == "__main__":
    sys.exit(main())
