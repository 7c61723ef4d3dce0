"""Measure the CPU time of starts: help, and short recordings with an empty cache and with compiled kernels.

``python -m benchmarks.start``; with ``--base FOLDER`` alternately with the version whose repository is in that folder;
with ``--wheel FILE`` alternately with a wheel of ``scripts/build_wheel.py``, which is installed into a new environment.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scripts.install_sizes import install

ROOT = Path(__file__).parent.parent
SCENES = {"one subject": ["simulate"], "two people": ["simulate-people", "--people", "2"]}


@dataclass(frozen=True)
class Version:
    """A version of the package.

    Attributes:
        name: shown name.
        python: interpreter.
        source: folder of the package's source, or None if it is installed.
    """

    name: str
    python: str
    source: Path | None


def cpu_s(version: Version, cache: Path, arguments: list[str]) -> float:
    """Return the CPU time of a command in s, of user and system, with its child processes."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    for name in ("PYTHONDONTWRITEBYTECODE", "PYTHONPATH"):
        environment.pop(name, None)
    if version.source:
        environment["PYTHONPATH"] = str(version.source)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([version.python, "-m", "posefuse", *arguments], check=True, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compare(name: str, versions: list[Version], runs: int, measure: Callable[[Version, int], float]) -> None:
    """Print the medians of the versions, which take turns."""
    times = {version: [] for version in versions}
    for run in range(runs):
        for version in versions:
            times[version].append(measure(version, run))
    for version, values in times.items():
        spread = f"{min(values):.2f} to {max(values):.2f}"
        print(f"{version.name}: {name}: {statistics.median(values):.2f} s of CPU ({spread})", flush=True)


def main() -> None:
    """Run the benchmark and print medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", type=Path, help="repository of another version")
    parser.add_argument("--cold-runs", type=int, default=3, help="number of runs with an empty cache")
    parser.add_argument("--wheel", type=Path, help="wheel that contains compiled kernels")
    asked = parser.parse_args()
    this = Version(ROOT.name, sys.executable, ROOT / "src")
    versions = [this]
    if asked.base:
        versions.append(Version(asked.base.name, sys.executable, asked.base.resolve() / "src"))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if asked.wheel:
            python = str(install(asked.wheel, folder / "environment").python)
            versions.append(Version(asked.wheel.name, python, None))
        compare("--help", versions, 7, lambda version, _: cpu_s(version, folder, ["--help"]))
        for name, command in SCENES.items():
            recording, output = str(folder / name), str(folder / "result")
            cpu_s(this, folder / "simulation", [*command, "--duration-s", "4", "-o", recording])
            arguments = ["reconstruct", recording, "-o", output, "--overwrite", "--accept-findings"]

            def reconstruct(version: Version, run: int, name: str = name, arguments: list[str] = arguments) -> float:
                return cpu_s(version, folder / f"kernels {name} {versions.index(version)} {run}", arguments)

            compare(f"{name}, empty cache", versions, asked.cold_runs, reconstruct)
            compare(f"{name}, compiled", versions, 3, lambda version, _, again=reconstruct: again(version, 0))


if __name__ == "__main__":
    main()
