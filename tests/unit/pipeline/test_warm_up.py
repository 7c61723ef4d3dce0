"""Warming up reconstructs short scenes of both kinds."""

import os
import signal
from pathlib import Path

import pytest

from posefuse.cli.main import main
from posefuse.diagnostics import installation
from posefuse.errors import OptionsError, PosefuseError
from posefuse.pipeline import warm_up as module
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


@pytest.mark.parametrize("folder", [None, Path("/shared/kernels")])
def test_kernels_that_cannot_be_stored_are_not_compiled(folder, monkeypatch, capsys):
    monkeypatch.setattr(installation, "kernel_cache", lambda: (folder, False))
    with pytest.raises(SystemExit) as ended:
        main(["warm-up"])
    assert ended.value.code == 1
    error = " ".join(capsys.readouterr().err.split())
    assert (f"{folder} is read-only" if folder else "no folder for them is writable") in error


def _die(_: str) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_the_death_of_a_process_is_explained(monkeypatch):
    monkeypatch.setattr(module, "_run", _die)
    with pytest.raises(PosefuseError, match="out of memory.*jobs=1"):
        warm_up(1)


@pytest.mark.parametrize(("writable", "words"), [(True, "others are stored in"), (False, "The package contains them")])
def test_kernels_of_the_package_need_no_store(writable, words, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(installation, "kernel_cache", lambda: (tmp_path, writable))
    monkeypatch.setattr(installation, "prebuilt_kernels", lambda: ({tmp_path / "kernel.nbc"}, ""))
    monkeypatch.setattr(module, "warm_up", lambda *_, **__: ("one subject",))
    main(["warm-up"])
    text = " ".join(capsys.readouterr().out.split())
    assert "Kernels for one subject are ready." in text
    assert words in text
