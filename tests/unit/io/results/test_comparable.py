"""``evaluate`` and ``report --truth`` read results and ground truth in every format of 3D points."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.evaluation.accuracy import Accuracy
from posefuse.io.results.comparable import pair_with_truth, read_comparable, truth_at_frames_of
from posefuse.io.results.registry import RESULTS
from posefuse.io.results.rounding import MAX_STEP
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.evaluate_files import evaluate_files
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.conftest import ROOT
from tests.people import simulate_walkers, track_perfectly

NAMES = {"freemocap": "p", "trc": "p.trc", "c3d": "p.c3d"}
READABLE = {form.name: NAMES.get(form.name, form.additional_name) or "p.csv" for form in RESULTS if form.read}
ONE_PERSON = [form.name for form in RESULTS if form.read is not None and form.write_person is not None]


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(duration_s=1.0, cameras=4, skeleton="mediapipe_33", seed=3))


@pytest.fixture(scope="module")
def result(scene) -> Reconstruction:
    return posefuse.triangulate(scene.rig, scene.detections)


def written(content: Reconstruction, form: str, folder) -> list:
    if form == "nwb":
        pytest.importorskip("ndx_pose")
    return list(posefuse.write(content, folder / READABLE[form], form).files)


def test_every_readable_format_is_tested():
    assert len(READABLE) >= 11


@pytest.mark.parametrize("form", sorted(READABLE))
def test_truth_of_every_format_gives_the_same_accuracy(form, scene, result, tmp_path):
    posefuse.write(scene.truth, tmp_path / "truth.nc")
    expected = evaluate_files(result, tmp_path / "truth.nc")
    unit = "m" if form in ("anipose", "deeplabcut") else None
    found = evaluate_files(result, written(scene.truth, form, tmp_path), length_unit=unit)
    assert isinstance(found, Accuracy)
    assert isinstance(expected, Accuracy)
    assert (found.n_points, found.n_keypoints) == (expected.n_points, expected.n_keypoints)
    assert found.median_mm == pytest.approx(expected.median_mm, abs=0.3)


@pytest.mark.parametrize("form", sorted(READABLE))
def test_result_of_every_format_gives_the_same_accuracy(form, scene, result, tmp_path):
    posefuse.write(scene.truth, tmp_path / "truth.nc")
    expected = posefuse.evaluate(result, pair_with_truth(result, [tmp_path / "truth.nc"]))
    file, *others = written(result, form, tmp_path)
    assert not others
    opened = read_comparable(file, "m" if form in ("anipose", "deeplabcut") else None)
    found = evaluate_files(opened.content, tmp_path / "truth.nc")
    assert isinstance(found, Accuracy)
    assert found.n_points == expected.n_points
    assert found.median_mm == pytest.approx(expected.median_mm, abs=0.3)


@pytest.mark.parametrize("form", sorted(READABLE))
def test_several_people_of_every_format(form, tmp_path):
    walkers = simulate_walkers(people=2, seconds=1.0)
    result = track_perfectly(walkers)
    files = written(walkers.truth, form, tmp_path)
    assert len(files) == (2 if form in ONE_PERSON else 1)
    unit = "m" if form in ("anipose", "deeplabcut") else None
    scores = evaluate_files(result, files, length_unit=unit)
    assert not isinstance(scores, Accuracy)
    assert (scores.n_people, scores.n_true_people) == (2, 2)
    assert scores.median_mm < 40


def test_truth_is_drawn_at_the_frames_of_the_result(scene, result, tmp_path):
    short = replace(scene.truth).frames(5, 20)
    posefuse.write(short, tmp_path / "truth.nc")
    drawn = truth_at_frames_of(result, pair_with_truth(result, [tmp_path / "truth.nc"]))
    expected = np.full((result.n_frames, 1, len(result.skeleton), 3), np.nan)
    expected[5:20] = scene.truth.layers["measured"].points_m[5:20]
    np.testing.assert_allclose(drawn, expected, atol=0.5 * MAX_STEP)


def test_two_files_of_another_program_are_compared_by_canonical_names(tmp_path):
    names = ("RHip", "RKnee", "LHip", "LKnee", "Nose", "C7")
    time_s, moving = np.arange(10) / 10, np.random.default_rng(0).normal(size=(10, 6, 3))
    for stem, offset_m in (("a", 0.0), ("b", 0.01)):
        rows = [[f"{i + 1}", f"{time_s[i]}", *map(str, (moving[i] + [offset_m, 0, 0]).ravel())] for i in range(10)]
        head = [
            "PathFileType\t4\t(X/Y/Z)\tx.trc",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
            "10\t10\t10\t6\tm",
            "\t".join(["Frame#", "Time", *("\t\t".join([name, ""])[:-1] for name in names)]),
            "",
        ]
        (tmp_path / f"{stem}.trc").write_text("\n".join([*head, *("\t".join(row) for row in rows)]) + "\n")
    opened = read_comparable(tmp_path / "a.trc").content
    assert {"right_hip", "nose", "C7"} <= set(opened.skeleton.keypoints)
    found = evaluate_files(opened, tmp_path / "b.trc")
    assert isinstance(found, Accuracy)
    assert found.n_points == 60
    assert found.mpjpe_mm == pytest.approx(10.0)


def test_unknown_units_and_files_are_errors(scene, result, tmp_path):
    file = posefuse.write(scene.truth, tmp_path / "x_anipose.csv").files[0]
    with pytest.raises(ResultError, match="does not state its unit of length. Set `length_unit` to one of: m, cm, mm"):
        pair_with_truth(result, [file])
    with pytest.raises(FileError, match="not in a readable format of 3D points"):
        pair_with_truth(result, [ROOT / "README.md"])


def test_the_documents_list_the_formats():
    page = (ROOT / "docs" / "methods" / "evaluation.md").read_text("utf-8")
    listed = page.split("Formats:")[1].split(".")[0]
    assert {name.strip(" `\n") for name in listed.split(",")} == set(READABLE) | {"netcdf"}
