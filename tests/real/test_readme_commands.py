"""Every command of the README runs on every folder of real recordings, or answers in one sentence."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, SHARED_DATA

pytestmark = pytest.mark.long

FOLDERS = sorted(
    path.relative_to(SHARED_DATA).as_posix()
    for pattern in ("*", "pose2sim/*")
    for path in SHARED_DATA.glob(pattern)
    if path.is_dir()
)

SECONDS = 600


def commands() -> list[str]:
    """Return the command lines of the README's first block of usage, without comments."""
    usage = (ROOT / "README.md").read_text().split("## Usage")[1].split("```")[1]
    return [line.split("#")[0].strip() for line in usage.splitlines() if line.startswith("posefuse ")]


def filled_in(command: str, recording: Path) -> list[str]:
    """Return the arguments of a command with its placeholders replaced."""
    truth = next(iter(sorted(recording.rglob("*.trc"))), None)
    calibration = next(iter(sorted(recording.rglob("*.toml"))), recording)
    replacements = {
        "RECORDINGS/*": str(recording),
        "RECORDING": str(recording),
        "VIDEOS": str(recording),
        "FILE": str(calibration),
        "truth.trc": str(truth or recording),
        "tcp://:5570": "-",
        "IN": "OUT/reconstruction.nc",
    }
    name = command.split()[1]
    words = [replacements.get(word, word) for word in shlex.split(command)[1:]]
    words = [f"FOLDER_{name}" if word == "FOLDER" else word for word in words]
    if name == "convert":
        words[-1] = "converted.trc"
    if name == "view":
        words += ["--save", "view.rrd"]
    return words


def test_the_list_is_that_of_the_readme() -> None:
    assert len(commands()) >= 16


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_command_of_the_readme(folder: str, tmp_path: Path) -> None:
    (tmp_path / "edits.toml").write_text('[[drop]]\nperson = "person_9"\n')
    failed = []
    for command in commands():
        words = filled_in(command, SHARED_DATA / folder)
        code, output, error = run(words, tmp_path)
        for _ in range(2):
            choices = suggested(error) if code else []
            if not choices or choices[0] in words:
                break
            words = [*words, *choices]
            code, output, error = run(words, tmp_path)
        if re.search(r"Traceback|Warning:", output + error) or (code and not answers(output + error)):
            failed.append((shlex.join(words), code, (output + error)[-1500:]))
    assert failed == []


def run(words: list[str], folder: Path) -> tuple[int, str, str]:
    """Run a command in a folder and return its exit code, output and errors."""
    done = subprocess.run(
        [sys.executable, "-m", "posefuse", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "COLUMNS": "1000"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def suggested(error: str) -> list[str]:
    """Return the first choice of each option that a message lists, and a frame rate if it asks for one."""
    found: dict[str, str] = {}
    for option, value in re.findall(r"(?m)^\s+(--[a-z-]+) (\S+)", error):
        found.setdefault(option, value)
    if "Add --rate-hz" in error:
        found["--rate-hz"] = "30"
    return [word for pair in found.items() for word in pair]


def answers(text: str) -> bool:
    """Return whether the output ends as a sentence or as a list of choices."""
    lines = [line for line in text.splitlines() if line.strip()]
    return bool(lines) and (bool(re.search(r"[.?!)\]'\"`]$", lines[-1].strip())) or lines[-1].startswith("  "))
