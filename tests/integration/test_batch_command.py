"""``posefuse batch`` from folders to folders."""

import csv
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posefuse
from posefuse.batch.jobs import jobs_of
from posefuse.batch.work import run_job
from posefuse.errors import StreamError
from posefuse.io.calibration import anipose
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.io.folder_locks import exclusive_folder
from posefuse.io.keypoints import native
from posefuse.io.results import netcdf
from posefuse.model.batch import Job, JobResult
from posefuse.model.options.options import Options
from posefuse.pipeline import reconstruct_recording as recipe
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.files import write_openpose

FAST = ("--solve", "frame", "--pairs", "labels")


def _cut_short(folder: Path) -> None:
    path = folder / "keypoints.nc"
    path.write_bytes(path.read_bytes()[:3000])


def _other_cameras(folder: Path) -> None:
    path = folder / "calibration.toml"
    path.write_text(path.read_text().replace('name = "', 'name = "other_'))


BREAK: dict[str, tuple[Callable[[Path], object], str]] = {
    "no calibration": (lambda folder: (folder / "calibration.toml").unlink(), "No calibrations found in"),
    "cut short": (_cut_short, "is not a complete HDF5 file"),
    "other cameras": (_other_cameras, "matches no camera by name"),
    "no keypoints": (lambda folder: (folder / "keypoints.nc").unlink(), "No sets of 2D keypoints found in"),
    "two calibrations": (
        lambda folder: shutil.copy(folder / "calibration.toml", folder / "another.toml"), "has 2 calibrations",
    ),
}  # fmt: skip


def recordings(root: Path, n: int, broken: dict[int, str], seconds: float = 0.2) -> list[Path]:
    """Write short recordings, some of them broken."""
    folders = []
    for i in range(n):
        made = simulate(SceneOptions(duration_s=seconds, cameras=3, detector=CLEAN, seed=i))
        folder = root / f"rec_{i:03d}"
        folder.mkdir(parents=True)
        anipose.write(made.rig, folder / "calibration.toml")
        native.write(made.detections, folder / "keypoints.nc")
        if i in broken:
            BREAK[broken[i]][0](folder)
        folders.append(folder)
    return folders


def rows_of(output: Path) -> dict[str, dict[str, str]]:
    with (output / "batch.csv").open(newline="") as file:
        return {row["recording"]: row for row in csv.DictReader(file)}


def check_batch(run, tmp_path: Path, n: int, broken: dict[int, str], seconds: float = 0.2) -> Path:
    """All intact recordings are processed; broken ones are listed with a reason."""
    folders, output = recordings(tmp_path / "recs", n, broken, seconds), tmp_path / "out"
    code, text, wrong = run("batch", *folders, "-o", output, "--jobs", "2", *FAST)
    assert code == 1
    assert f"{n} recordings: {n - len(broken)} done, 0 kept (nothing changed), {len(broken)} failed" in text
    assert all(len(line) <= 80 for line in text.splitlines() if str(output) not in line)
    rows = rows_of(output)
    assert {name for name, row in rows.items() if row["outcome"] == "failed"} == {f"rec_{i:03d}" for i in broken}
    for i, kind in broken.items():
        assert BREAK[kind][1] in rows[f"rec_{i:03d}"]["why"]
        assert f"failed: rec_{i:03d}: " in wrong
        assert not (output / f"rec_{i:03d}").exists()
    for name, row in rows.items():
        assert (output / name / "report.html").exists() == (row["outcome"] == "reconstructed")
    for name in ("batch.csv", "batch.html"):
        assert str(tmp_path) not in (output / name).read_text()
    return output


