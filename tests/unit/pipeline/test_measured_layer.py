"""Measured chunks are stored until ranges that are solved over time contain them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.io.results import netcdf
from posefuse.model.options.options import Options
from posefuse.pipeline.measured_layer import reconstruct_chunks
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd

CHUNK = 32
OPTIONS = Options(people="many", solve="trajectory", chunk_frames=CHUNK, noise_scale_px=8.0)


class Ended(BaseException):
    """An exception that no code catches or cleans up after."""


@pytest.fixture(scope="module", autouse=True)
def blocks():
    """Solve ranges of 64 frames, or of the margin if that is longer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("posefuse.pipeline.solved_layer.BLOCK_FRAMES", 2 * CHUNK)
        yield


@pytest.fixture(scope="module")
def crowd():
    """Two people in 400 frames of three cameras."""
    scene = simulate_crowd(CrowdOptions(people=2, cameras=3, duration_s=16.0, skeleton="coco_17", faults=NO_FAULTS))
    return scene.rig, scene.detections


def made(recording: Any, path: Path, checkpoint: Checkpoint = NO_CHECKPOINT) -> bytes:
    plan = prepare(*recording, OPTIONS, Silent(), checkpoint)
    netcdf.write(reconstruct_chunks(plan, Silent(), checkpoint), path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def whole(crowd, tmp_path_factory) -> bytes:
    return made(crowd, tmp_path_factory.mktemp("whole") / "made.nc")


def parts(folder: Path, kind: str) -> list[str]:
    return sorted(path.name for path in folder.rglob(f"{kind}_*.part"))


def test_solved_ranges_replace_measured_chunks(crowd, whole, tmp_path, monkeypatch):
    checkpoint, save, kept = CheckpointFolder(tmp_path / "parts", "key"), CheckpointFolder.save, []

    def recorded(folder: CheckpointFolder, name: str, value: object) -> object:
        if name.startswith("solved"):
            kept.append(len(parts(tmp_path, "measured")))
        return save(folder, name, value)

    monkeypatch.setattr(CheckpointFolder, "save", recorded)
    assert made(crowd, tmp_path / "made.nc", checkpoint) == whole
    n_chunks = -(-crowd[1].n_frames // CHUNK)
    assert len(kept) > 3
    assert max(kept[1:-1]) < n_chunks - 2
    assert parts(tmp_path, "measured") == []
    assert len(parts(tmp_path, "solved")) == len(kept)


@pytest.mark.parametrize("damage", ["none", "first solved range", "last measured chunk", "first measured chunk"])
def test_work_resumes_to_the_same_bytes(crowd, whole, tmp_path, monkeypatch, damage):
    """After an end between two solved ranges, with all parts or with a damaged one."""
    checkpoint, save = CheckpointFolder(tmp_path / "parts", "key"), CheckpointFolder.save

    def ended(folder: CheckpointFolder, name: str, value: object) -> object:
        if name == "solved_000002":
            raise Ended
        return save(folder, name, value)

    with monkeypatch.context() as patch:
        patch.setattr(CheckpointFolder, "save", ended)
        with pytest.raises(Ended):
            made(crowd, tmp_path / "made.nc", checkpoint)
    assert parts(tmp_path, "solved") == ["solved_000000.part", "solved_000001.part"]
    kind = "solved" if damage.endswith("range") else "measured"
    stored = sorted((tmp_path / "parts").rglob(f"{kind}_*.part"))
    assert stored
    assert np.all([path.name != "measured_000000.part" for path in stored])
    if damage != "none":
        damaged = stored[-1 if damage.startswith("last") else 0]
        damaged.write_bytes(damaged.read_bytes()[:-1])
    assert made(crowd, tmp_path / "made.nc", checkpoint) == whole
