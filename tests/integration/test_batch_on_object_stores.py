"""``posefuse batch`` with recordings and results on a local S3 server."""

import os
import shutil
import signal
import threading
from pathlib import Path

import pytest

from posefuse.batch import work
from posefuse.io.calibration import anipose
from posefuse.io.files import RUN_FILE
from posefuse.io.keypoints import native
from posefuse.io.object_stores import list_files, remove, write_stored
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from tests.coded_videos import film_person
from tests.integration.test_batch_command import FAST, recordings, rows_of
from tests.object_stores import contents, local_contents, upload_folder

LOCAL_CLUSTER = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": 50}


@pytest.fixture
def one_process(monkeypatch):
    """Run the jobs in this process, which saves the start of others; the pool has its own tests."""
    monkeypatch.setattr("posefuse.batch.pool.in_processes", lambda work, jobs, *_: map(work, jobs))


def gets(s3: Path) -> list[str]:
    """Return the files that were downloaded so far."""
    lines = s3.read_text().splitlines()
    return [line.partition('"GET /')[2].split()[0] for line in lines if '"GET /' in line and "?" not in line]


@pytest.mark.usefixtures("one_process")
def test_results_are_the_bytes_of_local_ones_and_kept(run, tmp_path, s3, bucket):
    folders = recordings(tmp_path / "recs", 3, {1: "cut short"})
    calibration = shutil.move(folders[2] / "calibration.toml", tmp_path / "cameras.toml")
    for folder in folders[:2]:
        (folder / "calibration.toml").unlink()
    upload_folder(tmp_path / "recs", f"{bucket}/recs")
    upload_folder(calibration.parent / "recs", f"{bucket}/recs")
    write_stored(f"{bucket}/cameras.toml", calibration.read_bytes())
    here = ("batch", *folders, "-o", tmp_path / "here", "--calibration", calibration, "--jobs", 1, *FAST)
    assert run(*here)[0] == 1
    there = (
        "batch", f"{bucket}/recs/*", "-o", f"{bucket}/out", "--calibration", f"{bucket}/cameras.toml", "--jobs", 1,
        *FAST,
    )  # fmt: skip
    code, text, wrong = run(*there)
    assert code == 1
    assert "3 recordings: 2 done, 0 kept (nothing changed), 1 failed" in text
    assert "failed: rec_001: rec_001/keypoints.nc is not a complete HDF5 file" in wrong
    assert contents(f"{bucket}/out") == local_contents(tmp_path / "here")
    # Nothing of the results and their inputs is downloaded again.
    before = len(gets(s3))
    assert "0 done, 2 kept" in run(*there)[1]
    again = [name for name in gets(s3)[before:] if "rec_001" not in name and "/out/batch." not in name]
    assert [name.rpartition("/")[2] for name in again if "cameras" not in name] == ["upload.json"] * 2
    # An input that was uploaded again with the same content is downloaded, and the result is kept.
    upload_folder(folders[0], f"{bucket}/recs/rec_000")
    assert "0 done, 2 kept" in run(*there)[1]
    changed = (*there, "--rate-hz", "50")
    assert "already contains a result" in run(*changed)[2]
    assert "2 done, 0 kept" in run(*changed, "--overwrite")[1]


@pytest.mark.usefixtures("one_process")
def test_results_of_local_recordings_are_uploaded_and_those_of_stored_ones_downloaded(run, tmp_path, bucket):
    folders = recordings(tmp_path / "recs", 1, {})
    upload_folder(folders[0], f"{bucket}/recs/rec_000")
    assert run("batch", *folders, "-o", f"{bucket}/out", "--jobs", 1, *FAST)[0] == 0
    assert run("batch", f"{bucket}/recs/rec_000", "-o", tmp_path / "here", "--jobs", 1, *FAST)[0] == 0
    assert contents(f"{bucket}/out") == local_contents(tmp_path / "here")
    for command in (
        ("batch", *folders, "-o", f"{bucket}/out"), ("batch", f"{bucket}/recs/rec_000", "-o", tmp_path / "here"),
    ):  # fmt: skip
        assert "0 done, 1 kept" in run(*command, "--jobs", 1, *FAST)[1]