def test_batch_completes_despite_three_broken_recordings(run, tmp_path):
    output = check_batch(run, tmp_path, 8, {2: "no calibration", 5: "cut short", 6: "other cameras"})
    page, table = (output / "batch.html").read_bytes(), (output / "batch.csv").read_bytes()
    result = (output / "rec_001" / "reconstruction.nc").read_bytes()
    # Mended, and another lost: these two are done, the others kept.
    shutil.copy(tmp_path / "recs" / "rec_003" / "calibration.toml", tmp_path / "recs" / "rec_002")
    (output / "rec_001" / "reconstruction.nc").unlink()
    folders = sorted((tmp_path / "recs").iterdir())[:4]
    code, text, _ = run("batch", *folders, "-o", output, "--jobs", "1", "--overwrite", *FAST)
    assert code == 0
    assert "4 recordings: 2 done, 2 kept (nothing changed), 0 failed" in text
    assert (output / "rec_001" / "reconstruction.nc").read_bytes() == result
    assert (output / "batch.html").read_bytes() != page
    assert (output / "batch.csv").read_bytes() != table


def test_interrupted_batch_resumes_within_a_recording(tmp_path, monkeypatch):
    """Of 30 frames in chunks of 10, the third is not finished."""
    (folder,) = recordings(tmp_path / "recs", 1, {}, 1.0)
    options = Options(chunk_frames=10, solve="frame", pairs="labels")
    put = CheckpointFolder.save
    made: list[str] = []

    def state_of(name: str, ends: bool) -> str:
        def noted(parts: CheckpointFolder, part: str, value: object) -> object:
            if ends and part == "measured_000002":
                raise OSError(28, "No space left on device", str(parts.folder / part))
            made.append(part)
            return put(parts, part, value)

        monkeypatch.setattr(CheckpointFolder, "save", noted)
        (job,) = jobs_of([folder], tmp_path / name, None, options)
        return run_job(job).state

    assert state_of("whole", ends=False) == "done"
    assert state_of("out", ends=True) == "failed"
    assert (tmp_path / "out" / "rec_000" / CHECKPOINT_FOLDER).is_dir()
    made.clear()
    assert state_of("out", ends=False) == "done"
    # After the last chunk, the result replaces the parts.
    assert made == ["measured_000002", "whole"]
    whole, out = (
        {
            path.relative_to(tmp_path / name): path.read_bytes()
            for path in (tmp_path / name).rglob("*")
            if path.is_file()
        }
        for name in ("whole", "out")
    )
    assert out == whole


@pytest.mark.long
def test_result_is_recomputed_if_timestamps_change(run, tmp_path):
    """Timestamp files beside the keypoints are part of the input."""
    scene = simulate(SceneOptions(duration_s=1.0, cameras=3))
    folder = tmp_path / "recs" / "a"
    folder.mkdir(parents=True)
    anipose.write(scene.rig, folder / "calibration.toml")
    write_openpose(folder / "pose", scene.detections)
    command = ("batch", folder, "--output", tmp_path / "out", "--jobs", 1, "--people", "one")
    for rate_hz in (25.0, 50.0):
        frames = range(scene.detections.n_frames)
        rows = [f"{name},{f},{f / rate_hz}" for name in scene.rig.names for f in frames]
        (folder / "timestamps.csv").write_text("\n".join(["camera,frame,time_s", *rows]) + "\n")
        assert "1 done" in run(*command, "--overwrite")[1]
        result = posefuse.read_reconstruction(tmp_path / "out" / "a" / "reconstruction.nc")
        assert result.rate_hz == pytest.approx(rate_hz)
    assert "1 kept" in run(*command)[1]


def test_recording_that_changes_while_it_is_read_is_recomputed(tmp_path, monkeypatch):
    (folder,) = recordings(tmp_path / "recs", 1, {}, 0.5)
    (job,) = jobs_of([folder], tmp_path / "out", None, Options(people="one"))
    calibration, write = folder / "calibration.toml", recipe.write_outputs

    def changing(*given: Any) -> object:
        calibration.write_text(calibration.read_text() + "\n")
        return write(*given)

    with monkeypatch.context() as patched:
        patched.setattr(recipe, "write_outputs", changing)
        outcome = run_job(job)
    assert (outcome.state, "changed while" in outcome.why) == ("failed", True)
    assert not (job.output / "fingerprint.json").exists()
    assert run_job(job).state == "done"
    assert run_job(job).state == "kept"


