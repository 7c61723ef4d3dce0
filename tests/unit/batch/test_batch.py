"""Many recordings: names, processes that die, workers of a cluster that do, what is kept, the page over all."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from posefuse.batch.cluster import on_cluster
from posefuse.batch.fingerprints import fingerprint, remove_mark, unchanged_result, write_mark
from posefuse.batch.jobs import jobs_of
from posefuse.batch.pool import in_processes
from posefuse.errors import OptionsError, StreamError
from posefuse.model.batch import Job, JobResult, ResultStatistics
from posefuse.model.options.options import Options
from posefuse.report.batch import batch_csv, batch_page
from tests.unit.batch.works import do

STATISTICS = ResultStatistics(30, 1.0, 4, 2, 0.98, 12.0, 24.0, None)


def jobs(folder: Path, *names: str) -> list[Job]:
    return [Job(name, Path(name), folder, None, Options()) for name in names]


def test_results_are_named_after_folders(tmp_path):
    one, other = tmp_path / "a" / "rec", tmp_path / "b" / "rec"
    found = jobs_of([one, tmp_path / "c", one, other, tmp_path / "out"], tmp_path / "out", None, Options())
    assert [job.name for job in found] == ["a-rec", "c", "b-rec"]
    assert [job.output for job in found] == [tmp_path / "out" / job.name for job in found]
    assert all(job.folder.is_absolute() for job in found)


def test_equal_names_are_refused(tmp_path):
    with pytest.raises(OptionsError, match="have the same name"):
        jobs_of([tmp_path / "x" / "a" / "rec", tmp_path / "y" / "a" / "rec"], tmp_path / "out", None, Options())
    with pytest.raises(OptionsError, match="have the same name"):
        jobs_of([Path("/")], tmp_path / "out", None, Options())
    with pytest.raises(OptionsError, match="No recording"):
        jobs_of([], tmp_path / "out", None, Options())
    with pytest.raises(OptionsError, match="All folders are the output"):
        jobs_of([tmp_path / "out"], tmp_path / "out", None, Options())
    with pytest.raises(OptionsError, match=r"would be named batch\.csv"):
        jobs_of([tmp_path / "batch.csv"], tmp_path / "out", None, Options())


def test_recordings_in_the_output_are_refused_and_results_are_skipped(tmp_path):
    out = tmp_path / "out"
    for name in ("made", "begun", "rec"):
        (out / name).mkdir(parents=True)
    (out / "made" / "reconstruction.nc").touch()
    (out / "begun" / ".parts").mkdir()
    with pytest.raises(OptionsError, match=r"contains recordings of the batch \(.*rec\)"):
        jobs_of([out / "rec", tmp_path / "other"], out, None, Options())
    given = [out / "made", out / "begun", out, tmp_path / "other"]
    assert [job.name for job in jobs_of(given, out, None, Options())] == ["other"]


def test_undecodable_names_are_escaped(tmp_path):
    (job,) = jobs_of([tmp_path / os.fsdecode(b"rec\xff")], tmp_path / "out", None, Options())
    assert (job.name, job.output.name) == ("rec\\xff", "rec\\xff")


def test_a_dying_process_does_not_affect_other_jobs(tmp_path):
    todo = jobs(tmp_path, "dies", "a", "diesonce", "b", "c")
    found = {outcome.name: outcome for outcome in in_processes(do, todo, 2)}
    assert {name: outcome.state for name, outcome in found.items()} == {
        "dies": "failed", "a": "done", "diesonce": "done", "b": "done", "c": "done",
    }  # fmt: skip
    assert "SIGKILL" in found["dies"].why
    assert "--jobs 1" in found["dies"].why
    assert [name for name in os.environ if name == "NUMBA_NUM_THREADS"] == []


def test_tasks_of_a_dying_cluster_worker_run_elsewhere(tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    names = [f"slow_{i}" for i in range(6)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        found = {}
        for outcome in on_cluster(do, jobs(tmp_path, *names), cluster.scheduler_address):
            if not found:
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
            found[outcome.name] = outcome
    assert {name: outcome.state for name, outcome in found.items()} == dict.fromkeys(names, "done")


def test_a_missing_scheduler_is_an_error():
    pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    with pytest.raises(StreamError, match="No Dask scheduler answers at nowhere"):
        list(on_cluster(do, [], "nowhere"))


def test_a_result_is_kept_until_something_changes(tmp_path):
    def digest(path: Path) -> str:
        return path.read_text()

    (tmp_path / "reconstruction.nc").write_text("bytes")
    (tmp_path / "report.html").write_text("page")
    key = fingerprint({"keypoints.nc": "1"}, Options())
    result = JobResult("rec", "done", "", STATISTICS, ("a warning",))
    assert unchanged_result("rec", tmp_path, key, digest) is None
    write_mark(tmp_path, key, result, digest)
    assert unchanged_result("rec", tmp_path, key, digest) == replace(result, state="kept")
    assert unchanged_result("rec", tmp_path, fingerprint({"keypoints.nc": "2"}, Options()), digest) is None
    assert unchanged_result("rec", tmp_path, fingerprint({"keypoints.nc": "1"}, Options(people="many")), digest) is None
    assert (
        unchanged_result("rec", tmp_path, fingerprint({"keypoints.nc": "1"}, Options(), "own skeleton"), digest) is None
    )
    (tmp_path / "reconstruction.nc").write_text("others")
    assert unchanged_result("rec", tmp_path, key, digest) is None
    (tmp_path / "reconstruction.nc").write_text("bytes")
    (tmp_path / "batch.json").write_text("{}")
    assert unchanged_result("rec", tmp_path, key, digest) is None
    write_mark(tmp_path, key, result, digest)
    (tmp_path / "report.html").unlink()
    assert unchanged_result("rec", tmp_path, key, digest) is None
    remove_mark(tmp_path)
    remove_mark(tmp_path)
    assert not (tmp_path / "batch.json").exists()


def test_names_are_escaped_in_the_page():
    evil = '<script>alert("x")</script>'
    page = batch_page([JobResult(evil, "failed", evil), JobResult("../" + evil, "done", "", STATISTICS, (evil,))])
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 5
    assert "98.0 %" in page
    table = batch_csv([JobResult('a,"b"\n', "failed", "why"), JobResult("c", "kept", "", STATISTICS)])
    assert table.splitlines()[0].startswith("recording,outcome,frames,seconds,cameras,people,points_share")
    assert table.endswith("c,reconstructed,30,1.0,4,2,0.98,12.0,24.0,,,\n")


def test_kept_results_are_written_like_new_ones():
    done, before = (JobResult("c", state, "", STATISTICS) for state in ("done", "kept"))
    assert (batch_csv([done]), batch_page([done])) == (batch_csv([before]), batch_page([before]))
