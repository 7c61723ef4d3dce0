"""Fingerprints of results."""

from dataclasses import replace
from pathlib import Path

from posefuse.batch.fingerprints import fingerprint, remove_mark, unchanged_result, write_mark
from posefuse.model.batch import JobResult, ResultStatistics
from posefuse.model.options.options import Options

STATISTICS = ResultStatistics(30, 1.0, 4, 2, 0.98, 12.0, 24.0, None)


def test_result_is_reused_until_something_changes(tmp_path):
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