def test_interrupted_batch_reports_completed_recordings(run, tmp_path, monkeypatch):
    folders = recordings(tmp_path / "recs", 2, {}, 0.5)

    def outcomes(todo: list[Job], *_: object) -> Iterator[JobResult]:
        yield run_job(todo[0])
        raise KeyboardInterrupt

    command = ("batch", *folders, "--output", tmp_path / "out", "--people", "one", "--jobs", 1)
    with monkeypatch.context() as patched:
        patched.setattr("posefuse.cli.batch._run", outcomes)
        code, output, wrong = run(*command)
    assert code == 130
    assert "2 recordings: 1 done, 0 kept (nothing changed), 0 failed, 1 not done" in output
    assert "run the same command again for the rest" in " ".join(wrong.split())
    assert "rec_001,not done" in (tmp_path / "out" / "batch.csv").read_text()
    assert "1 done, 1 kept" in run(*command)[1]


def test_two_batches_do_not_write_to_one_folder(run, tmp_path):
    folders = recordings(tmp_path / "recs", 1, {}, 0.5)
    (tmp_path / "out").mkdir()
    with exclusive_folder(tmp_path / "out", tmp_path / "out"):
        code, _, wrong = run("batch", *folders, "--output", tmp_path / "out")
    assert (code, "another posefuse process is writing" in " ".join(wrong.split())) == (1, True)


@pytest.mark.long
def test_batch_of_two_hundred_completes_despite_five_broken_recordings(run, tmp_path):
    output = check_batch(run, tmp_path, 200, dict(zip((3, 50, 51, 120, 199), BREAK, strict=True)), 2.0)
    before = {path.relative_to(output): path.read_bytes() for path in output.rglob("*") if path.is_file()}
    for name in ("rec_000", "rec_100", "rec_198"):
        shutil.rmtree(output / name)
    code, text, _ = run("batch", *sorted((tmp_path / "recs").iterdir()), "-o", output, "--jobs", "2", *FAST)
    assert code == 1
    assert "200 recordings: 3 done, 192 kept (nothing changed), 5 failed" in text
    assert before == {path.relative_to(output): path.read_bytes() for path in output.rglob("*") if path.is_file()}


@pytest.mark.long
def test_cluster_gives_the_same_results_if_a_worker_dies(run, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    folders = recordings(tmp_path / "recs", 6, {1: "cut short"})
    assert run("batch", *folders, "-o", tmp_path / "here", "--jobs", "1", *FAST)[0] == 1
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
    ) as cluster:
        from posefuse.batch import cluster as module

        usual = module.on_cluster

        def killing(work, jobs, scheduler, divided, **more):
            for i, outcome in enumerate(usual(work, jobs, scheduler, divided, **more)):
                if i == 1:
                    os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
                yield outcome

        monkeypatch.setattr(module, "on_cluster", killing)
        code, output, _ = run(
            "batch", *folders, "-o", tmp_path / "there", "--scheduler", cluster.scheduler_address, *FAST
        )
    assert code == 1
    assert "6 recordings: 5 done, 0 kept (nothing changed), 1 failed" in output
    here, other = (
        {path.relative_to(root): path.read_bytes() for path in root.rglob("*") if path.is_file()}
        for root in (tmp_path / "here", tmp_path / "there")
    )
    assert here == other


