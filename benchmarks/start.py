"""Measure the CPU time of starts: help, and short recordings with compiled and with uncompiled kernels.

``python -m benchmarks.start``; with ``--base FOLDER`` alternately with the version whose repository is in that folder.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parent.parent
SCENES = {"one subject": ["simulate"], "two people": ["simulate-people", "--people", "2"]}


def cpu_s(root: Path, cache: Path, arguments: list[str]) -> float:
    """Return the CPU time of a command in s, of user and system, with its child processes."""
    environment = {**os.environ, "PYTHONPATH": str(root / "src"), "NUMBA_CACHE_DIR": str(cache)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "posefuse", *arguments], check=True, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compare(name: str, roots: list[Path], runs: int, measure: Callable[[Path, int], float]) -> None:
    """Print the medians of the versions, which take turns."""
    times = {root: [] for root in roots}
    for run in range(runs):
        for root in roots:
            times[root].append(measure(root, run))
    for root, values in times.items():
        spread = f"{min(values):.2f} to {max(values):.2f}"
        print(f"{root.name}: {name}: {statistics.median(values):.2f} s of CPU ({spread})", flush=True)


def main() -> None:
    """Run the benchmark and print medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", type=Path, help="repository of another version")
    parser.add_argument("--cold-runs", type=int, default=3, help="number of runs with uncompiled kernels")
    asked = parser.parse_args()
    roots = [ROOT] if asked.base is None else [asked.base.resolve(), ROOT]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        compare("--help", roots, 7, lambda root, _: cpu_s(root, folder, ["--help"]))
        for name, command in SCENES.items():
            recording, output = str(folder / name), str(folder / "result")
            cpu_s(ROOT, folder / "simulation", [*command, "--duration-s", "4", "-o", recording])
            arguments = ["reconstruct", recording, "-o", output, "--overwrite", "--accept-findings"]

            def reconstruct(root: Path, run: int, name: str = name, arguments: list[str] = arguments) -> float:
                return cpu_s(root, folder / f"kernels {name} {roots.index(root)} {run}", arguments)

            compare(f"{name}, uncompiled", roots, asked.cold_runs, reconstruct)
            compare(f"{name}, compiled", roots, 3, lambda root, _, again=reconstruct: again(root, 0))


if __name__ == "__main__":
    main()
