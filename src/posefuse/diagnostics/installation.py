"""What is installed: versions, extras, machine, compiled kernels and detectors."""

import importlib.metadata
import os
import platform
import re
import shutil
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from posefuse.detection.environments import environment_of
from posefuse.detection.registry import detectors
from posefuse.parallel import logical_cores

_CORE = ("numpy", "scipy", "numba", "llvmlite", "h5py")
_REQUIREMENT = re.compile(r"""^([A-Za-z0-9._-]+).*;.*extra == ['"]([a-z]+)['"]""")


@dataclass(frozen=True)
class Extra:
    """An optional set of packages.

    Attributes:
        name: name in ``pip install 'posefuse[name]'``.
        missing: packages that are not installed.
    """

    name: str
    missing: tuple[str, ...]

    @property
    def command(self) -> str:
        """The command that installs it."""
        return f"pip install 'posefuse[{self.name}]'"


@dataclass(frozen=True)
class DetectorState:
    """A detector.

    Attributes:
        name: name of the detector.
        state: installed, incomplete, outdated or not installed.
        command: the command that installs it; empty if it is installed.
    """

    name: str
    state: str
    command: str


@dataclass(frozen=True)
class Installation:
    """The installation of posefuse and its machine.

    Attributes:
        versions: version by package; those of posefuse and Python come first.
        system: operating system and processor.
        cores: number of logical cores that this process may use.
        memory_gb: memory of the machine, or None where the system does not state it.
        gpu: name of the program that shows an NVIDIA GPU, or empty. posefuse needs none; detectors use one.
        prebuilt_mb: size of the compiled kernels that the package contains, used or not.
        prebuilt_unused: why they are not used; empty if they are.
        cache: folder of the kernels that are compiled on this machine; empty where they cannot be stored.
        cache_mb: size of these kernels; 0 before the first run.
        is_cache_writable: whether kernels can be stored there. Otherwise each process compiles those that are not.
        extras: optional packages.
        detectors: detectors of keypoints in videos.
    """

    versions: Mapping[str, str]
    system: str
    cores: int
    memory_gb: float | None
    gpu: str
    prebuilt_mb: float
    prebuilt_unused: str
    cache: str
    cache_mb: float
    is_cache_writable: bool
    extras: tuple[Extra, ...]
    detectors: tuple[DetectorState, ...]


def examine_installation() -> Installation:
    """Return what is installed; of all packages, only the compiler is loaded, which knows the folder of kernels."""
    versions = {"posefuse": importlib.metadata.version("posefuse"), "python": platform.python_version()}
    versions |= {name: importlib.metadata.version(name) for name in _CORE}
    cache, is_writable = kernel_cache()
    prebuilt, why_unused = prebuilt_kernels()
    return Installation(
        versions,
        f"{platform.platform()}, {platform.machine()}",
        logical_cores(),
        _memory_gb(),
        "nvidia-smi" if shutil.which("nvidia-smi") else "",
        _size_mb(prebuilt),
        why_unused,
        str(cache or ""),
        _size_mb(_kernel_files(cache) - prebuilt) if cache else 0.0,
        is_writable,
        _extras(),
        tuple(_detector_states()),
    )


def kernel_cache() -> tuple[Path | None, bool]:
    """Return the folder of compiled kernels, None where they cannot be stored, and whether it can be written to."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # The result states the same.
        try:
            from posefuse.kernels.diagnostics.epipolar import sampson
            from posefuse.kernels.stores import store_of
        except (ImportError, OSError):  # The compiler is broken, which the caller examines.
            return None, False
        return store_of(sampson)


def prebuilt_kernels() -> tuple[set[Path], str]:
    """Return the files of compiled kernels that the package contains, and why they are not used; empty if they are."""
    try:
        from posefuse.kernels import prebuilt
    except (ImportError, OSError) as error:  # As in kernel_cache.
        return set(), str(error)
    return _kernel_files(prebuilt.FOLDER), prebuilt.why_unused()


def _kernel_files(folder: Path) -> set[Path]:
    return {path for ending in ("nbc", "nbi") for path in folder.rglob(f"*.{ending}")}


def _size_mb(files: set[Path]) -> float:
    return sum(path.stat().st_size for path in files) / 1e6


def _memory_gb() -> float | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    except (AttributeError, ValueError, OSError):
        return None


def _extras() -> tuple[Extra, ...]:
    """Return the extras that the package declares."""
    packages: dict[str, list[str]] = {}
    for line in importlib.metadata.requires("posefuse") or ():
        if match := _REQUIREMENT.match(line):
            packages.setdefault(match[2], []).append(match[1])
    return tuple(
        Extra(name, tuple(package for package in sorted(packages[name]) if not _is_installed(package)))
        for name in sorted(packages)
    )


def _is_installed(package: str) -> bool:
    try:
        importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _detector_states() -> list[DetectorState]:
    states = [(record.name, environment_of(record).state) for record in detectors()]
    return [
        DetectorState(name, state, "" if state == "installed" else f"posefuse detector install {name}")
        for name, state in states
    ]
