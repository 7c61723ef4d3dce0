"""Python environments of detectors, one per detector, in the user's cache or under ``POSEFUSE_HOME``.

An environment is complete when its file ``posefuse.json`` exists, which is written last. An interrupted installation is
repeated in the same folder.
"""

import contextlib
import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Literal

from posefuse.detection.interpreters import find_python, find_uv
from posefuse.detection.process import WorkerCommand, WorkerProcess, WorkerSettings
from posefuse.detection.registry import DetectorRecord, Requirements
from posefuse.errors import DetectorError
from posefuse.folders import home_folder
from posefuse.progress import Progress, Silent

State = Literal["installed", "incomplete", "outdated", "not installed"]
Device = Literal["auto", "cpu", "cuda"]
_MARKER = "posefuse.json"
_MOST_TEXT = 300
_INSTALLERS = ("pip", "setuptools", "wheel")


@dataclass(frozen=True)
class Environment:
    """The environment of a detector as it is on disk.

    Attributes:
        folder: its folder.
        state: whether it is complete and has the packages that this version of posefuse asks for.
        python: its interpreter.
        version: version of its Python, or empty.
        size_mb: its size, 0 if it is not complete.
        cuda: whether it has the packages for CUDA.
    """

    folder: Path
    state: State
    python: Path
    version: str = ""
    size_mb: int = 0
    cuda: bool = False


def environment_of(record: DetectorRecord) -> Environment:
    """Return the environment of a detector, installed or not."""
    folder = home_folder() / "detectors" / record.name
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not folder.is_dir():
        return Environment(folder, "not installed", python)
    try:
        marker = json.loads((folder / _MARKER).read_text("utf-8"))
        version, size_mb, cuda = str(marker["python"]), int(marker["size_mb"]), bool(marker["cuda"])
    except (OSError, ValueError, KeyError, TypeError):
        return Environment(folder, "incomplete", python)
    if not python.exists():
        return Environment(folder, "incomplete", python)
    needed = requirements_of(record, cuda=cuda)
    state: State = "installed" if marker.get("requirements") == _digest(needed) else "outdated"
    return Environment(folder, state, python, version, size_mb, cuda)


def installed_python(record: DetectorRecord) -> Path:
    """Return the interpreter of a detector's environment.

    Raises:
        DetectorError: if the environment is not installed, not complete or of another version; the message has the
            command that installs it.
    """
    environment = environment_of(record)
    if environment.state == "installed":
        return environment.python
    problem = {
        "not installed": "is not installed",
        "incomplete": "is installed incompletely",
        "outdated": "was installed by another version of posefuse, with other packages",
    }[environment.state]
    size = f"{record.requirements.download_mb} MB to download, {record.requirements.size_mb} MB on disk"
    raise DetectorError(f"The detector {record.name} {problem}. Run: posefuse detector install {record.name} ({size}).")


def requirements_of(record: DetectorRecord, *, cuda: bool) -> Requirements:
    """Return the packages of a detector's environment.

    Raises:
        DetectorError: if CUDA is asked for and the detector runs on the CPU only.
    """
    if not cuda:
        return record.requirements
    if record.cuda is None:
        raise DetectorError(f"The detector {record.name} runs on the CPU only. Use `device='cpu'`.")
    return record.cuda


def install(
    record: DetectorRecord,
    *,
    python: Path | None = None,
    device: Device = "auto",
    progress: Progress | None = None,
) -> Environment:
    """Create the environment of a detector, complete an interrupted one, or update an outdated one.

    Args:
        record: the detector.
        python: interpreter on which the environment is based; by default one that is found.
        device: ``cuda`` installs the packages for an NVIDIA GPU, ``auto`` does if the program ``nvidia-smi`` exists.
        progress: receives remarks.

    Raises:
        DetectorError: if no Python fits, the packages cannot be downloaded, or the detector does not start.
    """
    gpu = shutil.which("nvidia-smi") is not None and record.cuda is not None
    cuda = device == "cuda" or (device == "auto" and gpu)
    with _locked(record):
        return _install(record, python, cuda, progress or Silent())


def _install(record: DetectorRecord, python: Path | None, cuda: bool, progress: Progress) -> Environment:
    environment = environment_of(record)
    needed = requirements_of(record, cuda=cuda)
    if environment.state == "installed" and environment.cuda == cuda and python is None:
        return environment
    if environment.state == "outdated" or environment.cuda != cuda or python is not None or not _runs(environment):
        shutil.rmtree(environment.folder, ignore_errors=True)
    (environment.folder / _MARKER).unlink(missing_ok=True)
    if not environment.folder.is_dir():
        base = find_python(needed.python, python, record.name)
        progress.note(f"Creating {environment.folder} with {base}.")
        _create(environment.folder, base)
    _install_packages(environment.python, needed, record, progress)
    _check(record, environment.python)
    _write_marker(environment, needed, cuda=cuda)
    return environment_of(record)


