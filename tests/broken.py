"""Broken files: random damage, and a subprocess for libraries that do not survive them."""

import subprocess
import sys
from pathlib import Path

import numpy as np

_WORDS = (b"nan", b"1e999", b"null", b"true", b"-", b"[", b"{", b'"', b"99999999999999999999", b",,", b"1" + 400 * b"0")


def broken(original: bytes, rng: np.random.Generator) -> bytes:
    """Return a copy that is truncated or has bytes changed, duplicated, removed or swapped, in one to three places."""
    data = bytearray(original)
    for _ in range(rng.integers(1, 4)):
        if not data:
            break
        at, kind = int(rng.integers(len(data))), rng.integers(6)
        span = int(rng.integers(1, 30))
        if kind == 0:
            del data[at:]
        elif kind == 1:
            data[at] = rng.integers(256)
        elif kind == 2:
            data[at:at] = data[at : at + span]
        elif kind == 3:
            del data[at : at + span]
        elif kind == 4:
            word = _WORDS[rng.integers(len(_WORDS))]
            data[at : at + len(word)] = word
        else:
            other = int(rng.integers(len(data)))
            data[at : at + span], data[other : other + span] = data[other : other + span], data[at : at + span]
    return bytes(data)


def run_library(program: str, path: Path, timeout_s: float = 60.0) -> int:
    """Run a program in another process, with ``path`` defined, and return its exit code: negative after a crash.

    Raises:
        subprocess.TimeoutExpired: If the program does not end in time.
    """
    quiet = "import resource, sys; resource.setrlimit(resource.RLIMIT_CORE, (0, 0)); path = sys.argv[1]; "
    command = [sys.executable, "-c", quiet + program, str(path)]
    return subprocess.run(command, timeout=timeout_s, capture_output=True, check=False).returncode
