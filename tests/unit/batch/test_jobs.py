"""Jobs of a batch."""

import os
from pathlib import Path

import pytest

from posefuse.batch.jobs import jobs_of, place_of, places_of, resolved_run
from posefuse.errors import OptionsError
from posefuse.io.object_stores import write_stored
from posefuse.model.options.detection import DetectOptions
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions


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


def test_recordings_on_object_stores_are_named_like_local_ones(bucket, tmp_path):
    for name in ("a/rec", "b/rec", "out/rec"):
        write_stored(f"{bucket}/{name}/keypoints.nc", b"x")
    folders = places_of([f"{bucket}/*/rec", str(tmp_path / "c"), f"{bucket}/a/rec/"])
    assert folders == [f"{bucket}/a/rec", f"{bucket}/b/rec", f"{bucket}/out/rec", tmp_path / "c", f"{bucket}/a/rec"]
    with pytest.raises(OptionsError, match=r"contains recordings of the batch \(s3://.*/out/rec\)"):
        jobs_of(folders, place_of(f"{bucket}/out"), None, Options())
    write_stored(f"{bucket}/out/rec/upload.json", b"{}")
    actual = jobs_of(folders, place_of(f"{bucket}/out/"), None, Options())
    assert [(job.name, job.output) for job in actual] == [
        ("a-rec", f"{bucket}/out/a-rec"), ("b-rec", f"{bucket}/out/b-rec"), ("c", f"{bucket}/out/c"),
    ]  # fmt: skip


def test_files_of_options_are_absolute_unless_they_are_in_the_recordings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("cameras.toml", "weights.onnx", "own.py"):
        (tmp_path / name).touch()
    (tmp_path / "rec").mkdir()
    (tmp_path / "rec" / "times.csv").touch()
    detect = DetectOptions(detector="own.py", weights=("weights.onnx",))
    run = RunOptions(calibration="cameras.toml", timestamps="times.csv", board="charuco:7x5,square=30mm", detect=detect)
    actual = resolved_run(run, [tmp_path / "rec"])
    assert (actual.calibration, actual.timestamps) == (str(tmp_path / "cameras.toml"), "times.csv")
    assert (actual.board, actual.synchronize) == ("charuco:7x5,square=30mm", "auto")
    assert actual.detect.detector == str(tmp_path / "own.py")
    assert actual.detect.weights == (str(tmp_path / "weights.onnx"),)
