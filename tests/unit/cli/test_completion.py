"""Shells complete commands, options and choices."""

import shutil
import subprocess

import pytest

from posefuse.cli.completion import completion_script
from posefuse.cli.main import COMMANDS, app, main

_LINES = {
    ("posefuse", "recon"): {"reconstruct"},
    ("posefuse", "reconstruct", "--people", ""): {"auto", "one", "many", "stills"},
    ("posefuse", "reconstruct", "rec", "--peo"): {"--people"},
    ("posefuse", "board", "--ou"): {"--output"},
    ("posefuse", "reconstruct", "file"): set(),
}


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    path = tmp_path_factory.mktemp("completion") / "posefuse.bash"
    path.write_text(completion_script(app, COMMANDS, "bash"), "utf-8")
    return path


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize("words", _LINES)
def test_bash_completes(words, script):
    line = " ".join(f"'{word}'" for word in words)
    commands = f"source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _posefuse; echo ${{COMPREPLY[@]}}"
    found = subprocess.run(["bash", "-c", commands], capture_output=True, text=True, check=True)
    assert set(found.stdout.split()) == _LINES[words]
    assert not found.stderr


def test_every_command_is_completed_in_every_shell(capsys):
    for shell in ("bash", "zsh", "fish"):
        main(["--completion", shell])
        text = capsys.readouterr().out
        assert len(text) < 60_000
        assert all(command in text for command in COMMANDS)
