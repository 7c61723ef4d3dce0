"""``posefuse run`` on the command line."""

import shutil

import pytest

import posefuse
from posefuse.io.calibration import anipose
from tests.coded_videos import film_person


def test_plan_run_and_project_file(recording, tmp_path, run):
    code, out, err = run("run", recording, "--output", tmp_path / "out", "--dry-run")
    assert code == 0, err
    assert "nothing to do: 2D keypoints in keypoints.nc" in out
    assert "nothing to do: 4 cameras in calibration.toml" in out
    assert not (tmp_path / "out").exists()
    code, out, err = run("run", recording, "--output", tmp_path / "out", "--people", "one")
    assert code == 0, err
    assert "The times of the views are used as they are" in out
    assert f"Report: {tmp_path / 'out' / 'result' / 'report.html'}" in out
    shutil.copytree(recording, tmp_path / "copy")
    project = tmp_path / "out" / "posefuse.toml"
    code, _, err = run("run", tmp_path / "copy", "--options", project, "--output", tmp_path / "again")
    assert code == 0, err
    for name in ("posefuse.toml", "sync.toml", "run.json", "result/reconstruction.nc"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    code, out, _ = run("run", recording, "--output", tmp_path / "out", "--people", "one")
    assert out.count("kept: inputs and options did not change") == 2
    # The file is one of options for other commands, too.
    code, _, err = run("reconstruct", recording, "--options", project, "--output", tmp_path / "result")
    assert code == 0, err
    assert posefuse.read_reconstruction(tmp_path / "result" / "reconstruction.nc").options.people == "one"


def test_commands_on_results_take_the_output_of_a_run(recording, tmp_path, run):
    out = tmp_path / "out"
    code, _, err = run("run", recording, "--output", out, "--synchronize", "off")
    assert code == 0, err
    commands = (
        ("report", out, "--output", tmp_path / "report.html"),
        ("people", out, "--output", tmp_path / "people.html"),
        ("plot", out, "--output", tmp_path / "plots"),
        ("explain", out, "--frame", "3"),
        ("evaluate", out),
        ("convert", out, tmp_path / "points.npz", "--to", "npz"),
        ("overlay", out, "--blank", "--output", tmp_path / "overlay", "--end-s", "0.1"),
    )
    for command in commands:
        code, _, err = run(*command)
        assert code == 0, (command, err)
    assert (out / "result" / "evaluation.json").is_file()
    (tmp_path / "edits.toml").write_text('[[edit]]\ndo = "rename"\nperson = "person_1"\nto = "runner"\n')
    code, _, err = run("edit", out, tmp_path / "edits.toml", "--output", tmp_path / "edited")
    assert code == 0, err
    # The same command still resumes.
    code, printed, err = run("run", recording, "--output", out, "--synchronize", "off")
    assert code == 0, err
    assert "kept: inputs and options did not change" in printed


@pytest.mark.parametrize("more", [(), ("--dry-run",)])
def test_an_empty_folder_is_one_sentence(tmp_path, run, more):
    (tmp_path / "empty").mkdir()
    code, out, err = run("run", tmp_path / "empty", "--output", tmp_path / "out", *more)
    assert code == 1
    assert out == ""
    assert "has neither videos nor 2D keypoints" in err
    assert ". " not in err.strip()


def test_options_of_all_stages_have_flags(recording, tmp_path, run):
    flags = ("--detect.every", "2", "--by-people.stature-m", "1.8", "--by-board.lens", "fisheye", "--solve", "frame")
    code, _, err = run("run", recording, "--output", tmp_path / "out", "--synchronize", "off", *flags)
    assert code == 0, err
    written = (tmp_path / "out" / "posefuse.toml").read_text()
    for line in ("every = 2", "stature_m = 1.8", 'lens = "fisheye"', 'solve = "frame"', 'synchronize = "off"'):
        assert line in written
    assert not (tmp_path / "out" / "sync.toml").exists()


def test_what_is_missing_is_named_before_the_work(tmp_path, run, monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(tmp_path / "home"))
    film_person(tmp_path / "take", n=2, duration_s=0.2)
    code, out, err = run("run", tmp_path / "take", "--output", tmp_path / "out", "--dry-run")
    assert code == 1
    assert "by the people" in out
    assert "posefuse detector install mediapipe" in err
    code, _, err = run("run", tmp_path / "take", "--output", tmp_path / "out")
    assert code == 1
    assert "posefuse detector install mediapipe" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("wrong", [("--calibration", "no.toml"), ("--board", "chess:3x3"), ("--detector", "nothing")])
def test_wrong_values_are_one_sentence(tmp_path, run, wrong):
    person = film_person(tmp_path / "take", n=2, duration_s=0.2)
    if wrong[0] == "--detector":
        anipose.write(person.rig, tmp_path / "take" / "calibration.toml")
    code, _, err = run("run", tmp_path / "take", "--output", tmp_path / "out", *wrong)
    assert code == 1
    assert wrong[1].split(":")[0] in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()
