"""A Python of a supported version is found, or one sentence says which is needed."""

import sys
from pathlib import Path

import pytest

from posefuse.detection import interpreters
from posefuse.detection.interpreters import find_python, minor_version
from posefuse.errors import DetectorError

THIS = sys.version_info[1]


def fake(folder, minor, bits=64):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"python3.{minor}"
    path.write_text(f"#!/bin/sh\necho {minor} {bits} cpython\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def computer(tmp_path, monkeypatch):
    """A computer whose only interpreters are those of the test."""
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/bin")
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    monkeypatch.setattr(interpreters, "find_uv", lambda: None)
    monkeypatch.setattr(interpreters.shutil, "which", which_in(tmp_path / "bin"))
    return tmp_path


def which_in(folder):
    return lambda name, path=None: str(folder / name) if (folder / name).exists() else None


def test_this_python_is_the_first_choice(computer):
    assert find_python((9, THIS), None, "It") == Path(sys.executable)


def test_the_newest_supported_python_is_found(computer):
    fake(computer / "bin", 8)
    wanted = fake(computer / "bin", 7)
    assert find_python((6, 7), None, "It") == wanted
    fake(computer / "pyenv" / "versions" / "3.8.1" / "bin", 8).rename(
        computer / "pyenv" / "versions" / "3.8.1" / "bin" / "python"
    )
    (computer / "bin" / "python3.8").unlink()
    assert find_python((6, 8), None, "It") == computer / "pyenv" / "versions" / "3.8.1" / "bin" / "python"


def test_without_a_suitable_python_one_sentence_says_which(computer):
    fake(computer / "bin", 8, bits=32)
    with pytest.raises(DetectorError, match=r"It needs CPython 3\.6 to 3\.8, 64 bits, and this computer has none\."):
        find_python((6, 8), None, "It")


def test_a_given_python_must_fit(computer):
    with pytest.raises(DetectorError, match=rf"is Python 3\.{THIS}\. Name another `python`"):
        find_python((6, 7), Path(sys.executable), "It")
    with pytest.raises(DetectorError, match="cannot be run as CPython"):
        find_python((6, 20), computer / "nothing", "It")
    assert find_python((6, 20), Path(sys.executable), "It") == Path(sys.executable)


def test_what_is_no_python_has_no_version(tmp_path):
    assert minor_version(Path("/bin/true")) is None
    assert minor_version(tmp_path / "missing") is None
    assert minor_version(Path(sys.executable)) == THIS


def test_uv_offers_its_interpreters(computer, monkeypatch):
    wanted = fake(computer / "managed", 7)
    uv = computer / "uv"
    uv.write_text(f'#!/bin/sh\n[ "$2" = find ] && [ -e {computer}/downloaded ] && echo {wanted} && exit 0\n'
                  f'[ "$2" = install ] && touch {computer}/downloaded && exit 0\nexit 1\n')  # fmt: skip
    uv.chmod(0o755)
    monkeypatch.setattr(interpreters, "find_uv", lambda: uv)
    assert find_python((6, 7), None, "It") == wanted
