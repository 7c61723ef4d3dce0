"""``posefuse evaluate`` with many people."""

import json
from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.unit.evaluation.test_people import drifting_people, result_of


@pytest.fixture
def files(tmp_path):
    """Return three people, two of whom swap names halfway in the result, and a false fourth one."""
    rng = np.random.default_rng(7)
    truth = drifting_people(rng, 50, 3)
    points = np.concatenate([truth, truth[:, :1] + np.array([0.0, 30.0, 0.0])], axis=1)
    points[25:, :2] = truth[25:, 1::-1]
    points += 0.01 * rng.normal(size=points.shape)
    points[12:, 3] = np.nan
    posefuse.write(result_of(points, 1e-4), tmp_path / "reconstruction.nc")
    posefuse.write(result_of(truth), tmp_path / "truth.nc")
    return tmp_path


def test_evaluate_prints_a_table_and_writes_numbers(run, files, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, output, warned = run("evaluate", files, files / "truth.nc", "--head-rule", "campus", "--entry-s", "0.2")
    assert (code, warned) == (0, "")
    assert "50 frames, 17 keypoints, 4 people for 3" in " ".join(output.split())
    assert [line for line in output.splitlines() if len(line) > 80 and str(files) not in line] == []
    assert "recall from 0.2 s after entries" in output
    numbers = json.loads((files / "evaluation.json").read_text())
    assert numbers["clear"][0]["switches"] == 2
    assert numbers["clear"][0]["mota"] == pytest.approx(1 - (12 + 2) / 150)
    assert numbers["identity"]["idf1"] == pytest.approx(2 * 100 / (150 + 162))
    assert numbers["ghosts"] == [{"person": "person_4", "frames": 12, "longest": 12, "ever_matched": False}]
    assert numbers["people"][2]["counterpart"] == "person_3"
    assert numbers["nees"]["mean"] == pytest.approx(3, rel=0.1)


def test_unavailable_scores_have_a_reason(run, files):
    truth = posefuse.read_reconstruction(files / "truth.nc")
    away = replace(truth.layers["measured"], points_m=np.asarray(truth.layers["measured"].points_m[:]) + 90.0)
    posefuse.write(replace(truth, layers={"measured": away}), files / "away.nc")
    code, output, _ = run("evaluate", files / "away.nc", files / "truth.nc", "--json", files / "numbers.json")
    assert code == 0
    assert "- no person is matched within 0.5 m" in output
    numbers = json.loads((files / "numbers.json").read_text())
    assert numbers["mpjpe_mm"] is None
    assert numbers["undefined"]["mpjpe_mm"] == "no person is matched within 0.5 m"


@pytest.mark.parametrize("ending", ["trc", "c3d"])
def test_evaluate_accepts_one_file_per_person(ending, run, files):
    truth = posefuse.read_reconstruction(files / "truth.nc")
    for p, name in enumerate(("anna", "otto")):
        layer = truth.layers["measured"]
        one = {field: np.asarray(getattr(layer, field))[:, p : p + 1] for field in vars(layer)}
        single = replace(truth, person_ids=(name,), layers={"measured": replace(layer, **one)})
        posefuse.write(single, files / f"{name}.{ending}")
    code, output, _ = run("evaluate", files, files / f"anna.{ending}", files / f"otto.{ending}")
    assert code == 0
    numbers = json.loads((files / "evaluation.json").read_text())
    assert [person["name"] for person in numbers["people"]] == ["anna", "otto"]
    assert numbers["clear"][0]["misses"] == 0
    assert "anna" in output
    code, _, output = run("evaluate", files, files / f"anna.{ending}", files / "truth.nc", "--overwrite")
    assert code == 1
    assert "one file per person" in output


def test_report_and_evaluate_accept_the_same_truth(run, tmp_path):
    scene = simulate(SceneOptions(duration_s=1.0, cameras=4, seed=3))
    result = posefuse.triangulate(scene.rig, scene.detections)
    (tmp_path / "out").mkdir()
    posefuse.write(result, tmp_path / "out" / "reconstruction.nc")
    truth = posefuse.write(scene.truth, tmp_path / "truth.parquet").files[0]
    assert run("evaluate", tmp_path / "out", truth)[0] == 0
    median = json.loads((tmp_path / "out" / "evaluation.json").read_text())["median_mm"]
    assert run("report", tmp_path / "out", "--truth", truth)[0] == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert f"median error {median:.1f} mm" in page
    assert '"truth": null' not in page.replace('"truth":null', '"truth": null')
