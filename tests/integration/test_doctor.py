"""``posefuse doctor`` states what is installed and what commands lack."""

import json

import pytest

from posefuse.cli import doctor as command
from posefuse.cli.doctor import EXTRA_OF_COMMAND
from posefuse.cli.main import main
from posefuse.diagnostics import installation
from posefuse.diagnostics.installation import Extra, examine_installation


def test_the_core_works(capsys):
    main(["doctor"])
    text = capsys.readouterr().out
    assert "The core works." in text
    assert all(word in text for word in ("numba", "kernels", "extras", "detectors", "mediapipe"))
    assert max(map(len, text.splitlines())) <= 120


def test_json_has_all_facts(capsys):
    main(["doctor", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["problem"] == ""
    assert found["versions"]["posefuse"]
    assert found["cores"] >= 1
    assert {extra["name"] for extra in found["extras"]} >= {"video", "calibrate", "opensim", "view"}


def test_extras_of_commands_are_declared():
    declared = {extra.name for extra in examine_installation().extras}
    assert {name for extras in EXTRA_OF_COMMAND.values() for name in extras} <= declared


def test_a_missing_extra_names_its_command(monkeypatch, capsys):
    monkeypatch.setattr(installation, "_extras", lambda: (Extra("view", ("rerun-sdk",)),))
    main(["doctor"])
    text = capsys.readouterr().out
    assert "pip install 'posefuse[view]'" in text
    assert "posefuse view: view" in text


def test_a_broken_core_exits_with_1(monkeypatch, capsys):
    monkeypatch.setattr(command, "_core_problem", lambda: "OSError: no LLVM")
    with pytest.raises(SystemExit) as ended:
        main(["doctor"])
    assert ended.value.code == 1
    assert "OSError: no LLVM" in capsys.readouterr().out


@pytest.mark.parametrize(("reason", "words"), [
    ("", "10 MB in the package"),
    ("this processor lacks avx2", "10 MB in the package are not used: this processor lacks avx2"),
])  # fmt: skip
def test_kernels_of_the_package_are_stated(reason, words, monkeypatch, tmp_path, capsys):
    stored = tmp_path / "kernel.nbc"
    stored.write_bytes(bytes(10_000_000))
    monkeypatch.setattr(installation, "prebuilt_kernels", lambda: ({stored}, reason))
    main(["doctor"])
    assert words in " ".join(capsys.readouterr().out.split())