def remove(record: DetectorRecord) -> bool:
    """Remove the environment of a detector; return whether there was one."""
    folder = environment_of(record).folder
    if not folder.is_dir():
        return False
    with _locked(record):
        (folder / _MARKER).unlink(missing_ok=True)
        shutil.rmtree(folder)
    return True


def worker_file(record: DetectorRecord) -> Path:
    """Return the worker file of a detector."""
    return Path(str(files("posefuse.detection.workers").joinpath(record.worker)))


@contextlib.contextmanager
def _locked(record: DetectorRecord) -> Iterator[None]:
    """Wait until no other process installs or removes the detector; without such locks (Windows), do not wait."""
    folder = environment_of(record).folder.parent
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f".{record.name}.lock").open("w") as file:
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _create(folder: Path, base: Path) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    uv = find_uv()
    if uv is not None:
        command = [str(uv), "venv", "--quiet", "--no-project", "--python", str(base), str(folder)]
    else:
        command = [str(base), "-I", "-m", "venv", str(folder)]
    code, lines = _run(command)
    if code:
        shutil.rmtree(folder, ignore_errors=True)
        hint = " On Debian and Ubuntu, run: apt install python3-venv." if "ensurepip" in " ".join(lines) else ""
        raise DetectorError(f"{base} cannot create the environment {folder}: {_problem(lines)}.{hint}")


def _install_packages(python: Path, needed: Requirements, record: DetectorRecord, progress: Progress) -> None:
    """Install exactly the pinned packages; what is there already is kept."""
    progress.note(
        f"Downloading the packages of {record.name}, about {needed.download_mb} MB ({needed.size_mb} MB on disk)."
    )
    uv = find_uv()
    if uv is not None:
        command = [str(uv), "pip", "install", "--quiet", "--python", str(python), "--no-deps"]
    else:
        if _run([str(python), "-I", "-m", "pip", "--version"])[0]:
            _run([str(python), "-I", "-m", "ensurepip"])
        command = [str(python), "-m", "pip", "install", "--quiet", "--no-deps", "--disable-pip-version-check"]
    folder = files("posefuse.detection.requirements")
    for name in needed.files:
        text = folder.joinpath(name).read_text("utf-8")
        hashed = ["--require-hashes"] if "--hash" in text else []
        code, lines = _run([*command, *hashed, "-r", str(folder.joinpath(name))])
        if code:
            raise DetectorError(
                f"The packages of {record.name} were not installed: {_problem(lines)}. Check the network and repeat "
                "the command; what was downloaded is kept."
            )
    if uv is None:
        _run([str(python), "-m", "pip", "uninstall", "--quiet", "--yes", *reversed(_INSTALLERS)])


def _check(record: DetectorRecord, python: Path) -> None:
    """Start the detector's worker once, as far as that needs no weights.

    Raises:
        DetectorError: if it does not start.
    """
    command = WorkerCommand(record.name, python, worker_file(record))
    WorkerProcess(command, WorkerSettings(model=record.models[0].name, check=True)).close()


def _write_marker(environment: Environment, needed: Requirements, *, cuda: bool) -> None:
    size = sum(path.lstat().st_size for path in environment.folder.rglob("*") if not path.is_dir())
    code, lines = _run([str(environment.python), "-I", "-c", "import platform; print(platform.python_version())"])
    marker = {
        "requirements": _digest(needed),
        "python": "" if code else lines[-1],
        "size_mb": round(size / 1e6),
        "cuda": cuda,
    }
    temporary = environment.folder / f"{_MARKER}.part"
    temporary.write_text(json.dumps(marker), "utf-8")
    os.replace(temporary, environment.folder / _MARKER)


def _digest(needed: Requirements) -> str:
    folder = files("posefuse.detection.requirements")
    return hashlib.sha256(b"".join(folder.joinpath(name).read_bytes() for name in needed.files)).hexdigest()


def _runs(environment: Environment) -> bool:
    return environment.python.exists() and not _run([str(environment.python), "-I", "-c", ""])[0]


def _run(command: Sequence[str]) -> tuple[int, list[str]]:
    """Run a program; return its exit code and the lines that it printed."""
    variables = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    variables |= {"UV_PYTHON_DOWNLOADS": "never", "PYTHONNOUSERSITE": "1", "VIRTUAL_ENV": ""}
    try:
        done = subprocess.run(
            list(command), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=variables, check=False
        )
    except OSError as error:
        return 1, [str(error)]
    return done.returncode, [line.strip() for line in done.stdout.splitlines() if line.strip()]


def _problem(lines: Sequence[str]) -> str:
    """Return the part of an installer's output that names the problem."""
    reason = next((i for i, line in enumerate(lines) if line.startswith(("╰─▶", "cause:"))), None)
    if reason is not None:
        # uv breaks its sentence into lines, and adds hints.
        text = " ".join(lines[reason:]).removeprefix("╰─▶").removeprefix("cause:").partition("hint:")[0]
        text = text.strip().rstrip(".")
        return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]} ..."
    errors = [line for line in lines if line.lower().startswith("error")]
    text = (errors or list(lines) or ["no message"])[0]
    return text.removeprefix("ERROR: ").removeprefix("error: ").strip().rstrip(".:")
