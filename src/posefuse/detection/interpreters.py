"""Find a Python interpreter of a version that a detector supports."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from posefuse.errors import DetectorError

_PROBE = "import struct, sys; print(sys.version_info[1], struct.calcsize('P') * 8, sys.implementation.name)"
_PROBE_TIMEOUT_S = 30.0


def find_python(supported: tuple[int, int], given: Path | None, detector: str) -> Path:
    """Return an interpreter of a supported version, the one of this process if it fits, else the newest.

    Args:
        supported: oldest and newest minor version of Python 3.
        given: the interpreter to use, or None to search.
        detector: name of the detector, for messages.

    Raises:
        DetectorError: if there is none, or the given one does not fit.
    """
    oldest, newest = supported
    wanted = f"CPython 3.{oldest} to 3.{newest}, 64 bits"
    if given is not None:
        minor = minor_version(given)
        if minor is None or not oldest <= minor <= newest:
            what = "cannot be run as CPython of 64 bits" if minor is None else f"is Python 3.{minor}"
            raise DetectorError(f"{detector} needs {wanted}, but {given} {what}. Name another `python`.")
        return given
    for candidate in _candidates(supported):
        minor = minor_version(candidate)
        if minor is not None and oldest <= minor <= newest:
            return candidate
    raise DetectorError(
        f"{detector} needs {wanted}, and this computer has none. Install Python 3.{newest} or uv, which downloads "
        "Python, and repeat the command; or name the interpreter by `python`."
    )


def minor_version(python: Path) -> int | None:
    """Return the minor version of a CPython 3 of 64 bits, or None if the file is none."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    try:
        done = subprocess.run(
            [str(python), "-I", "-c", _PROBE],
            capture_output=True,
            text=True,
            timeout=_PROBE_TIMEOUT_S,
            env=environment,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    words = done.stdout.split()
    return int(words[0]) if done.returncode == 0 and words[1:] == ["64", "cpython"] else None


def _candidates(supported: tuple[int, int]) -> Iterator[Path]:
    """Yield interpreters: that of this process, those of the search path, of uv and of pyenv, newest first."""
    yield Path(sys.executable)
    oldest, newest = supported
    uv = find_uv()
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    for minor in range(newest, oldest - 1, -1):
        found = shutil.which(f"python3.{minor}")
        if found:
            yield Path(found)
        if uv is not None:
            yield from _python_of_uv(uv, minor)
        yield from sorted(pyenv.glob(f"3.{minor}.*/bin/python"))
    for name in ("python3", "python"):
        found = shutil.which(name)
        if found:
            yield Path(found)
    if uv is not None:
        yield from _python_of_uv(uv, newest, download=True)


def _python_of_uv(uv: Path, minor: int, *, download: bool = False) -> Iterator[Path]:
    """Yield the interpreter that uv finds or downloads."""
    if download:
        subprocess.run([str(uv), "python", "install", f"3.{minor}"], capture_output=True, check=False)
    command = [str(uv), "python", "find", "--system", "--no-project", "--offline", f"3.{minor}"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    if found.returncode == 0 and found.stdout.strip():
        yield Path(found.stdout.strip())


def find_uv() -> Path | None:
    """Return the program uv, or None if it is neither on the search path nor beside this interpreter."""
    found = shutil.which("uv") or shutil.which("uv", path=str(Path(sys.executable).parent))
    return Path(found) if found else None
