"""Fixtures of the command-line tests."""

import re
import shutil
from pathlib import Path

import pytest

import posefuse
from posefuse.cli.main import main
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate

BROWSER = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)


@pytest.fixture
def run(capsys):
    """Run the command; returns exit code, stdout and stderr."""

    def call(*arguments: object) -> tuple[int, str, str]:
        code = 0
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 1
        captured = capsys.readouterr()
        return code, captured.out, re.sub(r"\s+", " ", captured.err)

    return call


@pytest.fixture(scope="module")
def clean_scene():
    return simulate(SceneOptions(duration_s=1, cameras=4, detector=CLEAN))


@pytest.fixture
def recording(tmp_path, clean_scene) -> Path:
    folder = tmp_path / "recording"
    folder.mkdir()
    anipose.write(clean_scene.rig, folder / "calibration.toml")
    native.write(clean_scene.detections, folder / "keypoints.nc")
    posefuse.write(clean_scene.truth, tmp_path / "truth.nc")
    return folder


@pytest.fixture(scope="module")
def browser():
    """A browser without a window; tests that need it are skipped if there is none."""
    if BROWSER is None:
        pytest.skip("no chromium, chromium-browser or google-chrome on PATH to open the page in")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        # Containers may lack the privileges that the sandbox requires.
        opened = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        yield opened
        opened.close()
