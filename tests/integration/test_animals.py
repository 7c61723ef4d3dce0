"""Animals are tracked with the skeleton and the commands of the documentation."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from benchmarks.animal_scenes import AnimalOptions, renamed, simulate_animals
from benchmarks.animals import OF, OWN_TOML

import posefuse
from posefuse.cli.simulate import write_scene
from posefuse.skeleton.skeletons import Skeleton, parse_skeleton
from posefuse.synthetic.crowds import CrowdScene

PAGE = (Path(__file__).parents[2] / "docs" / "animals.md").read_text()


def commands() -> list[list[str]]:
    """Those of the page, as lists of words."""
    return [shlex.split(line) for line in re.findall(r"(?m)^posefuse (reconstruct .*)$", PAGE)]


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    """Two mice that start, stop and meet, 5 s."""
    made = simulate_animals(AnimalOptions(animals=2, cameras=4, duration_s=5.0, rate_hz=30.0, seed=8))
    return renamed(made, Skeleton("own", tuple(OF)), OF)


def test_skeleton_of_the_documentation_equals_that_of_the_benchmark() -> None:
    (text,) = re.findall(r"(?s)```toml\n(.*?)```", PAGE)
    actual, second = parse_skeleton(text, "my_mouse.toml"), parse_skeleton(OWN_TOML, "my_mouse.toml")
    assert (actual.keypoints, actual.edges, actual.pairs) == (second.keypoints, second.edges, second.pairs)
    assert actual.tree is not None
    assert second.tree is not None
    assert actual.tree.size_m == second.tree.size_m


@pytest.mark.parametrize("which", [0, 1], ids=["without a skeleton", "with one"])
def test_documented_commands_track_two_mice(
    which: int, scene: CrowdScene, run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my_mouse.toml").write_text(re.findall(r"(?s)```toml\n(.*?)```", PAGE)[0])
    Path("RECORDING").mkdir()
    write_scene(scene, Path("RECORDING"))
    code, _, warned = run(*commands()[which])
    assert code == 0, warned
    result = posefuse.read_reconstruction(Path("RESULT", "reconstruction.nc"))
    assert result.person_ids == ("person_1", "person_2")
    code, _, warned = run("evaluate", "RESULT", "RECORDING/truth.nc")
    assert code == 0, warned
    scores = json.loads(Path("RESULT/evaluation.json").read_text())
    assert scores["clear"][0]["gate_m"] < 0.05
    assert scores["clear"][0]["switches"] == 0
    assert scores["recall_after_entry"] > 0.97
    assert scores["median_mm"] < 8.0


def test_evaluation_accepts_a_gate(scene: CrowdScene, run, tmp_path: Path) -> None:
    posefuse.write(scene.truth, tmp_path / "reconstruction.nc")
    code, _, warned = run("evaluate", tmp_path, tmp_path / "reconstruction.nc", "--gate-m", "0.02", "--gate-m", "0.01")
    assert code == 0, warned
    scores = json.loads((tmp_path / "evaluation.json").read_text())
    assert [each["gate_m"] for each in scores["clear"]] == [0.02, 0.01]


def test_truth_has_perfect_scores_at_any_size(scene: CrowdScene) -> None:
    from posefuse.evaluation.paired_results import people_points

    actual = posefuse.score_people(people_points(scene.truth, scene.truth))
    assert actual.clear[0].mota == 1.0
    assert np.isclose(actual.mpjpe_mm, 0.0)


def test_hind_part_of_a_mouse_does_not_turn_over() -> None:
    # Its two points lie on a line, about which no view shows its turn.
    made = simulate_animals(AnimalOptions(animals=1, cameras=3, duration_s=8.0, rate_hz=30.0, seed=1))
    options = posefuse.Options(people="many", solve="frame", layer="model")
    result = posefuse.reconstruct(made.rig, made.detections, options)
    truth = np.asarray(made.truth.layers["measured"].points_m[30:, 0])
    error_m = np.linalg.norm(np.asarray(result.layers["model"].points_m[30:, 0]) - truth, axis=-1)
    middle = made.truth.skeleton.index("spine_middle")
    assert np.nanmean(error_m[:, middle]) < 0.008
    assert result.poses is not None
    turns = np.asarray(result.poses.turns[30:, 0])
    sideways = np.einsum("fi,fi->f", turns[:, 0, :, 1], turns[:, 1, :, 1])
    assert np.nanmin(sideways) > 0.0
