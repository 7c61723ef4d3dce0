"""Every benchmark can be imported."""

import importlib

import pytest

from tests.conftest import ROOT

BASE_ONLY = {"same_numbers_inputs"}
"""Modules that run with the source of an earlier commit."""
MODULES = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py") if path.stem not in BASE_ONLY)


@pytest.mark.parametrize("name", MODULES)
def test_benchmark_can_be_imported(name):
    importlib.import_module(f"benchmarks.{name}")
