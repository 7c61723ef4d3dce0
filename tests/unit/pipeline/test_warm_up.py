"""Warming up reconstructs short scenes of both kinds."""

import pytest

from posefuse.cli.main import main
from posefuse.errors import OptionsError
from posefuse.pipeline.warm_up import TASKS, warm_up


def test_warming_up_says_what_is_ready(capsys):
    main(["warm-up", "--jobs", "1"])
    words = " ".join(capsys.readouterr().out.split())
    assert all(name in words for name in TASKS)


def test_a_wrong_number_of_processes_is_refused():
    with pytest.raises(OptionsError, match="at least 1, got 0"):
        warm_up(0)
