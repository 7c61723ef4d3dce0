"""Commands exit with 3 if the recording check is certain that results are wrong; the result is still written."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import posefuse
from posefuse.batch.work import run_job
from posefuse.cli.simulate import write_scene
from posefuse.model.cameras import CameraRig
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import Scene

FAST = ("--solve", "frame", "--people", "one")


def exchanged(rig: CameraRig) -> CameraRig:
    """Return the rig with the names of two cameras exchanged."""
    first, second, *others = rig.cameras
    return replace(rig, cameras=(replace(second, name=first.name), replace(first, name=second.name), *others))


def in_millimeters(rig: CameraRig) -> CameraRig:
    """Return the rig of a calibration in millimeters that is read as one in meters."""
    return replace(rig, cameras=tuple(_moved_away(camera) for camera in rig.cameras))


def _moved_away(camera):
    pose = camera.camera_from_world.copy()
    pose[:3, 3] *= 1000.0
    return replace(camera, camera_from_world=pose)


FAULTS: dict[str, tuple[Callable[[CameraRig], CameraRig], str]] = {
    "exchanged": (exchanged, "The views are assigned to the wrong cameras: view"),
    "millimeters": (in_millimeters, "The scale is wrong for this skeleton"),
}


@pytest.fixture(scope="module")
def scene() -> Scene:
    return posefuse.simulate(SceneOptions(duration_s=4.0, cameras=4, seed=1))


@pytest.fixture
def folders(scene, tmp_path) -> dict[str, Path]:
    """Return folders of the recording without and with each fault."""
    made = {"good": scene.rig, **{name: change(scene.rig) for name, (change, _) in FAULTS.items()}}
    for name, rig in made.items():
        (tmp_path / name).mkdir()
        write_scene(replace(scene, rig=rig), tmp_path / name)
    return {name: tmp_path / name for name in made}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name == "millimeters" else name for name in FAULTS]
)
def test_reconstruct_writes_the_result_and_exits_with_3(name, run, folders, tmp_path):
    command = ("reconstruct", folders[name], *FAST, "-o", tmp_path / "out")
    for repetition in range(2):
        code, output, wrong = run(*command)
        assert code == 3
        sentence = wrong[wrong.index("error: ") :]
        assert sentence.startswith(f"error: {FAULTS[name][1]}")
        assert sentence.strip().endswith(
            "so the result is wrong; correct it, or give --accept-findings to exit with 0 instead of 3."
        )
        assert (tmp_path / "out" / "report.html").exists()
        assert ("nothing was done" in " ".join(output.split())) == bool(repetition)
    code, _, wrong = run(*command, "--accept-findings")
    assert (code, "error" in wrong) == (0, False)


def test_all_commands_agree_on_a_recording(run, folders, tmp_path):
    for name, folder in folders.items():
        wrong = name in FAULTS
        assert run("inspect", folder, "--deep", "--people", "one")[0] == (3 if wrong else 0)
        assert run("inspect", folder, "--deep", "--people", "one", "--accept-findings")[0] == 0
        found = posefuse.inspect_health(folder, options=posefuse.Options(people="one"))
        assert any(finding.is_certain for finding in found) == wrong
    assert run("reconstruct", folders["good"], *FAST, "-o", tmp_path / "out")[0] == 0


def test_batch_marks_results_that_are_certainly_wrong(run, folders, tmp_path, monkeypatch):
    monkeypatch.setattr("posefuse.cli.batch._run", lambda todo, *_: map(run_job, todo))
    command = ("batch", *folders.values(), *FAST, "-o", tmp_path / "out")
    code, output, wrong = run(*command)
    assert code == 3
    assert "3 recordings: 1 done, 0 kept (nothing changed), 0 failed, 2 failed check" in " ".join(output.split())
    assert "failed check: exchanged: The views are assigned to the wrong cameras" in wrong
    with (tmp_path / "out" / "batch.csv").open(newline="") as file:
        outcomes = {row["recording"]: row["outcome"] for row in csv.DictReader(file)}
    assert outcomes == {"good": "reconstructed", "exchanged": "failed check", "millimeters": "failed check"}
    page = (tmp_path / "out" / "batch.html").read_text("utf-8")
    assert "<h2>Failed check</h2>" in page
    assert 'href="exchanged/report.html"' in page
    code, output, _ = run(*command)
    assert (code, "0 done, 1 kept (nothing changed), 0 failed, 2 failed check" in " ".join(output.split())) == (3, True)
    assert run(*command, "--accept-findings")[0] == 0
    (folders["good"] / "keypoints.nc").unlink()
    assert run(*command)[0] == 1
