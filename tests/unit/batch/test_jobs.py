"""Jobs of a batch."""

import os
from pathlib import Path

import pytest

from posefuse.batch.jobs import jobs_of
from posefuse.errors import OptionsError
from posefuse.model.options.options import Options


def test_results_are_named_after_folders(tmp_path):
    one, other = tmp_path / "a" / "rec", tmp_path / "b" / "rec"
    actual = jobs_of([one, tmp_path / "c", one, other, tmp_path / "out"], tmp_path / "out", None, Options())
    assert [job.name for job in actual] == ["a-rec", "c", "b-rec"]
    assert [job.output for job in actual] == [tmp_path / "out" / job.name for job in actual]
    assert all(job.folder.is_absolute() for job in actual)


def test_equal_names_are_refused(tmp_path):
    with pytest.raises(OptionsError, match="have the same name"):
        jobs_of([tmp_path / "x" / "a" / "rec", tmp_path / "y" / "a" / "rec"], tmp_path / "out", None, Options())
    with pytest.raises(OptionsError, match="have the same name"):
        jobs_of([Path("/")], tmp_path / "out", None, Options())
    with pytest.raises(OptionsError, match="No recording"):
        jobs_of([], tmp_path / "out", None, Options())
    with pytest.raises(OptionsError, match="each is the output"):
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
    original = [out / "made", out / "begun", out, tmp_path / "other"]
    assert [job.name for job in jobs_of(original, out, None, Options())] == ["other"]


def test_undecodable_names_are_escaped(tmp_path):
    (job,) = jobs_of([tmp_path / os.fsdecode(b"rec\xff")], tmp_path / "out", None, Options())
    assert (job.name, job.output.name) == ("rec\\xff", "rec\\xff")
