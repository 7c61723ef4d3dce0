"""The documentation is correct: examples run, and listed names exist."""

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.io.calibration import anipose
from posefuse.io.calibration.registry import CALIBRATIONS
from posefuse.io.keypoints import native, openpose
from posefuse.io.keypoints.registry import KEYPOINTS
from posefuse.io.results.registry import RESULTS
from posefuse.model.options.aliases import RENAMED
from posefuse.model.options.catalog import options_by_name
from posefuse.model.options.options import Options
from posefuse.model.options.specification import SpecificationOptions
from posefuse.model.options.triangulation import METHODS
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.report.plots.registry import PLOT_NAMES
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples" / "gallery").rglob("*.py"))
QUICK = ("plot_1_reconstruct", "plot_3_missing_points", "plot_1_arrays", "plot_4_live")
"""Examples that make test runs; make test-long and the site run all."""
EXAMPLE_RUNS = [
    pytest.param(path, id=f"{path.parent.name}_{path.stem}", marks=() if path.stem in QUICK else pytest.mark.long)
    for path in EXAMPLES
]
GENERATED = ("_build", "generated", "gallery")
"""Folders of docs that are not in the repository."""
PAGES = sorted(
    [
        *(path for path in (ROOT / "docs").rglob("*.md") if not set(path.relative_to(ROOT).parts) & set(GENERATED)),
        *ROOT.glob("*.md"),
    ]
)


@pytest.mark.parametrize("example", EXAMPLE_RUNS)
def test_example_runs(example: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-W", "ignore:.*non-interactive.*:UserWarning", str(example)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "MPLBACKEND": "agg"},
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d", done.stdout)
    assert not re.search(r"(?<![\w])(nan|inf)(?!\w)", done.stdout), done.stdout


def test_gallery_examples_have_titles_and_figures() -> None:
    assert 20 <= len(EXAMPLES) <= 30
    for example in EXAMPLES:
        text = example.read_text("utf-8")
        title, line = text.split("\n")[:2]
        assert title.startswith('"""')
        assert set(line) == {"="}, example
        assert text.rstrip().endswith("plt.show()"), example


def python_blocks(page: Path) -> list[str]:
    return re.findall(r"(?ms)^```python\n(.*?)^```", page.read_text("utf-8"))


OTHER_PACKAGES = ("rtmlib",)
"""Packages of other projects that a block may import; such a block is only compiled."""


@pytest.fixture(scope="module", params=[1.0, 11.0], ids=["one_second", "eleven_seconds"])
def workplace(request, tmp_path_factory) -> tuple[Path, dict[str, object]]:
    """Return a folder with the files that the documents name, and the arrays of one frame."""
    folder = tmp_path_factory.mktemp("documents")
    scene = simulate(SceneOptions(duration_s=request.param, cameras=3, rate_hz=20.0, skeleton="halpe_26", seed=1))
    (folder / "RECORDING").mkdir()
    for place in (folder, folder / "RECORDING"):
        anipose.write(scene.rig, place / "calibration.toml")
    native.write(scene.detections, folder / "RECORDING" / "keypoints.nc")
    openpose.write(scene.detections, folder / "pose")
    posefuse.reconstruct_recording(folder / "RECORDING", folder / "out", posefuse.Options(health="off"))
    people = [scene.detections.dense()[0][:1, v] for v in range(3)]
    return folder, {"keypoints_px": people, "confidence": [np.ones(each.shape[:2]) for each in people]}


OWN_TEST = ("freemocap", "engineer", "animal-lab")
"""Pages whose blocks run on a recording of another program, in a test of their own."""
CODE_PAGES = [page for page in PAGES if python_blocks(page) and page.stem not in OWN_TEST]


@pytest.mark.parametrize("page", CODE_PAGES, ids=lambda path: path.stem)
def test_python_in_documents_runs(page: Path, workplace, monkeypatch, tmp_path) -> None:
    # Pages write files of the same names, and do not depend on the variables of other pages.
    shared, names = workplace[0], dict(workplace[1])
    folder = shutil.copytree(shared, tmp_path / "documents")
    monkeypatch.chdir(folder)
    for block in python_blocks(page):
        code = compile(block, str(page), "exec")
        if any(f"from {package}" in block for package in OTHER_PACKAGES):
            continue
        exec(code, names)
    results = [value for value in names.values() if isinstance(value, posefuse.Reconstruction)]
    assert all(np.isfinite(result.best_layer()[1].points_m).any() for result in results)
    points = names.get("points", names.get("good"))
    # With three cameras, a third of the points of a wrist have an error below 10 px.
    assert points is None or np.isfinite(np.asarray(points)).mean() > 0.3


def test_files_of_a_result_are_those_of_the_readme(workplace) -> None:
    folder, _ = workplace
    text = (ROOT / "README.md").read_text("utf-8").split("`OUT` always holds")[1]
    written = {re.sub(r"^person_1", "", path.name) for path in (folder / "out").iterdir() if path.is_file()}
    is_long = "solved.csv" in written
    expected = {name for name in re.findall(r"`([\w.]+)`", text.split("\n\n")[0]) if "." in name}
    # The simulated person of the longer recording walks; a second is too short for a bout.
    of_walks = {"events.csv", "gait.csv", "cycles.csv"} if "gait.csv" in written else set()
    assert written == expected | of_walks | ({"solved.csv"} if is_long else set())


def test_options_page_is_generated_from_the_records() -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "options_page.py"))
    page = (ROOT / "docs" / "options.md").read_text()
    assert page == script["render"](), "run python scripts/options_page.py"
    listed = re.findall(r"(?m)^\| `([a-z0-9_.]+)`", page)
    assert sorted(listed) == sorted(option_names(Options(), ""))


