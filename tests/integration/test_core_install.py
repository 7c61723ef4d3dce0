"""An installation without extras: modules import, commands work, and those that need an extra name it.

The optional packages are hidden from the tests' own environment. ``test_wheel`` installs the core alone.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate

OPTIONAL = (
    *("PIL", "av", "cv2", "dask", "distributed", "fsspec", "gcsfs", "matplotlib", "nats", "ndx_pose", "opensim"),
    *("pyarrow", "pynwb", "rerun", "s3fs", "sleap_io", "zmq"),
)
FIGURES = ("posefuse.report.angle_agreement", "posefuse.report.comparison", "posefuse.report.percentile_filter")
NEED_OPTIONAL_PACKAGES = (*FIGURES, "posefuse.report.plots.", "posefuse.report.rendering", "posefuse.io.opensim.worker")
"""Modules that are imported only after a check that the package is there."""

ENVIRONMENTS_OF_DETECTORS = "posefuse.detection.workers."
"""Modules that run in another environment, that of a detector."""

IMPORT_ALL = """
import importlib, pkgutil, posefuse
for module in pkgutil.walk_packages(posefuse.__path__, "posefuse."):
    if module.name.endswith("__main__"):
        continue
    try:
        importlib.import_module(module.name)
    except ImportError:
        print(module.name)
"""


@pytest.fixture(scope="module")
def core(tmp_path_factory) -> dict[str, str]:
    """The variables of an environment without the optional packages."""
    folder = tmp_path_factory.mktemp("hidden")
    (folder / "sitecustomize.py").write_text(f"import sys\nsys.modules.update(dict.fromkeys({OPTIONAL}))\n", "utf-8")
    paths = [str(folder), *(path for path in sys.path if path)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "200"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, core) -> Path:
    """A folder with the folder ``recording``, and ``result``, its result."""
    folder = tmp_path_factory.mktemp("core")
    scene = simulate(SceneOptions(duration_s=1, cameras=4, detector=CLEAN))
    (folder / "recording").mkdir()
    anipose.write(scene.rig, folder / "recording" / "calibration.toml")
    native.write(scene.detections, folder / "recording" / "keypoints.nc")
    call(core, folder, "reconstruct", "recording", "--output", "result")
    return folder


def call(environment: dict[str, str], folder: Path, *arguments: str, code: int = 0) -> str:
    """Run a command and return what it printed."""
    command = [sys.executable, "-m", "posefuse", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == code, done.stdout + done.stderr
    return " ".join((done.stdout + done.stderr).split())


def test_modules_without_figures_import(core, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL], cwd=tmp_path, env=core, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    failed = done.stdout.split()
    assert "posefuse.report.rendering" in failed, "matplotlib is not hidden"
    unexpected = [name for name in failed if not name.startswith((*NEED_OPTIONAL_PACKAGES, ENVIRONMENTS_OF_DETECTORS))]
    assert unexpected == []


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "recording", "--output", "run"),
        ("batch", "recording", "-o", "batch"),
        ("report", "result", "--overwrite"),
        ("compare", "recording", "-o", "compared", "--methods", "simple,consensus"),
        ("explain", "result", "--frame", "3"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_commands_need_no_extra(core, folder, arguments):
    call(core, folder, *arguments)


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("people", "result"), "video"),
        (("overlay", "result", "--output", "overlay"), "video"),
        (("plot", "result", "--output", "figures"), "plot"),
        (("batch", "recording", "-o", "other", "--scheduler", "local"), "cluster"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else value,
)
def test_a_missing_extra_is_named(core, folder, arguments, extra):
    assert f"pip install 'posefuse[{extra}]'" in call(core, folder, *arguments, code=1)
