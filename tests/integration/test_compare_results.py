"""``posefuse compare RESULT RESULT`` and ``posefuse evaluate RESULT reference.mot``, from files to files."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, OptionsError
from posefuse.pipeline.compare_angles import compare_angle_files
from posefuse.pipeline.compare_results import compare_results
from posefuse.synthetic.options import SceneOptions

OPTIONS = posefuse.Options(solve="frame", pairs="labels")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return two results of one recording that differ in one option."""
    folder = tmp_path_factory.mktemp("results")
    scene = posefuse.simulate(SceneOptions(duration_s=1.0, cameras=4))
    for method in ("consensus", "midpoint"):
        options = replace(OPTIONS, triangulation=replace(OPTIONS.triangulation, method=method))
        (folder / method).mkdir()
        result = posefuse.reconstruct(scene.rig, scene.detections, options)
        posefuse.write(result, folder / method / "reconstruction.nc")
    return folder


def motion(path, shift_deg: float = 0.0, names: str = "knee_angle_r", delay_s: float = 0.0):
    time_s = np.arange(60) / 30.0
    lines = [f"{t:.6f}\t{30 + 20 * np.sin(5 * (t - delay_s)) + shift_deg:.6f}" for t in time_s]
    path.write_text("walk\ninDegrees=yes\nendheader\ntime\t" + names + "\n" + "\n".join(lines) + "\n", "utf-8")
    return path


def test_equal_results_do_not_differ(results):
    compared = compare_results(results / "consensus", results / "consensus")
    (person,) = compared.points.people
    assert (person.whole.median_mm, person.whole.p95_mm, person.whole.only_in_first) == (0.0, 0.0, 0)
    assert compared.options == ()


def test_two_methods_differ_in_points_and_in_the_option_that_says_so(run, results, tmp_path):
    code, output, warned = run("compare", results / "consensus", results / "midpoint", "-o", tmp_path / "out")
    assert (code, warned) == (0, "")
    assert "triangulation.method" in output
    assert all(len(line) <= 80 for line in output.splitlines() if "/" not in line)
    with (tmp_path / "out" / "comparison.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    whole = next(row for row in rows if row["name"] == "all")
    assert 0.0 < float(whole["median_distance"]) < 100.0
    assert len(rows) == 1 + 26


def test_two_results_refuse_flags_of_methods(run, results, tmp_path):
    code, _, warned = run(
        "compare", results / "consensus", results / "midpoint", "--methods", "simple", "-o", tmp_path / "out"
    )
    assert code == 2
    assert "--methods: no effect" in warned
    assert not (tmp_path / "out").exists()


def test_angles_are_compared_with_a_reference_and_drawn(run, results, tmp_path):
    motion(results / "midpoint" / "person_1.mot", shift_deg=4.0, delay_s=0.1)
    reference = motion(tmp_path / "reference.mot")
    target = tmp_path / "angles.json"
    code, output, _ = run("evaluate", results / "midpoint", reference, "--max-time-shift-s", 0.3, "--json", target)
    assert code == 0
    assert "shifted by -0.1" in output.replace("\n", " ")
    (numbers,) = json.loads(target.read_text("utf-8"))
    assert numbers["angles"]["knee_angle_r"]["bias_deg"] == pytest.approx(4.0, abs=0.1)
    assert numbers["time_shift_s"] == pytest.approx(-0.1, abs=0.003)
    assert {file.name for file in tmp_path.iterdir()} >= {"angles_reference.png", "angles_reference.svg"}
    assert run("evaluate", results / "midpoint", reference, "--json", target)[0] == 1
    # A wrong name is reported before the existing output.
    assert "No reference at" in " ".join(run("evaluate", results / "midpoint", tmp_path / "refer.mot")[2].split())


def test_the_person_that_agrees_best_is_compared(results, tmp_path):
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "reconstruction.nc").write_bytes((results / "midpoint" / "reconstruction.nc").read_bytes())
    motion(folder / "person_1.mot", shift_deg=20.0)
    motion(folder / "person_2.mot", shift_deg=1.0)
    (found,) = compare_angle_files(folder, [motion(tmp_path / "reference.mot")])
    assert found.result == "person_2.mot"


def test_a_result_without_angles_and_a_negative_shift_are_errors(results, tmp_path):
    reference = motion(tmp_path / "reference.mot")
    with pytest.raises(FileError, match=r"has no \.mot file"):
        compare_angle_files(results / "consensus", [reference])
    with pytest.raises(OptionsError, match="max_time_shift_s"):
        compare_angle_files(reference, [reference], -1.0)


def test_points_and_angles_are_not_mixed(run, results, tmp_path):
    reference = motion(tmp_path / "reference.mot")
    code, _, warned = run("evaluate", results / "consensus", reference, results / "midpoint")
    assert code == 2
    assert "cannot be compared in one call" in " ".join(warned.split())


@pytest.mark.parametrize(
    "flags",
    [
        ("--layer", "measured"),
        ("--states", "active"),
        ("--length-unit", "mm"),
        ("--gate-m", 0.2),
        ("--entry-s", 1.0),
        ("--head-rule", "campus"),
    ],
)
def test_angles_refuse_flags_of_points(run, results, tmp_path, flags):
    target = tmp_path / "angles.json"
    code, output, warned = run(
        "evaluate", results / "midpoint", motion(tmp_path / "walk.mot"), *flags, "--json", target
    )
    assert (code, output) == (2, "")
    assert f"{flags[0]}: no effect here" in " ".join(warned.split())
    assert not target.exists()


def test_points_refuse_the_flag_of_angles(run, results):
    code, output, warned = run("evaluate", results / "consensus", results / "midpoint", "--max-time-shift-s", 0.3)
    assert (code, output) == (2, "")
    assert "--max-time-shift-s: no effect here" in " ".join(warned.split())
