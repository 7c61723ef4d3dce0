"""The built wheel in fresh environments, without and with extras: size, and the commands of the README."""

import subprocess
from pathlib import Path

import pytest
from scripts import build_wheel as with_kernels
from scripts.install_sizes import Installation, build_wheel, install

pytestmark = pytest.mark.long

LARGEST_CORE_MB = 560


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    return build_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def core(wheel, tmp_path_factory) -> Installation:
    return install(wheel, tmp_path_factory.mktemp("core") / "venv")


@pytest.fixture(scope="module")
def with_extras(wheel, tmp_path_factory) -> Installation:
    return install(wheel, tmp_path_factory.mktemp("extras") / "venv", ("plot", "parquet", "calibrate", "video"))


@pytest.fixture(scope="module")
def with_machine_code(tmp_path_factory) -> Installation:
    if not with_kernels.is_supported():
        pytest.skip("Kernels are compiled for wheels on Linux and x86-64 only.")
    folder = tmp_path_factory.mktemp("kernels")
    with_kernels.build(folder)
    return install(next(folder.glob("*.whl")), folder / "venv")


@pytest.fixture(scope="module")
def result(core, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("result")
    run(core, folder, "simulate", "sim", "--duration-s", "1")
    run(core, folder, "reconstruct", "sim", "--output", "OUT")
    return folder


def run(at: Installation, folder: Path, *arguments: str, code: int = 0) -> str:
    """Run a command outside the checkout and return what it printed."""
    command = [at.python.parent / "posefuse", *arguments]
    environment = {"PATH": str(at.python.parent), "HOME": str(folder), "COLUMNS": "200"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == code, done.stdout + done.stderr
    return " ".join((done.stdout + done.stderr).split())


def test_core_is_small(core):
    assert core.size_mb < LARGEST_CORE_MB


def test_help_and_demo(core, tmp_path):
    assert "reconstruct" in run(core, tmp_path, "--help")
    assert "report.html" in run(core, tmp_path, "demo")


def test_default_outputs_need_no_extra(result):
    names = {file.name for file in (result / "OUT").iterdir()}
    assert {"reconstruction.nc", "keypoints.csv", "person_1.trc", "person_1.c3d", "report.html"} <= names


def test_a_wheel_with_machine_code_compiles_nothing(with_machine_code, tmp_path):
    def run_here(*arguments: str) -> str:
        return run(with_machine_code, tmp_path, *arguments)

    run_here("simulate-people", "people", "--people", "2", "--skeleton", "coco_wholebody_133", "--duration-s", "2.5")
    installed = with_machine_code.python.parent.parent
    compiled = set(installed.rglob("*.nbc")) | set(tmp_path.rglob("*.nbc"))
    run_here("demo")
    run_here("reconstruct", "people", "--output", "OUT", "--accept-findings")
    assert set(installed.rglob("*.nbc")) | set(tmp_path.rglob("*.nbc")) == compiled
    assert "MB in the package" in run_here("doctor")


@pytest.mark.parametrize(
    "arguments",
    [
        ("inspect", "sim", "--deep"),
        ("evaluate", "OUT", "sim/truth.nc"),
        ("evaluate", "OUT", "OUT/person_1.mot", "--overwrite"),
        ("compare", "sim", "--output", "compared", "--methods", "simple,consensus", "--overwrite"),
        ("report", "OUT", "--overwrite"),
        ("convert", "OUT", "angles_wide.csv", "--overwrite"),
        ("convert", "OUT", "OUT.nc", "--overwrite"),
        ("init", "--overwrite"),
        ("formats",),
        ("methods",),
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_commands_of_the_core(core, result, arguments):
    run(core, result, *arguments)


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("plot", "OUT", "--output", "figures"), "plot"),
        (("convert", "OUT", "points.parquet"), "parquet"),
        (("convert", "sim", "keypoints.parquet"), "parquet"),
        (("reconstruct", "sim", "--output", "other", "--also", "parquet"), "parquet"),
        (("board", "charuco:7x5,square=30mm", "--output", "board.pdf"), "calibrate"),
        (("view", "OUT"), "view"),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, tuple) else value,
)
def test_a_missing_extra_is_named(core, result, arguments, extra):
    assert f"pip install 'posefuse[{extra}]'" in run(core, result, *arguments, code=1)


@pytest.mark.parametrize(
    "arguments",
    [
        ("plot", "OUT", "--output", "figures"),
        ("convert", "OUT", "points.parquet"),
        ("convert", "sim", "keypoints.parquet"),
        ("board", "charuco:7x5,square=30mm", "--output", "board.pdf"),
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_commands_with_extras(with_extras, result, arguments):
    run(with_extras, result, *arguments)
