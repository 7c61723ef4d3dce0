"""Warming up reconstructs short scenes of both kinds."""

import pytest

from posefuse.cli.main import main
from posefuse.errors import OptionsError
from posefuse.pipeline.warm_up import TASKS, warm_up


def test_warming_up_says_what_is_ready_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["warm-up", "--jobs", "1"])
    assert not list(tmp_path.iterdir())
    words = " ".join(capsys.readouterr().out.split())
    assert all(name in words for name in TASKS)


def test_a_wrong_number_of_processes_is_refused():
    with pytest.raises(OptionsError, match="at least 1, got 0"):
        warm_up(0)
