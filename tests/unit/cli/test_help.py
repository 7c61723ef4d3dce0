"""Help fits the screen, and --help-all lists every option."""

import pytest

from posefuse.cli.main import COMMANDS, main
from posefuse.model.options.catalog import list_options


@pytest.fixture
def run(capsys, monkeypatch):
    """Return the lines that the command line prints, at 80 columns."""

    def call(*arguments: str) -> list[str]:
        monkeypatch.setenv("COLUMNS", "80")
        main(list(arguments))
        return capsys.readouterr().out.splitlines()

    return call


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_in_60_lines(command, run):
    lines = run(command, "--help")
    assert len(lines) <= 60
    assert max(len(line) for line in lines) <= 80


def test_help_shows_common_options_and_help_all_shows_all(run):
    words = " ".join(run("reconstruct", "--help")).split()
    assert [entry.flag for entry in list_options() if entry.bounds.common and entry.flag not in words] == []
    words = " ".join(run("reconstruct", "--help-all")).split()
    assert [entry.flag for entry in list_options() if entry.flag not in words] == []
    assert len(run("reconstruct", "--help")) <= 60


def test_every_command_is_listed(run):
    text = "\n".join(run("--help"))
    assert [name for name in COMMANDS if f"\n  {name} " not in text] == []


def test_flags_of_a_command_keep_their_own_text(run):
    assert "Layer to draw; by default the best one available." in " ".join(" ".join(run("overlay", "--help")).split())
