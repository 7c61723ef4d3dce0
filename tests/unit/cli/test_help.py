"""Help fits the screen, and --help-all lists every option."""

import pytest

from posefuse.cli.main import COMMANDS, main
from posefuse.model.options.catalog import list_options


@pytest.fixture
def shown(capsys, monkeypatch):
    """Return the lines that the command line prints, at 80 columns."""

    def call(*arguments: str) -> list[str]:
        monkeypatch.setenv("COLUMNS", "80")
        main(list(arguments))
        return capsys.readouterr().out.splitlines()

    return call


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_in_60_lines(command, shown):
    lines = shown(command, "--help")
    assert len(lines) <= 60
    assert max(len(line) for line in lines) <= 80


def test_help_shows_common_options_and_help_all_shows_all(shown):
    words = " ".join(shown("reconstruct", "--help")).split()
    assert [entry.flag for entry in list_options() if entry.bounds.common and entry.flag not in words] == []
    words = " ".join(shown("reconstruct", "--help-all")).split()
    assert [entry.flag for entry in list_options() if entry.flag not in words] == []
    assert len(shown("reconstruct", "--help")) <= 60


def test_every_command_is_listed(shown):
    text = "\n".join(shown("--help"))
    assert [name for name in COMMANDS if f"\n  {name} " not in text] == []


def test_flags_of_a_command_keep_their_own_text(shown):
    assert "Layer to draw; by default the best one available." in " ".join(" ".join(shown("overlay", "--help")).split())
