"""Cameras and rigs: valid values and error messages."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.errors import CameraError, MatchError
from posefuse.model.cameras import (
    Camera,
    CameraRig,
    LensModel,
    lens_from_opencv,
    rotation_from_vector,
    vector_from_rotation,
)
from tests.scenes import MATRIX, camera_with, ring


def camera(**changes) -> Camera:
    numbers = {"name": "left", "size_px": (1920, 1080), "matrix": MATRIX, "camera_from_world": np.eye(4)}
    return Camera(**(numbers | changes))


def pose_with(rotation) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = rotation
    return pose


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"matrix": np.diag([0.0, 1000.0, 1.0])}, ["'left'", "focal lengths must be positive", "0 and 1000"]),
        ({"matrix": np.eye(4)}, ["3 x 3", "(4, 4)"]),
        ({"matrix": MATRIX.T}, ["upper triangular", "transposed"]),
        ({"matrix": MATRIX * np.nan}, ["not finite"]),
        ({"camera_from_world": np.eye(3)}, ["4 x 4", "(3, 3)"]),
        (
            {"camera_from_world": pose_with(np.diag([1.0, 1.0, -1.0]))},
            ["matrix is not a proper rotation", "determinant is -1"],
        ),
        ({"camera_from_world": pose_with(1.01 * np.eye(3))}, ["matrix is not a proper rotation", "0.02"]),
        ({"camera_from_world": np.full((4, 4), np.nan)}, ["finite"]),
        ({"size_px": (0, 1080)}, ["two positive whole numbers", "0 x 1080"]),
        ({"size_px": (1920.5, 1080)}, ["whole numbers"]),
        ({"size_px": 3}, ["width and height"]),
        ({"lens": LensModel.FISHEYE, "distortion": (0.1,)}, ["fisheye lens has 4", "got 1"]),
        ({"lens": LensModel.BROWN, "distortion": (0.1, np.inf, 0, 0, 0)}, ["must be finite"]),
        ({"lens": "fishy"}, ["unknown lens model 'fishy'", "fisheye"]),
        ({"camera_from_world": LensModel.BROWN}, ["camera_from_world must be an array of numbers"]),
        ({"matrix": "K"}, ["matrix must be an array of numbers"]),
    ],
)
def test_invalid_cameras_are_refused_with_a_reason(changes, words):
    with pytest.raises(CameraError) as error:
        camera(**changes)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(("rotation", "translation"), [(np.zeros(4), np.zeros(3)), (np.eye(3), np.zeros(2))])
def test_opencv_pose_has_three_or_nine_and_three_numbers(rotation, translation):
    with pytest.raises(CameraError, match="got shapes"):
        Camera.from_opencv("c", (640, 480), np.diag([500.0, 500.0, 1.0]), (), rotation, translation)


def test_arrays_of_a_camera_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        camera().matrix[0, 0] = 1.0


def test_center_and_pose_agree():
    pose = ring(3).cameras[1].camera_from_world
    one = camera(camera_from_world=pose)
    np.testing.assert_allclose(pose @ [*one.center_m, 1.0], [0, 0, 0, 1], atol=1e-12)


def test_cameras_are_equal_by_their_numbers():
    assert camera() == camera()
    assert camera() != camera(name="right")
    assert camera() != "camera"


@pytest.mark.parametrize(
    ("coefficients", "fisheye", "lens", "kept"),
    [
        ((), False, LensModel.PINHOLE, ()),
        ((0, 0, 0, 0, 0), False, LensModel.PINHOLE, ()),
        ((0.1, 0.2, 0.3, 0.4), False, LensModel.BROWN, (0.1, 0.2, 0.3, 0.4, 0.0)),
        ((0.1, 0, 0, 0, 0, 0, 0, 0), False, LensModel.BROWN, (0.1, 0, 0, 0, 0)),
        ((0.1, 0, 0, 0, 0, 0.5, 0, 0), False, LensModel.RATIONAL, (0.1, 0, 0, 0, 0, 0.5, 0, 0)),
        ((0.1, 0.2, 0.3, 0.4), True, LensModel.FISHEYE, (0.1, 0.2, 0.3, 0.4)),
        ((), True, LensModel.FISHEYE, (0, 0, 0, 0)),
        ((0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0), False, LensModel.BROWN, (0.1, 0, 0, 0, 0)),
    ],
)
def test_lens_models_follow_from_opencvs_coefficients(coefficients, fisheye, lens, kept):
    assert lens_from_opencv("c", coefficients, fisheye=fisheye) == (lens, kept)


@pytest.mark.parametrize(("coefficients", "fisheye"), [((0.1,) * 3, False), ((0.1,) * 12, False), ((0.1,) * 5, True)])
def test_unknown_numbers_of_coefficients_are_refused(coefficients, fisheye):
    with pytest.raises(CameraError, match="coefficients"):
        lens_from_opencv("c", coefficients, fisheye=fisheye)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi])
def test_rodrigues_vectors_and_matrices(angle, rng):
    axis = rng.normal(size=3)
    vector = angle * axis / np.linalg.norm(axis)
    matrix = rotation_from_vector(vector)
    np.testing.assert_allclose(matrix, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rotation_from_vector(vector_from_rotation(matrix)), matrix, atol=1e-12)


class TestRig:
    def test_names_must_be_unique(self):
        with pytest.raises(CameraError, match="repeats cam"):
            CameraRig((camera_with("pinhole"), camera_with("barrel")), source="c.toml")

    def test_rig_needs_cameras(self):
        with pytest.raises(CameraError, match=r"at least one camera; c\.toml has none"):
            CameraRig((), source="c.toml")

    def test_up_axis_must_be_valid(self):
        with pytest.raises(CameraError, match="'up' is not an axis"):
            CameraRig(ring(2).cameras, up_axis="up")  # type: ignore[arg-type]

    def test_cameras_are_selected_by_name(self):
        rig = ring(3)
        assert rig["cam_1"] is rig.cameras[1]
        assert rig.select(["cam_2", "cam_0"]).names == ("cam_2", "cam_0")
        with pytest.raises(MatchError, match=r"No camera 'cam1'.*Did you mean 'cam_1'"):
            rig.index("cam1")

    @pytest.mark.parametrize("shape", [(), (4,), (4, 2), (4, 5, 2), (1,), (0, 2)])
    def test_projection_has_the_view_after_the_frame(self, shape, rng):
        rig = ring(3)
        points = rng.uniform(-0.5, 0.5, (*shape, 3))
        pixels = rig.project(points)
        assert pixels.shape == (*shape[:1], 3, *shape[1:], 2)
        for v, camera in enumerate(rig.cameras):
            np.testing.assert_array_equal(pixels[:, v] if shape else pixels[v], camera.project(points)[0])
