"""Detectors in their real environments, installed once for all tests."""

import os
from pathlib import Path

import pytest

from posefuse.detection.environments import install
from posefuse.detection.registry import find_detector
from posefuse.errors import DetectorError
from tests.conftest import ROOT

_HOME = Path(os.environ.get("POSEFUSE_HOME") or ROOT / ".venv" / "posefuse")
_ABSENT = ("Check the network", "this computer has none")


def installed_home(name: str) -> Path:
    """Install a detector below ``$POSEFUSE_HOME`` or ``.venv``, and return this folder.

    The test is skipped where the packages cannot be downloaded or no Python fits.
    """
    before = os.environ.get("POSEFUSE_HOME")
    os.environ["POSEFUSE_HOME"] = str(_HOME)
    try:
        install(find_detector(name)[0], device="cpu")
    except DetectorError as error:
        if any(text in str(error) for text in _ABSENT):
            pytest.skip(str(error))
        raise
    finally:
        if before is None:
            del os.environ["POSEFUSE_HOME"]
        else:
            os.environ["POSEFUSE_HOME"] = before
    return _HOME
