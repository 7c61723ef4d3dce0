"""Objects describe themselves in a few lines, and results convert to tables, datasets and figures."""

import re

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, OptionsError
from posefuse.model.findings import Finding, FindingKind
from posefuse.synthetic.gait_plans import WalkPlan, walk
from posefuse.synthetic.gait_scenes import GaitSceneOptions, simulate_gait

PLAN = WalkPlan(strides=2, start_m=(-1.0, 0.0))


@pytest.fixture(scope="module")
def scene():
    return simulate_gait(walk(PLAN), PLAN.duration_s, GaitSceneOptions(seed=1, rate_hz=60.0))


@pytest.fixture(scope="module")
def result(scene):
    return posefuse.reconstruct(scene.rig, scene.detections, posefuse.Options(health="off"))


FINDING = Finding(FindingKind.TIME_OFFSET, ("cam_1",), None, 0.1, "s", 0.01, 0.99, 5.0, "cam_1 is late.", "Use sync.")


def test_descriptions_are_short(scene, result):
    things = (
        result,
        result.layers["solved"],
        result.joint_angles,
        scene.rig,
        scene.detections,
        result.skeleton,
        posefuse.Options(),
        FINDING,
    )
    for thing in things:
        lines = repr(thing).splitlines()
        assert len(lines) <= 13
        assert max(map(len, lines)) <= 80
        html = thing._repr_html_()
        assert re.sub(r"<[^>]*>", "", html).startswith(lines[0].split(":")[0].split(" ")[0])
    assert "2 subjects" not in repr(result)
    assert "solved (default)" in repr(result)
    assert f"{len(result.provenance.notes)} in provenance.notes" in repr(result)
    assert repr(result.joint_angles).startswith(f"JointAngles: {len(result.joint_angles.names)} angles")
    assert repr(result).splitlines()[0].endswith("26 keypoints, 5 cameras")


def test_options_show_what_differs_from_the_defaults():
    assert repr(posefuse.Options()) == "Options: all defaults"
    text = repr(posefuse.Options(contact="off", tracker=posefuse.TrackerOptions(max_people=3)))
    assert text.splitlines()[1:] == ["  tracker.max_people 3", "  contact     off"]


def test_a_dataset_holds_the_points_and_angles(result):
    pytest.importorskip("xarray")
    dataset = result.to_xarray("measured")
    points = np.asarray(result.layers["measured"].points_m)
    assert np.array_equal(dataset.position.to_numpy(), points, equal_nan=True)
    assert dataset.position.attrs["units"] == "m"
    assert dataset.position.dims == ("time", "individual", "keypoint", "space")
    knee = dataset.joint_angle.sel(angle="knee_angle_r").isel(individual=0)
    assert knee.shape == (result.n_frames,)


def test_a_table_has_a_row_per_point(result):
    pytest.importorskip("pandas")
    table = result.to_dataframe()
    assert len(table) == result.n_frames * len(result.person_ids) * len(result.skeleton)
    row = table[(table.frame == 10) & (table.keypoint == "left_knee")].iloc[0]
    point = result.best_layer()[1].points_m[10, 0, result.skeleton.index("left_knee")]
    assert [row.x_m, row.y_m, row.z_m] == pytest.approx(point)


@pytest.mark.parametrize("figure", ["trajectories", "angles", "errors"])
def test_figures(result, figure):
    pytest.importorskip("matplotlib")
    assert result.plot(figure).axes


def test_unknown_figures_are_refused(result):
    with pytest.raises(OptionsError, match="unknown figure 'angle'"):
        result.plot("angle")


def test_a_rig_draws_itself(scene):
    pytest.importorskip("matplotlib")
    (axes,) = scene.rig.plot().axes
    assert {text.get_text() for text in axes.texts} == set(scene.rig.names)


def test_the_report_is_shown_in_a_frame(result):
    page = result.view(500)
    assert page._repr_html_().startswith("<iframe")
    assert "height:500px" in page._repr_html_()
    assert len(repr(page)) < 80


@pytest.mark.parametrize("name", ["cameras.toml", "cameras.qca.txt"])
def test_cameras_are_written_by_the_ending(scene, tmp_path, name):
    posefuse.write_cameras(scene.rig, tmp_path / name)
    again = posefuse.read_cameras(tmp_path / name)
    assert again.names == scene.rig.names
    for ours, theirs in zip(scene.rig.cameras, again.cameras, strict=True):
        assert theirs.camera_from_world == pytest.approx(ours.camera_from_world, abs=1e-6)


def test_unknown_endings_and_formats_are_refused(scene, tmp_path):
    with pytest.raises(FileError, match=r"anipose"):
        posefuse.write_cameras(scene.rig, tmp_path / "cameras.docx")
    with pytest.raises(FileError, match="named 'blender'"):
        posefuse.write_cameras(scene.rig, tmp_path / "cameras.toml", form="blender")
