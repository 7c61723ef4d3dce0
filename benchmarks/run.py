"""All benchmarks: accuracy against the oracle and its gate, then speed beside the peers."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks import accuracy, long, pairs, quick, rejection, sides, speed, swapped, trajectory


def main() -> int:
    """Run all benchmarks; return 1 if the accuracy gate fails."""
    failed = accuracy.main()
    speed.main()
    rejection.main()
    pairs.main()
    sides.main()
    swapped.main()
    trajectory.main()
    quick.main()
    long.main()
    return failed


if __name__ == "__main__":
    sys.exit(main())