@pytest.mark.usefixtures("one_process")
def test_errors_are_sentences(run, tmp_path, bucket):
    code, _, wrong = run("batch", "s3://no-such-bucket/recs/*", "-o", tmp_path / "out")
    assert (code, "There is no bucket s3://no-such-bucket" in wrong) == (1, True)
    code, _, wrong = run("batch", f"{bucket}/nothing", "-o", f"{bucket}/out", "--jobs", 1)
    assert (code, "There are no files in nothing" in wrong) == (1, True)
    (folder,) = recordings(tmp_path / "recs", 1, {})
    write_stored(f"{bucket}/thesis/rec_000/thesis.txt", b"text")
    code, _, wrong = run("batch", folder, "-o", f"{bucket}/thesis", "--jobs", 1)
    assert (code, "already contains other files (thesis.txt)" in wrong) == (1, True)
    code, _, wrong = run("batch", folder, "-o", "s3://no-such-bucket/out", "--jobs", 1)
    assert (code, "There is no bucket s3://no-such-bucket" in wrong) == (1, True)


@pytest.mark.usefixtures("one_process")
def test_runs_from_videos_are_the_bytes_of_local_ones(run, tmp_path, bucket, monkeypatch):
    """The second attempt continues from the stages that the first one uploaded."""
    person = film_person(tmp_path / "recs" / "take", n=3, duration_s=1.0)
    anipose.write(person.rig, tmp_path / "recs" / "take" / "calibration.toml")
    detector = person.worker_file(tmp_path)
    upload_folder(tmp_path / "recs", f"{bucket}/recs")
    flags = ("--from-videos", "--jobs", 1, "--detector", detector, "--people", "one", "--synchronize", "off", *FAST)
    code, _, wrong = run("batch", tmp_path / "recs" / "take", "-o", tmp_path / "here", *flags)
    assert code == 0, wrong
    assert (tmp_path / "here" / "take" / RUN_FILE).is_file()
    assert (tmp_path / "here" / "take" / "report.html").is_file()
    there = ("batch", f"{bucket}/recs/take", "-o", f"{bucket}/out", *flags)
    # The worker is gone after the detection.
    (job,) = _jobs(run, there, monkeypatch)
    with monkeypatch.context() as patched:
        patched.setattr("posefuse.pipeline.run.recipe.carry_out", _fail)
        result = work.run_job(job)
    assert (result.state, result.transient) == ("failed", True)
    assert "take/keypoints/detection.json" in list_files(f"{bucket}/out")
    with monkeypatch.context() as patched:
        patched.setattr("posefuse.pipeline.detect.detect_chunks", _fail)
        assert work.run_job(job).state == "done"
    assert "0 done, 1 kept" in run(*there)[1]
    assert contents(f"{bucket}/out") == local_contents(tmp_path / "here")
    assert "0 done, 1 kept" in run("batch", tmp_path / "recs" / "take", "-o", tmp_path / "here", *flags)[1]
    assert rows_of(tmp_path / "here")["take"]["outcome"] == "reconstructed"


def _fail(*_: object, **__: object) -> None:
    raise OSError(5, "Input/output error")


def _jobs(run, command, monkeypatch):
    """Return the jobs of a batch, which is interrupted before them."""
    found = []

    def interrupt(todo, *_):
        found.extend(todo)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("posefuse.cli.batch._run", interrupt)
        run(*command)
    return found


