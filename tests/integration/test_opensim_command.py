"""``posefuse opensim`` from a result to OpenSim's files, and the signs of all angles against OpenSim's model."""

import csv
import importlib.util
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.biomechanics.anatomy.scaled import ScaledAnatomy
from posefuse.biomechanics.coordinate_priors import moving_prior
from posefuse.biomechanics.inverse_kinematics import person_points, solve
from posefuse.biomechanics.marker_model import MarkerModel
from posefuse.io.motion_tables import read_joint_angles
from posefuse.io.opensim.model_file import write_model
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.opensim_people import flexed, model_of, recorded, walking

needs_opensim = pytest.mark.skipif(
    importlib.util.find_spec("opensim") is None,
    reason="the package opensim is not installed: pip install 'posefuse[opensim]'",
)


def rows_of(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "angles_comparison.csv").open(encoding="utf-8", newline="") as file:
        return {row["angle"]: row for row in csv.DictReader(file)}


def length_of_foot(model: Path) -> float:
    """Return the distance between the markers of heel and big toe of a model in the axes of the foot's bodies."""
    places = {
        marker.get("name"): np.array([float(number) for number in marker.findtext("location", "").split()])
        for marker in ElementTree.parse(model).getroot().iter("Marker")
    }
    return float(np.linalg.norm(places["right_big_toe"] - places["right_heel"]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("opensim")
    recorded(folder / "walk")
    return folder


@needs_opensim
def test_a_walk_is_scaled_solved_and_compared(run, folder):
    code, output, warned = run("opensim", folder / "walk", "--output", folder / "out")
    assert (code, warned) == (0, "")
    assert {file.name for file in (folder / "out").iterdir()} >= {
        "angles_comparison.csv", "anna.osim", "anna.mot", "anna.trc", "anna_ik.xml",
    }  # fmt: skip
    assert all(len(line) <= 80 for line in output.splitlines() if "/" not in line)
    found = read_joint_angles(folder / "out" / "anna.mot")
    model = model_of("halpe_26")
    true = np.degrees(walking(model))
    for name in ("hip_flexion", "knee_angle", "ankle_angle", "arm_flex", "elbow_flex"):
        for side in "rl":
            angle = f"{name}_{side}"
            error = found.degrees[:, found.angles.index(angle)] - true[:, model.anatomy.coordinate_index(angle)]
            # The person is estimated too: sizes and places of points deviate within their priors.
            assert np.abs(error - np.median(error)).max() < 2.0, angle
            assert float(rows_of(folder / "out")[angle]["rmse_deg"]) < 3.0


@needs_opensim
def test_several_results_use_their_own_static_trials(run, tmp_path):
    with_trial = recorded(tmp_path / "with_trial", static="0:4")
    recorded(tmp_path / "without")
    code, _, warned = run("opensim", tmp_path / "with_trial", tmp_path / "without", "-o", tmp_path / "out")
    assert (code, warned) == (0, "")
    found = {name: read_joint_angles(tmp_path / "out" / f"{name}_anna.mot") for name in ("with_trial", "without")}
    change = np.abs(found["with_trial"].degrees - found["without"].degrees).max(axis=0)
    assert change[found["without"].angles.index("hip_flexion_r")] > 0.1
    assert with_trial.options.subject.static == "0:4"


@needs_opensim
def test_two_people_of_two_results_get_their_own_models_and_motions(run, tmp_path):
    people, headings = ("anna", "ben"), {"walk": (70.0, -30.0), "turn": (20.0, 110.0)}
    for trial, degrees in headings.items():
        recorded(tmp_path / trial, headings_deg=degrees, people=people)
    code, _, warned = run("opensim", *(tmp_path / trial for trial in headings), "-o", tmp_path / "out")
    assert (code, warned) == (0, "")
    rotations, sizes = {}, {}
    for trial, degrees in headings.items():
        for person, heading_deg in zip(people, degrees, strict=True):
            stem = tmp_path / "out" / f"{trial}_{person}"
            assert all(stem.with_name(stem.name + end).is_file() for end in (".osim", ".trc", "_ik.xml"))
            found = read_joint_angles(stem.with_name(f"{stem.name}.mot"))
            turns = found.degrees[:, found.angles.index("pelvis_rotation")]
            rotations[trial, person] = float(np.median(turns)) - heading_deg
            sizes[trial, person] = length_of_foot(stem.with_name(f"{stem.name}.osim"))
    assert max(rotations.values()) - min(rotations.values()) < 3.0, rotations
    for trial in headings:
        assert sizes[trial, "ben"] / sizes[trial, "anna"] == pytest.approx(0.95, abs=0.02)
    with (tmp_path / "out" / "angles_comparison.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["trial"], row["person"]) for row in rows} == set(rotations)
    assert all(float(row["rmse_deg"]) < 3.0 for row in rows if row["angle"].startswith(("hip_flexion", "knee_angle")))


def test_a_static_trial_that_is_gone_is_named_before_any_file_is_written(run, tmp_path):
    pytest.importorskip("opensim", reason="the package opensim is not installed")
    recorded(tmp_path / "walk", static="gone.nc")
    code, _, warned = run("opensim", tmp_path / "walk", "-o", tmp_path / "out")
    assert code == 2
    assert "gone.nc" in warned
    assert not (tmp_path / "out").exists()


@needs_opensim
def test_a_model_of_the_user_is_scaled_in_the_same_way(run, folder):
    model = model_of("halpe_26")
    bodies = np.array([model.anatomy.body_index("pelvis")])
    unscaled = ScaledAnatomy(
        "mine", model.anatomy, model.anatomy.unscaled(), ("old",), bodies, np.zeros((1, 3)), model.anatomy.defaults
    )
    write_model(unscaled, folder / "mine.osim")
    assert run("opensim", folder / "walk", "-o", folder / "built_in")[0] == 0
    assert run("opensim", folder / "walk", "--model", folder / "mine.osim", "-o", folder / "mine")[0] == 0
    ours, theirs = (read_joint_angles(folder / name / "anna.mot") for name in ("built_in", "mine"))
    assert ours.angles == theirs.angles
    np.testing.assert_allclose(ours.degrees, theirs.degrees, atol=0.2)


@needs_opensim
def test_a_model_without_a_full_body_says_what_it_lacks(run, folder):
    (folder / "arm.osim").write_text('<OpenSimDocument Version="40500"><Model name="arm"/></OpenSimDocument>', "utf-8")
    code, _, warned = run("opensim", folder / "walk", "--model", folder / "arm.osim", "-o", folder / "arm")
    assert code == 1
    text = " ".join(warned.split())
    assert "lacks the bodies pelvis" in text
    assert "simtk.org/projects/full_body" in text
    assert not (folder / "arm").exists()


def test_without_the_extra_one_sentence_names_it(run, folder, monkeypatch):
    monkeypatch.setattr("posefuse.io.opensim.library.importlib.util.find_spec", lambda name: None)
    code, _, warned = run("opensim", folder / "walk", "-o", folder / "none")
    assert code == 1
    assert "pip install 'posefuse[opensim]'" in " ".join(warned.split())
    assert not (folder / "none").exists()


def test_an_unknown_model_names_the_choices(run, folder):
    code, _, warned = run("opensim", folder / "walk", "--model", "gait", "-o", folder / "none")
    assert code == 2
    assert "expected rajagopal or an .osim file" in " ".join(warned.split())


class TestConventions:
    """Each coordinate of OpenSim's model is recovered from markers with its sign."""

    STEP_DEG = 15.0

    def test_one_coordinate_at_a_time(self, tmp_path):
        opensim = pytest.importorskip("opensim", reason="the package opensim is not installed")
        model = model_of("coco_wholebody_133")
        anatomy, base = model.anatomy, flexed(model)
        person = ScaledAnatomy(
            "model", anatomy, model.scales, model.keypoints, model.markers.bodies, model.markers.locations_m, base
        )
        write_model(person, tmp_path / "model.osim")
        rotations = [c for c in range(len(base)) if not anatomy.is_translation[c]]
        poses = np.stack([base, *(base + np.radians(self.STEP_DEG) * np.eye(len(base))[c] for c in rotations)])
        points = np.full((len(poses), len(shipped_skeleton("coco_wholebody_133")), 3), np.nan)
        points[:, model.columns] = self.markers(opensim, tmp_path / "model.osim", model, poses)
        change = self.estimated(model, points)
        change = np.degrees(change[1:] - change[0])
        for row, c in enumerate(rotations):
            expected = self.STEP_DEG * (np.array(rotations) == c)
            error = np.abs(change[row, rotations] - expected)
            assert error[row] < 1.0, anatomy.coordinates[c]
            assert error.max() < 2.0, (anatomy.coordinates[c], anatomy.coordinates[rotations[int(error.argmax())]])

    def markers(self, opensim, path: Path, model: MarkerModel, poses: np.ndarray) -> np.ndarray:
        """Return the positions of markers in OpenSim, shape (frame, marker, 3)."""
        opensim.Logger.removeFileSink()
        theirs = opensim.Model(str(path))
        state = theirs.initSystem()
        out = np.empty((len(poses), len(model.keypoints), 3))
        for t, pose in enumerate(poses):
            for name, value in zip(model.anatomy.coordinates, pose.tolist(), strict=True):
                theirs.getCoordinateSet().get(name).setValue(state, value, False)
            theirs.realizePosition(state)
            for k, name in enumerate(model.keypoints):
                place = theirs.getMarkerSet().get(name).getLocationInGround(state)
                out[t, k] = [place.get(i) for i in range(3)]
        return out

    def estimated(self, model: MarkerModel, points: np.ndarray) -> np.ndarray:
        """Return the coordinates of exact points, with the pelvis in the axes of OpenSim's ground."""
        covariance = np.zeros((*points.shape[:2], 6))
        covariance[..., [0, 3, 5]] = 1e-8
        person = person_points(model, points, covariance, np.eye(3))
        exact = np.broadcast_to(1e8 * np.eye(3), person.information.shape).copy()
        prior = moving_prior()
        solution = solve(model, replace(person, information=exact), prior.with_habits(np.zeros(len(prior.row_sd))))
        out = solution.coordinates.copy()
        pelvis = person.world_from_person @ solution.rotations[:, model.anatomy.body_index("pelvis")]
        at = [model.anatomy.coordinate_index(f"pelvis_{name}") for name in ("tilt", "list", "rotation")]
        out[:, at] = Rotation.from_matrix(pelvis).as_euler("ZXY")
        return out
