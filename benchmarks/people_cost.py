"""CPU time of ``posefuse calibrate`` from a person: eight cameras, 60 s at 30 Hz.

    python -m benchmarks.people_cost [--rounds 3] [--lenses known unknown]

The recording is that of ``posefuse simulate``. Each round is a new process with one thread of linear algebra; the first
one compiles kernels that are not cached.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

CAMERAS, DURATION_S, RATE_HZ = 8, 60, 30


def posefuse(*words: str | Path) -> float:
    """Run a command in a new process, and return its CPU time in s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run(
        [sys.executable, "-m", "posefuse", *map(str, words)], check=True, capture_output=True, env=environment
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(lenses: str, rounds: int) -> list[float]:
    """Return the CPU times of calibrations of one recording, in s.

    Args:
        lenses: known or unknown.
        rounds: number of calibrations.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        posefuse(
            "simulate", folder / "scene", "--cameras", str(CAMERAS), "--duration-s", str(DURATION_S), "--rate-hz",
            str(RATE_HZ),
        )  # fmt: skip
        known = folder / "known.toml"
        (folder / "scene" / "calibration.toml").rename(known)
        given = ["--intrinsics", known] if lenses == "known" else ["--image-size", "1920", "1080"]
        times = []
        for k in range(rounds):
            output = folder / f"{k}.toml"
            times.append(posefuse("calibrate", folder / "scene", "--output", output, "--stature-m", "1.75", *given))
        return times


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--lenses", nargs="*", choices=["known", "unknown"], default=["known"])
    given = parser.parse_args()
    for lenses in given.lenses:
        times = measure(lenses, given.rounds)
        median_s = statistics.median(times)
        print(f"lenses {lenses}: CPU {median_s:.2f} s (median of {given.rounds}), least {min(times):.2f} s")


if __name__ == "__main__":
    main()
