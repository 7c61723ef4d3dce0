"""``posefuse calibrate`` with the people of a recording."""

import re
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_scores import score_calibration

import posefuse
from posefuse.cli.main import main
from posefuse.cli.simulate import write_scene
from posefuse.errors import CalibrationError, OptionsError
from posefuse.io.calibration import anipose
from posefuse.model.cameras import rotation_from_vector, vector_from_rotation
from posefuse.model.options.calibration import PeopleOptions
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate


@pytest.fixture(scope="module")
def scene():
    options = SceneOptions(
        cameras=3,
        duration_s=9.0,
        rate_hz=15.0,
        activities=("walk", "turn", "reach"),
        seed=4,
    )
    return simulate(options)


@pytest.fixture(scope="module")
def folder(scene, tmp_path_factory):
    """A recording of 2D keypoints, and the lenses in another folder."""
    place = tmp_path_factory.mktemp("people")
    (place / "recording").mkdir()
    write_scene(scene, place / "recording")
    return place


@pytest.fixture(scope="module")
def result(scene):
    return posefuse.calibrate(scene.detections, intrinsics=scene.rig)


def test_poses_are_found_from_nothing(result, scene):
    score = score_calibration(result.rig, scene.rig)
    assert score.cameras == 3
    assert score.rotation_deg < 1.5
    assert score.center_m < 0.1
    assert 0.85 < score.scale < 1.18


