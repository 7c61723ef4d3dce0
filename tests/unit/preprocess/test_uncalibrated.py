"""A single camera without calibration."""

import numpy as np
import pytest

import posefuse
from posefuse import Options
from posefuse.errors import CameraError, RecordingError
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.open_recording import RecordingInputs, open_recording
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.preprocess.uncalibrated import uncalibrated_camera
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate

SCENE = simulate(SceneOptions(duration_s=1.0, cameras=2))


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "one"
    folder.mkdir()
    native.write(SCENE.detections.views(SCENE.detections.view_names[:1]), folder / "keypoints.nc")
    return folder


def test_the_camera_is_marked_and_contains_all_keypoints():
    one = SCENE.detections.views(SCENE.detections.view_names[:1])
    rig = uncalibrated_camera(one)
    assert rig.names == one.view_names
    assert not rig.calibrated
    assert (np.nanmax(one.keypoints_px[:], axis=(0, 1)) < rig.cameras[0].size_px).all()
    assert "has no calibration" in rig.notes[0]
    assert uncalibrated_camera(one, (1920, 1080)).cameras[0].size_px == (1920, 1080)
    with pytest.raises(CameraError, match="2 views need a calibration"):
        uncalibrated_camera(SCENE.detections)


def test_one_camera_is_reconstructed_without_calibration(folder, tmp_path):
    """The points are those that the calibrated camera gives."""
    outcome = posefuse.reconstruct_recording(folder, tmp_path / "out")
    result = outcome.open()
    assert not result.rig.calibrated
    assert result.unit == "px"
    anipose.write(SCENE.rig, tmp_path / "calibration.toml")
    inputs = RecordingInputs(calibration=tmp_path / "calibration.toml")
    calibrated = posefuse.reconstruct_recording(folder, tmp_path / "calibrated", inputs=inputs).open()
    assert calibrated.rig.calibrated
    np.testing.assert_array_equal(result.layers["measured"].points_m, calibrated.layers["measured"].points_m)
    np.testing.assert_array_equal(result.layers["measured"].status, calibrated.layers["measured"].status)


@pytest.mark.parametrize(
    "options",
    [
        Options(triangulation=TriangulationOptions(flatten_single_view=False)), Options(people="many"),
        Options(bodies="fit"),
    ],
    ids=["depth", "people", "bodies"],
)  # fmt: skip
def test_other_options_need_a_calibration(options, folder):
    with pytest.raises(RecordingError, match="No calibrations found"):
        open_recording(folder, options=options)


def test_several_cameras_need_a_calibration(folder):
    native.write(SCENE.detections, folder / "keypoints.nc")
    with pytest.raises(RecordingError, match="No calibrations found"):
        open_recording(folder, options=Options())


def test_a_broken_calibration_is_reported(folder):
    (folder / "calibration.toml").write_text("[cam_0]\nname =")
    with pytest.raises(RecordingError, match="one calibration, which cannot be read"):
        open_recording(folder, options=Options())
