"""Environments of detectors: complete, interrupted, outdated, and what is said if they cannot be made."""

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from posefuse.detection import environments, interpreters
from posefuse.detection.environments import environment_of, install, installed_python, remove
from posefuse.detection.registry import detectors, find_detector
from posefuse.errors import DetectorError

RECORD = find_detector("mediapipe")[0]


class Notes:
    """Receives remarks."""

    def __init__(self):
        self.texts = []

    def note(self, text):
        self.texts.append(text)

    def start(self, what, total): ...
    def advance(self, done): ...
    def finish(self): ...


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(tmp_path))
    monkeypatch.setattr(environments, "find_uv", lambda: None)
    monkeypatch.setattr(interpreters, "find_uv", lambda: None)
    return tmp_path


@pytest.fixture
def commands(monkeypatch):
    """Record the commands of an installation instead of running them; a venv becomes a link to this Python."""
    found = []

    def run(command):
        found.append(list(command))
        if "venv" in command:
            python = Path(command[-1]) / "bin" / "python"
            python.parent.mkdir(parents=True)
            python.symlink_to(sys.executable)
        return 0, ["3.11.7"]

    monkeypatch.setattr(environments, "_run", run)
    monkeypatch.setattr(environments, "_check", lambda record, python: None)
    monkeypatch.setattr(environments, "find_python", lambda supported, given, name: given or Path(sys.executable))
    return found


def test_an_environment_is_installed_once_and_removed(home, commands):
    assert environment_of(RECORD).state == "not installed"
    notes = Notes()
    found = install(RECORD, progress=notes)
    assert (found.state, found.version) == ("installed", "3.11.7")
    assert found.folder == home / "detectors" / "mediapipe"
    assert installed_python(RECORD) == found.python
    assert any("110 MB" in text for text in notes.texts)
    packages = next(each for each in commands if "install" in each)
    assert {"--no-deps", "--require-hashes"} <= set(packages)
    count = len(commands)
    assert install(RECORD) == found
    assert len(commands) == count
    assert remove(RECORD)
    assert not found.folder.exists()
    assert not remove(RECORD)


def test_an_interrupted_installation_is_named_and_completed(home, commands, monkeypatch):
    monkeypatch.setattr(environments, "_install_packages", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        install(RECORD)
    assert environment_of(RECORD).state == "incomplete"
    with pytest.raises(DetectorError, match=r"is installed incompletely\. Run: posefuse detector install mediapipe"):
        installed_python(RECORD)
    monkeypatch.undo()
    monkeypatch.setenv("POSEFUSE_HOME", str(home))
    monkeypatch.setattr(environments, "_check", lambda record, python: None)
    monkeypatch.setattr(environments, "_install_packages", lambda *_: None)
    kept = environment_of(RECORD).folder / "kept"
    kept.write_text("what was downloaded")
    assert install(RECORD).state == "installed"
    assert kept.exists()


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"python": "3.11", "size_mb": "large", "cuda": false}'])
def test_a_damaged_marker_is_an_incomplete_environment(home, text):
    folder = environment_of(RECORD).folder
    folder.mkdir(parents=True)
    (folder / "posefuse.json").write_text(text)
    assert environment_of(RECORD).state == "incomplete"


def test_an_environment_with_other_packages_is_outdated_and_replaced(home, commands):
    found = install(RECORD)
    marker = found.folder / "posefuse.json"
    marker.write_text(json.dumps({**json.loads(marker.read_text()), "requirements": "other"}))
    assert environment_of(RECORD).state == "outdated"
    with pytest.raises(DetectorError, match=r"installed by another version of posefuse"):
        installed_python(RECORD)
    (found.folder / "old").write_text("")
    assert install(RECORD).state == "installed"
    assert not (found.folder / "old").exists()


def test_a_failed_download_is_one_sentence(home, commands, monkeypatch):
    lines = ["Collecting mediapipe", "ERROR: Could not find a version that satisfies the requirement x"]
    run = environments._run

    def fails(command):
        return (1, lines) if "install" in command else run(command)

    monkeypatch.setattr(environments, "_run", fails)
    with pytest.raises(
        DetectorError, match=r"were not installed: Could not find a version .* Check the network"
    ) as raised:
        install(RECORD)
    assert "\n" not in str(raised.value)
    assert environment_of(RECORD).state == "incomplete"


def test_the_problem_of_an_installer_is_its_reason():
    lines = [
        "× No solution found:",
        "╰─▶ Because mediapipe was not found",
        "in the cache, it fails.",
        "hint: pass a flag",
    ]
    assert environments._problem(lines) == "Because mediapipe was not found in the cache, it fails"
    lines = ["error: No solution found", "cause: Because absl-py was not found.", "hint: No network."]
    assert environments._problem(lines) == "Because absl-py was not found"
    assert environments._problem(["Looking in links", "ERROR: No matching distribution found."]) == (
        "No matching distribution found"
    )
    assert environments._problem([]) == "no message"


def test_a_python_without_venv_is_named(home, monkeypatch):
    lines = ["The virtual environment was not created successfully because ensurepip is not available."]
    monkeypatch.setattr(environments, "_run", lambda command: (1, lines))
    monkeypatch.setattr(environments, "find_python", lambda *_: Path("/usr/bin/python3"))
    with pytest.raises(DetectorError, match=r"cannot create the environment .* apt install python3-venv"):
        install(RECORD)
    assert environment_of(RECORD).state == "not installed"


@pytest.mark.long
def test_an_environment_is_really_made_without_uv(home, monkeypatch):
    """With venv and no packages: the interpreter works, and pip is not in it."""
    record = replace(RECORD, requirements=replace(RECORD.requirements, files=(), python=(11, 14)))
    monkeypatch.setattr(environments, "_check", lambda record, python: None)
    found = install(record)
    assert found.state == "installed"
    assert environments._run([str(found.python), "-c", "import sys"])[0] == 0
    assert environments._run([str(found.python), "-m", "pip", "--version"])[0] != 0


def test_every_detector_has_its_files():
    for record in detectors():
        assert environments.worker_file(record).is_file()
        for needed in filter(None, (record.requirements, record.cuda)):
            for name in needed.files:
                lines = (environments.files("posefuse.detection.requirements") / name).read_text("utf-8").splitlines()
                assert all("==" in line or line.lstrip().startswith(("#", "--hash")) for line in lines)
            assert 0 < needed.download_mb < needed.size_mb


def test_the_home_is_absolute(monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", "relative")
    assert environment_of(RECORD).folder == Path(os.getcwd()) / "relative" / "detectors" / "mediapipe"