def test_errors_are_within_the_stated_uncertainty(result, scene):
    n = len(result.rig)
    covariance = result.covariance.reshape(n, -1, n, len(result.covariance) // n)
    assert np.abs(covariance[0, :8]).max() < 1e-12
    for report in result.cameras[1:]:
        assert 0.0 < report.rotation_sd_deg < 3.0
        assert 0.0 < report.center_sd_m < 0.5
        assert abs(report.offset_s) < 4.0 * report.offset_sd_s
    score = score_calibration(result.rig, scene.rig)
    assert score.worst_rotation_deg < 5.0 * max(report.rotation_sd_deg for report in result.cameras)


def test_the_calibration_does_not_depend_on_the_number_of_processes(result, scene):
    people = PeopleOptions(jobs=2)
    assert posefuse.calibrate(scene.detections, intrinsics=scene.rig, people=people).rig == result.rig


def test_the_covariance_of_all_cameras_is_stated(result, scene):
    covariance = result.rig.covariance()
    assert [camera for camera, _ in covariance.parameters] == [name for name in result.rig.names[1:] for _ in range(6)]
    assert result.rig.covariance(result.rig.names[0]) is None
    for camera, report in zip(result.rig.cameras[1:], result.cameras[1:], strict=True):
        matrix = result.rig.covariance(camera.name).matrix
        assert np.degrees(np.sqrt(np.linalg.eigvalsh(matrix[:3, :3])[-1])) == pytest.approx(report.rotation_sd_deg)
        assert np.sqrt(np.linalg.eigvalsh(matrix[3:, 3:])[-1]) == pytest.approx(report.center_sd_m)
    unknown = posefuse.calibrate(scene.detections, people=PeopleOptions(image_size=scene.rig.cameras[0].size_px))
    for report in unknown.cameras:
        assert unknown.rig.covariance(report.name).sd("fx_px") == pytest.approx(report.focal_sd_px)
        assert unknown.rig.covariance(report.name).sd("k1") > 0.0


def test_the_world_is_the_floor_that_people_walk_on(result):
    assert result.rig.up_axis == "z"
    assert result.rig.inferred_up is not None
    heights = np.nanmedian(result.points_m[..., 2], axis=(0, 1))
    names = result.skeleton.keypoints
    assert heights[names.index("nose")] > heights[names.index("left_hip")] > heights[names.index("left_ankle")] > -0.1


@pytest.mark.long
def test_the_same_input_gives_the_same_bytes(result, scene):
    again = posefuse.calibrate(scene.detections, intrinsics=scene.rig)
    for one, other in zip(result.rig.cameras, again.rig.cameras, strict=True):
        assert np.array_equal(one.camera_from_world, other.camera_from_world)
    assert np.array_equal(result.covariance, again.covariance)


def test_the_command_writes_a_calibration_and_its_report(folder, capsys):
    output = folder / "calibration.toml"
    command = ["calibrate", str(folder / "recording"), "--intrinsics", str(folder / "recording" / "calibration.toml")]
    main([*command, "--stature-m", "1.7", "-o", str(output)])
    text = capsys.readouterr().out
    assert "3 cameras, 1 person" in text
    assert "stature of 1.7 m" in " ".join(text.split())
    assert "Filmed" not in text
    rig = posefuse.read_cameras(output)
    assert len(rig) == 3
    assert "<html" in output.with_suffix(".html").read_text("utf-8")
    with pytest.raises(SystemExit):
        main([*command, "-o", str(output)])
    assert "--overwrite" in capsys.readouterr().err


@pytest.mark.parametrize("board", [[], ["--board", "charuco:7x5,square=30mm"]])
def test_invalid_number_of_processes_is_refused(board, folder, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", str(folder / "recording"), *board, "-o", str(tmp_path / "c.toml"), "--jobs", "0"])
    assert "--jobs must be an integer of at least 1, got 0" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_still_person_is_an_error_that_says_what_to_film(scene):
    detections = scene.detections
    frozen = posefuse.Detections.from_dense(
        detections.skeleton,
        detections.view_names,
        np.repeat(detections.dense()[0][:1], 60, axis=0),
        rate_hz=15.0,
    )
    with pytest.raises(CalibrationError, match="[Ff]ilm"):
        posefuse.calibrate(frozen, intrinsics=scene.rig)


def test_options_of_the_other_kind_are_refused(scene, tmp_path):
    with pytest.raises(OptionsError, match="`every` is for calibrations by a board"):
        posefuse.calibrate(scene.detections, options=posefuse.CalibrateOptions(every=2))
    with pytest.raises(OptionsError, match="`stature_m` is for calibrations by people"):
        posefuse.calibrate(tmp_path, "charuco:7x5,square=30mm", people=PeopleOptions(stature_m=1.8))
    with pytest.raises(OptionsError, match="belong together"):
        PeopleOptions(length_m=0.4)
    with pytest.raises(OptionsError, match="both set the scale"):
        PeopleOptions(length_m=0.4, length_between=("a", "b"), stature_m=1.8)


def moved_rig(rig, turned_deg, shift_m):
    """The rig with its second camera elsewhere."""
    camera = rig.cameras[1]
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(np.array([0.0, np.radians(turned_deg), 0.0])) @ camera.rotation
    pose[:3, 3] = -pose[:3, :3] @ (camera.center_m + np.array([shift_m, 0.0, 0.0]))
    cameras = (rig.cameras[0], replace(camera, camera_from_world=pose), *rig.cameras[2:])
    return replace(rig, cameras=cameras, up_axis="z")


@pytest.mark.long
@pytest.mark.parametrize(("turned_deg", "shift_m"), [(0.0, 0.0), (3.0, 0.1)])
def test_moved_cameras_are_named_and_the_others_stay(scene, turned_deg, shift_m):
    earlier = moved_rig(scene.rig, turned_deg, shift_m)
    result = posefuse.recalibrate(scene.detections, None, earlier)
    assert result.rig.up_axis == "z"
    assert result.scale_sd == 0.0
    note = result.notes[-1]
    if not turned_deg:
        assert note == "No camera moved since the earlier calibration."
    else:
        named = re.match(r"Moved since the earlier calibration: '(\w+)' \(turned by ([\d.]+) .* by (\d+) mm\)\.$", note)
        assert named
        assert named[1] == scene.rig.names[1]
        assert float(named[2]) == pytest.approx(turned_deg, abs=1.0)
        assert float(named[3]) == pytest.approx(1000.0 * shift_m, abs=80.0)
    for name in scene.rig.names:
        turn = vector_from_rotation(result.rig[name].rotation @ scene.rig[name].rotation.T)
        is_moved = turned_deg and name == scene.rig.names[1]
        assert np.degrees(np.linalg.norm(turn)) < (1.0 if is_moved else 0.4)
        assert np.linalg.norm(result.rig[name].center_m - scene.rig[name].center_m) < (0.08 if is_moved else 0.03)


def test_an_earlier_calibration_of_another_rig_keeps_nothing(scene):
    other = replace(scene.rig, cameras=tuple(
        replace(scene.rig.cameras[v], name=name) for name, v in zip(scene.rig.names, (1, 2, 0), strict=True)
    ))  # fmt: skip
    result = posefuse.recalibrate(scene.detections, None, other)
    assert "No two cameras kept their pose" in result.notes[-1]
    assert score_calibration(result.rig, scene.rig).rotation_deg < 1.5
    named = replace(scene.rig, cameras=tuple(replace(c, name=f"x{c.name}x") for c in scene.rig.cameras))
    with pytest.raises(CalibrationError, match="image size|names none"):
        posefuse.recalibrate(scene.detections, None, named)
    with pytest.raises(OptionsError, match="scale is that of the earlier"):
        posefuse.recalibrate(scene.detections, None, other, people=PeopleOptions(stature_m=1.8))


def test_the_command_brings_a_calibration_up_to_date(scene, folder, capsys):
    earlier, output = folder / "earlier.toml", folder / "again.toml"
    scale = "The scale is set by the stature of 1.8 m, within 3.5 % (sd)."
    anipose.write(replace(moved_rig(scene.rig, 25.0, 0.4), notes=(scale,)), earlier)
    main(["calibrate", str(folder / "recording"), "--from", str(earlier), "-o", str(output)])
    text = " ".join(capsys.readouterr().out.split())
    assert f"Moved since the earlier calibration: '{scene.rig.names[1]}'" in text
    assert "The world and the scale are those of the earlier calibration." in text
    assert f"Of the earlier calibration: {scale}" in text
    assert posefuse.read_cameras(output).up_axis == "z"
    assert output.with_suffix(".html").is_file()
    again = posefuse.recalibrate(scene.detections, None, output)
    assert again.notes[-1] == "No camera moved since the earlier calibration."


KNOWN_M = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.5, 0.4, 1.2], [-0.8, -0.5, 0.6]])