@pytest.mark.long
def test_divided_recording_gives_the_same_result_if_a_worker_dies(run, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    folders = recordings(tmp_path / "recs", 2, {})
    long = tmp_path / "recs" / "long"
    long.mkdir()
    scene = simulate_crowd(CrowdOptions("crowd", people=2, cameras=4, duration_s=12.0, seed=3))
    anipose.write(scene.rig, long / "calibration.toml")
    native.write(scene.detections, long / "keypoints.nc")
    chunks = ("--chunk-frames", "100")
    expected = ("--people", "auto", "--tracker.terminate-after-s", "0.5", "--noise-scale-px", "14", *chunks, *FAST)
    assert run("batch", *folders, long, "-o", tmp_path / "here", "--jobs", "1", *expected)[0] == 0
    from posefuse.batch import cluster as module

    usual = module.on_cluster
    for name, dies in (("quiet", False), ("killed", True)):
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
        ) as cluster:

            def killing(work, jobs, scheduler, divided, *, cluster=cluster, dies=dies, **more):
                def kills(job, do):
                    def rounds(piece_work, pieces):
                        if dies and piece_work.__name__ == "smooth_piece":
                            pid = next(iter(cluster.workers.values())).pid
                            threading.Timer(1.0, os.kill, (pid, signal.SIGKILL)).start()
                        do(piece_work, pieces)

                    return divided(job, rounds)

                return usual(work, jobs, scheduler, kills, **more)

            monkeypatch.setattr(module, "on_cluster", killing)
            other = ("--scheduler", cluster.scheduler_address, "--window-s", "4", *expected)
            code, output, _ = run("batch", *folders, long, "-o", tmp_path / name, *other)
            assert code == 0
            # A worker may die when it has just done a recording: that is then kept as it is.
            assert "0 failed" in output if dies else "3 recordings: 3 done" in output
            if not dies:
                assert "0 done, 3 kept" in run("batch", *folders, long, "-o", tmp_path / name, *other)[1]
    quiet, killed = (
        {path.relative_to(root): path.read_bytes() for path in root.rglob("*") if path.is_file()}
        for root in (tmp_path / "quiet", tmp_path / "killed")
    )
    assert quiet == killed
    whole, pieces = (
        netcdf.read_reconstruction(tmp_path / name / "long" / "reconstruction.nc") for name in ("here", "killed")
    )
    assert "in 3 windows" in " ".join(pieces.provenance.notes)
    assert pieces.person_ids == whole.person_ids
    np.testing.assert_array_equal(pieces.tracks.state[:], whole.tracks.state[:])
    assert pieces.layers["measured"].frames(0, pieces.n_frames) == whole.layers["measured"].frames(0, whole.n_frames)


def test_a_batch_that_cannot_start_leaves_no_folder(run, tmp_path, monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise StreamError("No scheduler.")

    monkeypatch.setattr("posefuse.batch.cluster.on_cluster", fail)
    (tmp_path / "x").mkdir()
    code, _, said = run("batch", tmp_path / "x", "-o", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9")
    assert (code, said.strip()) == (1, "error: No scheduler.")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("more", "code", "message"),
    [
        ((), 2, "No recording given"),
        (("x", "--window-s", "0"), 2, "--window-s must be more than 0"),
        (("x", "--jobs", "0"), 2, "--jobs must be at least 1"),
        (("x", "--jobs", "2", "--scheduler", "tcp://x"), 2, "--jobs applies only to this machine"),
        (("x", "--calibration", "nowhere.toml"), 1, "No calibration at nowhere.toml"),
        (("x", "--calibration", "people"), 2, "--calibration people needs --from-videos"),
        (
            ("x", "--detector", "mediapipe", "--max-offset-s", "1"),
            2,
            "Only --from-videos takes --max-offset-s, --detect",
        ),
        (("x", "--from-videos", "--again"), 2, "--again does not apply to --from-videos"),
        (("x", "--workers", "0..4"), 2, "--workers needs --scheduler local"),
        (("x", "--workers", "4", "--scheduler", "tcp://x"), 2, "The scheduler at tcp://x has workers already"),
        (("x", "--workers", "no", "--scheduler", "local"), 2, "--workers must be a number such as 4"),
        (("x", "--retries", "-1"), 2, "--retries must be at least 0"),
    ],
)
def test_invalid_arguments_are_reported(run, tmp_path, more, code, message):
    actual = run("batch", *more, "-o", tmp_path / "out")
    assert (actual[0], actual[1]) == (code, "")
    assert message in actual[2]
