"""The vocabulary check passes on standard English and fails on a planted sentence."""

import subprocess
import sys

import pytest

from tests.conftest import ROOT


def run_check(path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "scripts" / "check_vocabulary.py"), str(path)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("planted", "phrase"),
    [
        ("Nobody who is lost flies off.", "Nobody"),
        ("The body is foretold and\nput right by the pixels.", "foretold"),
        ("The body is corrected. It is put\nright by the pixels.", "put right"),
        ("The colours of the cameras.", "colours"),
        ("A row a frame.", "A row a"),
    ],
)
def test_check_reports_a_planted_sentence(tmp_path, planted, phrase):
    path = tmp_path / "page.md"
    path.write_text(f"# Page\n\n{planted}\n", "utf-8")
    result = run_check(path)
    assert result.returncode == 1
    assert f"page.md:3: {phrase!r}" in result.stdout or f"page.md:4: {phrase!r}" in result.stdout


def test_check_accepts_standard_terms(tmp_path):
    path = tmp_path / "page.md"
    path.write_text("Lost tracks do not drift. Unassigned detections start a tentative track.\n", "utf-8")
    assert run_check(path).returncode == 0


def test_check_reads_strings_and_comments_of_python_only(tmp_path):
    path = tmp_path / "module.py"
    path.write_text('nobody = 1  # a comment\nTEXT = "whoever comes"\n', "utf-8")
    result = run_check(path)
    assert "module.py:2: 'whoever'" in result.stdout
    assert result.stdout.count("\n") == 1
