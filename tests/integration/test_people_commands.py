"""Results of many people on the command line: edit, explain and report, from files to files."""

import json
import os
import re
from dataclasses import replace

import pytest

import posefuse
from posefuse.editing import apply_edits
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.results import netcdf
from tests.people import simulate_walkers, track_perfectly

EDITS = """
[[edit]]
do = "rename"
person = "person_1"
to = "anna"

[[edit]]
do = "drop"
person = "person_2"
"""


@pytest.fixture
def folder(tmp_path):
    """A result, and the recording it is of."""
    scene = simulate_walkers(people=10, seconds=1.0)
    (tmp_path / "recording").mkdir()
    native.write(scene.detections, tmp_path / "recording" / "keypoints.nc")
    anipose.write(scene.rig, tmp_path / "recording" / "calibration.toml")
    result = track_perfectly(scene)
    result = replace(result, provenance=replace(result.provenance, inputs={}))
    (tmp_path / "result").mkdir()
    netcdf.write(result.chunks(), tmp_path / "result" / "reconstruction.nc")
    return tmp_path


def test_edit(run, folder):
    (folder / "edits.toml").write_text(EDITS)
    before = (folder / "result" / "reconstruction.nc").read_bytes()
    code, output, wrong = run("edit", folder / "result", folder / "edits.toml")
    assert (code, wrong) == (0, "")
    assert (folder / "result" / "reconstruction.nc").read_bytes() == before
    out = folder / "result_edited"
    names = {entry.name for entry in out.iterdir()}
    assert {"reconstruction.nc", "model.csv", "events.csv", "anna.trc", "person_10.c3d", "report.html"} <= names
    assert "person_2.trc" not in names
    assert "note: Edited: person_1 renamed to anna." in output
    assert all(len(line) <= 80 for line in output.splitlines() if not line.startswith("to /"))
    edited = posefuse.read_reconstruction(out / "reconstruction.nc")
    expected = apply_edits(posefuse.read_reconstruction(folder / "result/reconstruction.nc"),
                           posefuse.read_edits(folder / "edits.toml"))  # fmt: skip
    assert edited.joint_angles is not None
    assert replace(edited, provenance=expected.provenance, joint_angles=None) == expected
    assert edited.provenance.notes == expected.provenance.notes
    assert list(edited.provenance.inputs) == ["edits.toml"]
    assert str(folder).encode() not in (out / "reconstruction.nc").read_bytes()


def test_failed_edits_leave_no_files(run, folder):
    (folder / "edits.toml").write_text(EDITS.replace("person_2", "person_22"))
    before = sorted(folder.rglob("*"))
    code, _, output = run("edit", folder / "result", folder / "edits.toml")
    assert code == 1
    assert "Edit 2 (drop): No person is called 'person_22'. Did you mean" in output
    assert sorted(folder.rglob("*")) == before
    code, _, output = run("edit", folder / "result", folder / "edits.toml", "-o", folder / "result")
    assert code == 1
    assert "is the result itself" in output


def without_title(path) -> bytes:
    """Return the bytes of a file; those of a report without its title, which is the name of a folder."""
    return re.sub(rb"<title>[^<]*|<h1[^>]*>[^<]*", b"", path.read_bytes())


def test_reconstruct_repeats_the_edits(run, recording, tmp_path):
    (tmp_path / "edits.toml").write_text('[[edit]]\ndo = "rename"\nperson = "person_1"\nto = "anna"\n')
    assert run("reconstruct", recording, "-o", tmp_path / "plain")[0] == 0
    assert run("edit", tmp_path / "plain", tmp_path / "edits.toml", "-o", tmp_path / "edited")[0] == 0
    assert run("reconstruct", recording, "-o", tmp_path / "again", "--edits", tmp_path / "edits.toml")[0] == 0
    for name in ("reconstruction.nc", "keypoints.csv", "anna.trc", "report.html"):
        assert without_title(tmp_path / "again" / name) == without_title(tmp_path / "edited" / name), name
    assert {*os.listdir(tmp_path / "again")} - {"fingerprint.json"} == {*os.listdir(tmp_path / "edited")}


def test_explain(run, folder):
    code, output, wrong = run("explain", folder / "result", "--frame", 12, "--recording", folder / "recording")
    assert (code, wrong) == (0, "")
    for words in ("frame 12, 0.480 s", "person_3  active since", "cam_4: ", "unassigned"):
        assert words in output
    assert all(len(line) <= 80 for line in output.splitlines())
    keypoints = folder / "recording" / "keypoints.nc"
    code, output, _ = run("explain", folder / "result", "--frame", 12, "--person", "person_3", "--keypoints", keypoints)
    assert code == 0
    assert "person_3, layer model:" in output
    assert "person_5" not in output.split("cam_0")[0]
    code, output, _ = run("explain", folder / "result", "--frame", 12)
    assert code == 0
    assert "Unassigned detections are not listed without the 2D keypoints" in output
    code, _, output = run("explain", folder / "result", "--frame", 99)
    assert code == 1
    assert "frames 0 to 24" in output


def test_explain_refuses_other_keypoints(run, folder):
    path = folder / "result" / "reconstruction.nc"
    result = posefuse.read_reconstruction(path)
    result = replace(result, provenance=replace(result.provenance, inputs={"keypoints.nc": "0" * 64}))
    netcdf.write(list(result.chunks()), folder / "result2.nc")
    code, _, output = run("explain", folder / "result2.nc", "--frame", 3, "--recording", folder / "recording")
    assert code == 0
    assert "keypoints.nc has changed since the result was written" in output


def test_edits_may_drop_all_people(run, folder, monkeypatch):
    """Absent people have no files and no statistics, and all lines fit the window."""
    monkeypatch.setenv("COLUMNS", "80")
    (folder / "edits.toml").write_text('[[edit]]\ndo = "drop"\nto_frame = 24\n')
    code, output, warned = run("edit", folder / "result", folder / "edits.toml", "-o", folder / "out")
    assert code == 0
    assert "nan" not in output
    assert "- of the points of tracked people have coordinates" in output
    assert "no person is left in any frame; there is no TRC or C3D to write" in warned
    assert not [entry for entry in (folder / "out").iterdir() if entry.suffix in (".trc", ".c3d")]
    assert "nan" not in (folder / "out" / "model.csv").read_text()
    assert all(len(line) <= 80 for line in output.splitlines() if not line.startswith("to /"))


def test_report_of_several_people_with_truth(run, folder):
    posefuse.write(simulate_walkers(people=10, seconds=1.0).truth, folder / "truth.nc")
    code, _, wrong = run("report", folder / "result", "--truth", folder / "truth.nc", "-o", folder / "r.html")
    assert (code, wrong) == (0, "")
    page = (folder / "r.html").read_text()
    assert "Comparison with the ground truth</h2>" in page
    assert "<th>People in the ground truth, in the result</th><td>10, 10</td>" in page
    assert "<th>IDF1</th>" in page


def test_result_without_truth_is_evaluated_by_self_consistency(run, folder, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, output, wrong = run("evaluate", folder / "result")
    assert (code, wrong) == (0, "")
    assert "layer model, self-consistency without ground truth: 25 frames" in output
    assert "NIS per degree of freedom, mean" in output
    assert all(len(line) <= 80 for line in output.splitlines() if not line.startswith("/"))
    numbers = json.loads((folder / "result" / "evaluation.json").read_text())
    assert numbers["innovations"]["mean"] == pytest.approx(1.0, abs=0.05)
    assert [person["name"] for person in numbers["people"]][:2] == ["person_1", "person_2"]
