"""Build a wheel that contains compiled kernels, for Linux on x86-64 and the version of Python that runs this.

``python scripts/build_wheel.py [--out-dir FOLDER]``, in an environment with posefuse and uv, takes about three minutes.
Other systems install the wheel without kernels (``uv build``) and compile when they first run.
"""

import argparse
import importlib
import os
import pkgutil
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
# The machine code refers to no version of glibc; the oldest that Numba supports is that of manylinux2014.
PLATFORM = "manylinux2014_x86_64"


def is_supported() -> bool:
    """Return whether this machine can compile kernels for a wheel."""
    return (sys.platform, platform.machine()) == ("linux", "x86_64")


def kernels() -> Iterator[Any]:
    """Yield all kernels of the package."""
    import posefuse.kernels
    from posefuse.kernels.loading import KernelCache

    for module in pkgutil.walk_packages(posefuse.kernels.__path__, "posefuse.kernels."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(getattr(value, "_cache", None), KernelCache) and value.py_func.__module__ == module.name:
                yield value


def compile_kernels(folder: Path) -> None:
    """Compile all kernels that ``posefuse warm-up`` needs into a folder."""
    from posefuse.kernels.prebuilt import export
    from posefuse.pipeline.warm_up import warm_up

    folder.mkdir(parents=True, exist_ok=True)
    warm_up(jobs=1)  # Several processes would store one of several equivalent codes.
    print(f"Compiled {export(kernels(), folder)} kernels.")


def build(out_dir: Path) -> None:
    """Compile the kernels and build the wheel."""
    import posefuse.kernels
    from posefuse.kernels.compiled_sources import digest

    source = ROOT / "src" / "posefuse" / "kernels"
    uv = shutil.which("uv") or str(ROOT / ".venv" / "bin" / "uv")
    if not is_supported():
        sys.exit(f"Kernels are compiled for Linux on x86-64 only; this is {sys.platform} on {platform.machine()}.")
    if Path(posefuse.kernels.__path__[0]).resolve() != source:
        sys.exit(f"Expected the package in {source}, got {posefuse.kernels.__path__[0]}.")
    if not Path(uv).exists():
        sys.exit("uv is not installed.")
    before = digest(source)
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary, "kernels")
        command = [sys.executable, __file__, "--kernels", folder]
        subprocess.run(command, check=True, env=_compiler_environment(temporary), cwd=temporary)
        digest.cache_clear()
        if digest(source) != before:
            sys.exit("The sources of kernels changed while they were compiled.")
        tagged = {"POSEFUSE_KERNELS": str(folder), "POSEFUSE_WHEEL_TAG": f"{python}-{python}-{PLATFORM}"}
        subprocess.run([uv, "build", "--wheel", "--out-dir", out_dir, ROOT], check=True, env={**os.environ, **tagged})


def _compiler_environment(folder: str) -> dict[str, str]:
    """Return the environment of the compiler, without the options of the user, for reproducible code."""
    from posefuse.kernels.prebuilt import COMPILER_VARIABLES

    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "PYTHON"))}
    return {**kept, **COMPILER_VARIABLES, "NUMBA_CACHE_DIR": str(Path(folder, "cache")), "PYTHONHASHSEED": "0"}


def main() -> None:
    """Read the arguments and build."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out-dir", type=Path, default=ROOT / "dist", help="folder of the wheel")
    parser.add_argument("--kernels", type=Path, help="only compile, into this folder, with Numba as it is configured")
    asked = parser.parse_args()
    if asked.kernels is None:
        build(asked.out_dir)
    else:
        compile_kernels(asked.kernels)


if __name__ == "__main__":
    main()