@pytest.mark.long
def test_cluster_without_a_shared_folder_gives_the_same_results_if_a_worker_dies(run, tmp_path, bucket, monkeypatch):
    """Of two workers, one is killed among the pieces of a long recording."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    scene = simulate_crowd(CrowdOptions("crowd", people=2, cameras=4, duration_s=12.0, seed=3))
    long = tmp_path / "recs" / "long"
    recordings(tmp_path / "recs", 2, {})
    long.mkdir()
    anipose.write(scene.rig, long / "calibration.toml")
    native.write(scene.detections, long / "keypoints.nc")
    upload_folder(tmp_path / "recs", f"{bucket}/recs")
    flags = (
        "--people",
        "auto",
        "--tracker.terminate-after-s",
        "0.5",
        "--noise-scale-px",
        "14",
        "--window-s",
        "4",
        "--chunk-frames",
        "100",
        *FAST,
    )
    from posefuse.batch import cluster as module

    usual = module.on_cluster
    with distributed.LocalCluster(n_workers=2, **LOCAL_CLUSTER) as cluster:
        address = cluster.scheduler_address
        local = ("batch", *sorted((tmp_path / "recs").iterdir()), "-o", tmp_path / "here", "--scheduler", address)
        assert run(*local, *flags)[0] == 0

        def killing(task, jobs, scheduler, divided, **more):
            def kills(job, do):
                def rounds(piece_work, pieces):
                    if "smooth_piece" in repr(piece_work):
                        pid = next(iter(cluster.workers.values())).pid
                        threading.Timer(1.0, os.kill, (pid, signal.SIGKILL)).start()
                    do(piece_work, pieces)

                return divided(job, rounds)

            return usual(task, jobs, scheduler, kills, **more)

        monkeypatch.setattr(module, "on_cluster", killing)
        code, text, wrong = run("batch", f"{bucket}/recs/*", "-o", f"{bucket}/out", "--scheduler", address, *flags)
        assert (code, wrong) == (0, "")
        # A worker may die when it has just done a recording: that is then kept as it is.
        assert "0 failed" in text
        assert contents(f"{bucket}/out") == local_contents(tmp_path / "here")
        monkeypatch.setattr(module, "on_cluster", usual)
        there = ("batch", f"{bucket}/recs/*", "-o", f"{bucket}/out", "--scheduler", address, *flags)
        assert "0 done, 3 kept" in run(*there)[1]


@pytest.mark.long
def test_long_videos_are_divided_after_the_detection(run, tmp_path, bucket):
    """A worker detects and calibrates; the windows are spread over workers."""
    pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    person = film_person(tmp_path / "recs" / "take", n=3, duration_s=6.0)
    detector = person.worker_file(tmp_path)
    anipose.write(person.rig, tmp_path / "recs" / "take" / "calibration.toml")
    upload_folder(tmp_path / "recs", f"{bucket}/recs")
    flags = (
        "--from-videos", "--detector", detector, "--people", "many", "--synchronize", "off", "--window-s", "2.5",
        "--tracker.terminate-after-s", "0.5", "--chunk-frames", "25", "--scheduler", "local", "--workers", "0..2",
        *FAST,
    )  # fmt: skip
    code, _, wrong = run("batch", tmp_path / "recs" / "take", "-o", tmp_path / "here", *flags)
    assert code == 0, wrong
    code, _, wrong = run("batch", f"{bucket}/recs/take", "-o", f"{bucket}/out", *flags)
    assert code == 0, wrong
    found = contents(f"{bucket}/out")
    assert found == local_contents(tmp_path / "here")
    assert b"windows of about 2.5 s" in (found["take/result/report.html"] or b"")


@pytest.mark.usefixtures("one_process")
@pytest.mark.filterwarnings("ignore:Sending a large body:ResourceWarning")  # by gcsfs
def test_google_storage_gives_the_bytes_of_local_results(run, tmp_path, google_bucket):
    folders = recordings(tmp_path / "recs", 2, {})
    upload_folder(tmp_path / "recs", f"{google_bucket}/recs")
    here = ("batch", *folders, "-o", tmp_path / "here", "--jobs", 1, *FAST)
    there = ("batch", f"{google_bucket}/recs/*", "-o", f"{google_bucket}/out", "--jobs", 1, *FAST)
    assert run(*here)[0] == 0
    code, text, wrong = run(*there)
    assert (code, "2 recordings: 2 done, 0 kept" in text) == (0, True), wrong
    assert contents(f"{google_bucket}/out") == local_contents(tmp_path / "here")
    assert "0 done, 2 kept" in run(*there)[1]
    remove([f"{google_bucket}/out/{name}" for name in list_files(f"{google_bucket}/out")])
    assert list_files(f"{google_bucket}/out") == {}
    code, _, wrong = run("batch", f"{google_bucket}-missing/recs/*", "-o", tmp_path / "out")
    assert (code, f"There is no bucket {google_bucket}-missing" in wrong) == (1, True)