def test_options_of_the_specification_are_listed_with_their_symbols() -> None:
    page = (ROOT / "docs" / "methods" / "specification.md").read_text()
    table = page.split("| symbol or term |")[1].split("\n\n")[0]
    listed = re.findall(r"`([a-z0-9_]+)`", " ".join(row.split(" | ")[1] for row in table.splitlines()[2:]))
    assert sorted(listed) == sorted(option_names(SpecificationOptions(), ""))


def option_names(record: object, prefix: str) -> Iterator[str]:
    for field in fields(record):  # type: ignore[arg-type]
        value = getattr(record, field.name)
        if is_dataclass(value):
            yield from option_names(value, f"{prefix}{field.name}.")
        else:
            yield f"{prefix}{field.name}"


def test_every_status_method_and_format_is_documented() -> None:
    conventions = (ROOT / "docs" / "conventions.md").read_text()
    assert [code.label for code in (*PointStatus, *ViewStatus) if f"| `{code.label}` |" not in conventions] == []
    methods = (ROOT / "docs" / "methods" / "triangulation.md").read_text()
    headings = "".join(re.findall(r"(?m)^## .*$", methods))
    assert [name for name in METHODS if f"`{name}`" not in headings] == []
    formats = (ROOT / "docs" / "formats.md").read_text().lower()
    named = {form.name for form in (*CALIBRATIONS, *KEYPOINTS, *RESULTS)} - {"netcdf"}
    assert {name for name in named if name not in formats} == set()
    report = (ROOT / "docs" / "report.md").read_text()
    assert [name for name in PLOT_NAMES if f"| `{name}` |" not in report] == []


def test_contributing_names_existing_files() -> None:
    quoted = re.findall(r"`([\w/.]+\.(?:py|md|toml|json|html|js)|[\w/.]+/)`", (ROOT / "CONTRIBUTING.md").read_text())
    roots = (ROOT, ROOT / "src" / "posefuse")
    assert len(quoted) > 30
    assert [path for path in quoted if not any((root / path).exists() for root in roots)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_have_targets(page: Path) -> None:
    text = page.read_text()
    for target in re.findall(r"\]\(([^)#]+)(?:#[a-z0-9-]+)?\)", text):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=lambda page: page.name)
def test_pages_do_not_use_former_names_of_options(page: Path) -> None:
    current = {key for name in options_by_name() for key in (name, name.rpartition(".")[2])}
    former = {key for name in RENAMED for key in (name, name.rpartition(".")[2])} - current
    quoted = set(re.findall(r"`(?:--)?([a-z][a-z0-9_.-]*)`", page.read_text("utf-8")))
    assert not {name for name in quoted if name.replace("-", "_") in former}


MIGRATION = sorted((ROOT / "docs" / "migrate").glob("*.md"))


def commands_in(page: Path) -> list[list[str]]:
    """Return the words of the commands in the shell blocks of a page."""
    blocks = "".join(re.findall(r"(?ms)^```sh\n(.*?)^```", page.read_text("utf-8")))
    return [shlex.split(line, comments=True)[1:] for line in blocks.splitlines() if line.startswith("posefuse ")]


@pytest.mark.parametrize("page", MIGRATION, ids=lambda page: page.stem)
def test_options_in_migration_pages_exist(page: Path) -> None:
    dotted = set(re.findall(r"`(?:--)?([a-z_-]+(?:\.[a-z_-]+)+)`", " ".join(right_columns(page))))
    unknown = {name for name in dotted if name.replace("-", "_") not in options_by_name()}
    assert unknown == set()
    for command in commands_in(page):
        flags = {word.split("=")[0] for word in command if word.startswith("--")}
        assert flags - flags_of(command[0]) == set()


@cache
def flags_of(command: str) -> set[str]:
    """Return the flags that the help of a command lists."""
    done = subprocess.run(
        [sys.executable, "-m", "posefuse", command, "--help-all"],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    return set(re.findall(r"--[a-z0-9_.-]+", done.stdout))


def right_columns(page: Path) -> Iterator[str]:
    """Yield the second column of the tables whose second column has the title "option"."""
    inside = False
    for line in page.read_text("utf-8").splitlines():
        cells = [cell.strip() for cell in line.split(" | ")]
        inside = line.startswith("|") and (inside or (len(cells) > 1 and cells[1].strip(" |") == "option"))
        if inside and len(cells) > 1:
            yield cells[1]
