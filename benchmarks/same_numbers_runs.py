"""Run the cases of :mod:`benchmarks.same_numbers` with one tree or the other."""

import hashlib
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.same_numbers_steps import Case, Step

ROOT = Path(__file__).parent.parent
DATA = ROOT.parent / "shared" / "data"
LOG, ERRORS = "step_{}.log", "step_{}.err.log"
PRINTED = "step_{}.txt"


@dataclass(frozen=True)
class Tree:
    """A checkout.

    Attributes:
        root: folder of the checkout.
        kernels: folder of its compiled kernels.
        flags: current names of flags by their names in the base.
    """

    root: Path
    kernels: Path
    flags: Mapping[str, str] = field(default_factory=dict)

    def environment(self, kind: str) -> dict[str, str]:
        """Return the environment of a process: one thread, this tree's code, and kernels compiled from it only."""
        path = [self.root / "src"] + ([self.root] if kind == "inputs" else [])
        single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
        own = {
            "PYTHONPATH": os.pathsep.join(map(str, path)), "PYTHONHASHSEED": "0", "COLUMNS": "400", "NO_COLOR": "1",
            "NUMBA_CACHE_DIR": str(self.kernels / kernels_version(self.root)),
        }  # fmt: skip
        return os.environ | single | own


def kernels_version(root: Path) -> str:
    """Return a digest of all modules in folders with compiled functions; Numba checks only the file of a function."""
    modules = [path for path in sorted((root / "src").rglob("*.py"))]
    folders = {path.parent for path in modules if re.search(rb"\bnumba\b|\bjit\b", path.read_bytes())}
    digest = hashlib.sha256()
    for path in modules:
        if path.parent in folders:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def commit_of(root: Path, name: str) -> str:
    """Return the full hash of a commit."""
    return _git(root, "rev-parse", "--verify", f"{name}^{{commit}}").strip()


def is_clean(root: Path, commit: str) -> bool:
    """Return whether a checkout is at a commit without changes."""
    return commit_of(root, "HEAD") == commit and not _git(root, "status", "--porcelain").strip()


def _git(root: Path, *words: str) -> str:
    return subprocess.run(["git", "-C", str(root), *words], check=True, capture_output=True, text=True).stdout


@contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """Create a temporary checkout of a commit; its kernels are compiled on first use."""
    with tempfile.TemporaryDirectory(prefix="posefuse-base-") as room:
        folder = Path(room) / "tree"
        _git(ROOT, "worktree", "add", "--detach", str(folder), commit)
        try:
            yield folder
        finally:
            _git(ROOT, "worktree", "remove", "--force", str(folder))


def check_import(tree: Tree) -> None:
    """Exit unless the code of the tree is imported rather than that of an installation."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", "import posefuse; print(posefuse.__file__)"],
        env=tree.environment("command"), cwd=tempfile.gettempdir(), capture_output=True, text=True, check=True,
    )  # fmt: skip
    if not Path(done.stdout.strip()).is_relative_to(tree.root):
        sys.exit(f"The imported code is in {done.stdout.strip()}, not in {tree.root}.")


def translated(words: list[str], flags: Mapping[str, str]) -> list[str]:
    """Translate words to their names in the current tree: ``flag``, ``flag value`` and ``name=value``."""
    found: list[str] = []
    for before, word in zip(["", *words], words, strict=False):
        flag, equals, value = word.partition("=")
        if f"{before} {word}" in flags:
            found += flags[f"{before} {word}"].split()
        elif word in flags:
            found += flags[word].split()
        elif equals and flag in flags:
            found.append(f"{flags[flag]}={value}")
        else:
            found.append(word)
    return found


def _command(step: Step, tree: Tree, places: Mapping[str, str]) -> list[str]:
    words = translated(list(step.words), tree.flags)
    words = [_filled(word, places) for word in words]
    here = Path(__file__).parent
    if step.kind == "command":
        return [sys.executable, "-P", "-m", "posefuse", *words]
    return [sys.executable, "-P", str(here / f"same_numbers_{step.kind}.py"), *words]


def _filled(word: str, places: Mapping[str, str]) -> str:
    for name, place in places.items():
        word = word.replace(f"{{{name}}}", place)
    return word


def run_step(number: int, step: Step, tree: Tree, places: Mapping[str, str], logs: Path, timeout_s: float) -> dict:
    """Run one process, and store its output with its files."""
    folder = Path(places["out"])
    target = folder / step.writes if step.writes else logs / LOG.format(number)
    began, spent = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    source = (folder / step.reads).open("rb") if step.reads else None
    with target.open("wb") as printed, (logs / ERRORS.format(number)).open("wb") as errors:
        try:
            code: int | str = subprocess.run(
                _command(step, tree, places), env=tree.environment(step.kind), cwd=logs, timeout=timeout_s,
                stdin=source or subprocess.DEVNULL, stdout=printed, stderr=errors,
            ).returncode  # fmt: skip
        except subprocess.TimeoutExpired:
            code = f"stopped after {timeout_s:g} s"
    if source:
        source.close()
    if step.printed:
        text = target.read_text("utf-8", errors="replace")
        for name, place in sorted(places.items(), key=lambda each: -len(each[1])):
            text = text.replace(place, f"{{{name}}}")
        (folder / PRINTED.format(number)).write_text(text, "utf-8")
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = now.ru_utime + now.ru_stime - spent.ru_utime - spent.ru_stime
    return {"exit": code, "wall_s": round(time.monotonic() - began, 1), "cpu_s": round(cpu, 1)}


def run_case(case: Case, tree: Tree, inputs: Path, folder: Path) -> dict:
    """Run all steps of a case in a new folder, and return their outcome.

    Args:
        case: the case.
        tree: the checkout to run.
        inputs: folder of the inputs from the base.
        folder: folder for the outputs; ``folder.json`` stores the outcome, ``folder.logs`` the printed texts.
    """
    record, logs = folder.with_name(f"{folder.name}.json"), folder.with_name(f"{folder.name}.logs")
    record.unlink(missing_ok=True)
    for each in (folder, logs):
        shutil.rmtree(each, ignore_errors=True)
        each.mkdir(parents=True)
    places = {"data": str(DATA), "inputs": str(inputs), "out": str(folder)}
    if case.steps[0].kind == "inputs" or folder.parent == inputs:
        folder.rmdir()
    outcomes = [run_step(number, step, tree, places, logs, case.timeout_s) for number, step in enumerate(case.steps)]
    record.write_text(json.dumps({"case": repr(case.steps), "steps": outcomes}, indent=1))
    return {"case": repr(case.steps), "steps": outcomes}


def last_words(folder: Path, number: int) -> str:
    """Return the last line of a step's error output."""
    errors = folder.with_name(f"{folder.name}.logs") / ERRORS.format(number)
    lines = errors.read_text("utf-8", errors="replace").splitlines()
    return next((line.strip("│ ") for line in reversed(lines) if any(map(str.isalpha, line))), "no error output")


def kept(case: Case, folder: Path) -> dict | None:
    """Return the stored outcome of a case if its steps are unchanged."""
    record = folder.with_name(f"{folder.name}.json")
    if not record.exists():
        return None
    outcome = json.loads(record.read_text())
    return outcome if outcome["case"] == repr(case.steps) else None
