"""The Python blocks of docs/tutorials/engineer.md run, on a simulated recording with the files of the real one."""

from pathlib import Path

import numpy as np

import posefuse
from posefuse.io.keypoints import openpose
from tests.conftest import ROOT
from tests.files import qualisys_xml
from tests.integration.test_documents import python_blocks

PAGE = ROOT / "docs" / "tutorials" / "engineer.md"


def run_blocks(folder: Path, monkeypatch) -> dict:
    """Run the blocks in a folder, and return their names."""
    monkeypatch.chdir(folder)
    names: dict = {}
    for block in python_blocks(PAGE):
        exec(compile(block, str(PAGE), "exec"), names)
    return names


def test_blocks_run_on_a_simulated_recording(tmp_path, monkeypatch):
    scene = posefuse.simulate_crowd(
        posefuse.CrowdOptions("hug", cameras=4, duration_s=16.0, rate_hz=60.0, skeleton="body_25b", seed=3)
    )
    (tmp_path / "two_people").mkdir()
    (tmp_path / "two_people" / "Calib.qca.txt").write_text(qualisys_xml(scene.rig))
    openpose.write(scene.detections.between(0, 100), tmp_path / "two_people" / "pose")
    names = run_blocks(tmp_path, monkeypatch)
    assert np.isfinite(names["points"]).mean() > 0.5
    assert {person.state.name for people in names["all_failed"] for person in people.people} >= {"ACTIVE", "LOST"}


def test_blocks_run_on_the_recording_of_the_page(shared_data, tmp_path, monkeypatch):
    recording = shared_data("pose2sim")
    (tmp_path / "two_people").mkdir()
    (tmp_path / "two_people" / "Calib.qca.txt").symlink_to(recording / "calibration" / "Calib.qca.txt")
    (tmp_path / "two_people" / "pose").symlink_to(recording / "two_people" / "pose")
    names = run_blocks(tmp_path, monkeypatch)
    assert f"{names['points'].shape}\n" in PAGE.read_text()
