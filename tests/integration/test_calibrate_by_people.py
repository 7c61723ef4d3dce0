"""``posefuse calibrate`` with the people of a recording."""

import numpy as np
import pytest
from benchmarks.calibration_scores import score_calibration

import posefuse
from posefuse.cli.main import main
from posefuse.cli.simulate import write_scene
from posefuse.errors import CalibrationError, OptionsError
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


def test_the_world_is_the_floor_that_people_walk_on(result):
    assert result.rig.up_axis == "z"
    assert result.rig.inferred_up is not None
    heights = np.nanmedian(result.points_m[..., 2], axis=(0, 1))
    names = result.skeleton.keypoints
    assert heights[names.index("nose")] > heights[names.index("left_hip")] > heights[names.index("left_ankle")] > -0.1


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
