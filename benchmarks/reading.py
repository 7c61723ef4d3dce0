"""Shared code of the reading benchmarks: write recordings of several sizes and read each in its own process."""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Benchmark:
    """A benchmark of reading.

    Attributes:
        module: module for ``python -m``.
        about: description for the command line.
        flag: command-line flag of the sizes.
        sizes: default sizes.
        kind: type of a size.
        write: writes a recording of a size to a folder.
        read: reads the recording in a folder and returns figures about its content.
        line: formats the figures and costs as one line.
    """

    module: str
    about: str
    flag: str
    sizes: tuple[float, ...]
    kind: Callable[[str], Any]
    write: Callable[[Any, Path], object]
    read: Callable[[Path], dict[str, float]]
    line: Callable[[dict[str, float]], str]


def measured(read: Callable[[Path], dict[str, float]], folder: Path) -> dict[str, float]:
    """Return the figures of ``read``, wall and processor seconds, and peak MB."""
    size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    wall, used = time.perf_counter(), time.process_time()
    found = read(folder)
    wall_s, processor_s = time.perf_counter() - wall, time.process_time() - used
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return found | {
        "wall_s": wall_s,
        "processor_s": processor_s + children.ru_utime + children.ru_stime,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "gigabytes": size / 1e9,
    }


def forget(folder: Path) -> None:
    """Flush files to disk and drop them from the system's cache."""
    os.sync()
    for file in folder.rglob("*"):
        if file.is_file():
            handle = os.open(file, os.O_RDONLY)
            os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
            os.close(handle)


def run(benchmark: Benchmark) -> None:
    """Write and read recordings of the sizes given on the command line."""
    parser = argparse.ArgumentParser(description=benchmark.about)
    parser.add_argument(f"--{benchmark.flag}", dest="sizes", type=benchmark.kind, nargs="+", default=benchmark.sizes)
    parser.add_argument("--folder", type=Path, help="recording to read; by default one of each size is created")
    parser.add_argument("--cold", action="store_true", help="drop the files from the system's cache first")
    parser.add_argument("--json", action="store_true", help="say it as JSON")
    chosen = parser.parse_args()
    if chosen.folder is not None:
        if chosen.cold:
            forget(chosen.folder)
        took = measured(benchmark.read, chosen.folder)
        print(json.dumps(took) if chosen.json else benchmark.line(took))
        return
    for size in chosen.sizes:
        with tempfile.TemporaryDirectory() as folder:
            benchmark.write(size, Path(folder) / "recording")
            command = [sys.executable, "-m", benchmark.module, "--folder", f"{folder}/recording", "--json"]
            command += ["--cold"] if chosen.cold else []
            out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        print(benchmark.line(json.loads(out)), flush=True)