def known_points(rig):
    """Points of known position in the world of the true cameras, and their places in the images."""
    return posefuse.ScenePoints(KNOWN_M, {c.name: c.project(KNOWN_M)[0] for c in rig.cameras}, "z")


def test_known_points_define_the_world_and_the_scale(result, scene):
    placed = posefuse.place_calibration(result, known_points(scene.rig))
    assert placed.rig.up_axis == "z"
    assert placed.rig.inferred_up is None
    assert placed.scale_sd < 0.02
    assert score_calibration(placed.rig, scene.rig).scale == pytest.approx(1.0, abs=0.02)
    for camera, true in zip(placed.rig.cameras, scene.rig.cameras, strict=True):
        assert np.linalg.norm(camera.center_m - true.center_m) < 0.1
    # Nothing but the world changes: the same points are seen at the same pixels.
    for before, after in zip(result.rig.cameras, placed.rig.cameras, strict=True):
        assert np.allclose(before.project(result.points_m)[0], after.project(placed.points_m)[0], equal_nan=True)
    ratio = placed.cameras[1].center_sd_m / result.cameras[1].center_sd_m
    sds = [each.rig.covariance(scene.rig.names[1]).sd("center_x_m") for each in (result, placed)]
    assert sds[1] / sds[0] == pytest.approx(ratio)
    assert "The world is that of 5 points of known position" in placed.notes[-1]


def test_points_that_do_not_define_a_world_are_refused(result, scene):
    points = known_points(scene.rig)
    one_view = replace(points, pixels={scene.rig.names[0]: points.pixels[scene.rig.names[0]]})
    with pytest.raises(CalibrationError, match="0 of the points of known position"):
        posefuse.place_calibration(result, one_view)
    with pytest.raises(CalibrationError, match="Check the order"):
        posefuse.place_calibration(result, replace(points, points_m=KNOWN_M[::-1]))
