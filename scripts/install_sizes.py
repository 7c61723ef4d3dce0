"""Measure install time and size of the wheel and of each extra, in fresh environments; print the table of the docs.

Run ``python scripts/install_sizes.py``. Sizes are those of ``site-packages`` with compiled bytecode, as pip leaves it.
Packages come from uv's cache after the first installation, so the times contain no downloads.
"""

import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Installation:
    """A fresh environment with posefuse.

    Attributes:
        python: Its interpreter.
        size_mb: Size of its packages, in millions of bytes.
        time_s: Duration of the installation, without downloads.
    """

    python: Path
    size_mb: float
    time_s: float


def build_wheel(folder: Path) -> Path:
    """Build the wheel of this checkout."""
    _uv("build", "--wheel", "--out-dir", str(folder), str(ROOT))
    return next(folder.glob("*.whl"))


def install(wheel: Path, folder: Path, extras: tuple[str, ...] = ()) -> Installation:
    """Install a wheel with extras into a new environment."""
    _uv("venv", "--python", sys.executable, str(folder))
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    name = f"{wheel}[{','.join(extras)}]" if extras else str(wheel)
    start = time.perf_counter()
    # Copies, because hard links to uv's cache would hold the bytecode of other environments.
    _uv("pip", "install", "--python", str(python), "--link-mode", "copy", "--compile-bytecode", name)
    time_s = time.perf_counter() - start
    files = (file for file in folder.rglob("*") if file.is_file() and not file.is_symlink())
    return Installation(python, sum(file.stat().st_size for file in files) / 1e6, time_s)


def _uv(*arguments: str) -> None:
    uv = shutil.which("uv") or str(ROOT / ".venv" / "bin" / "uv")
    subprocess.run([uv, "--quiet", *arguments], check=True)


def main() -> None:
    """Print the table."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    names = tuple(project["optional-dependencies"])
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        wheel = build_wheel(folder / "wheel")
        print(f"Wheel: {wheel.stat().st_size / 1e6:.1f} MB.\n")
        print("| install | s | MB | more than the core, MB |\n|---|---|---|---|", flush=True)
        core_mb = 0.0
        for extras in [(), *((name,) for name in names), names]:
            environment = folder / "environment"
            install(wheel, environment, extras)  # fills uv's cache
            shutil.rmtree(environment)
            found = install(wheel, environment, extras)
            shutil.rmtree(environment)
            core_mb = core_mb or found.size_mb
            title = "all extras" if len(extras) > 1 else f"`posefuse[{extras[0]}]`" if extras else "`posefuse`"
            print(f"| {title} | {found.time_s:.0f} | {found.size_mb:.0f} | {found.size_mb - core_mb:.0f} |", flush=True)


if __name__ == "__main__":
    main()
