"""Calibration by a board: true cameras are recovered within their intervals, and missing information is named."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.errors import CalibrationError
from posefuse.model.camera_covariance import CENTER, ROTATION
from posefuse.model.cameras import LensModel, vector_from_rotation
from posefuse.model.detections import Detections
from tests.boards import BOARD, RATE_HZ, SIZE_PX, board_detections, board_rig, unplaced


def sizes(rig):
    return dict.fromkeys(rig.names, SIZE_PX)


def relative(rig, v):
    """Camera v in the coordinates of camera 0."""
    return rig.cameras[v].camera_from_world @ np.linalg.inv(rig.cameras[0].camera_from_world)


def differences(found, truth, v):
    """Rotation (rad) and center (m) of camera v, found minus true, in the world of camera 0."""
    a, b = relative(found, v), relative(truth, v)
    turn = vector_from_rotation(a[:3, :3] @ b[:3, :3].T)
    return np.concatenate([turn, -a[:3, :3].T @ a[:3, 3] + b[:3, :3].T @ b[:3, 3]])


def test_poses_with_known_lenses():
    rig = board_rig()
    result = calibrate_board(board_detections(rig), BOARD, sizes(rig), intrinsics=unplaced(rig))
    assert result.error_px == pytest.approx(0.2 * np.sqrt(2), rel=0.1)
    assert abs(result.distances.error) < 5e-4
    for v in (1, 2):
        error = differences(result.rig, rig, v)
        assert np.degrees(np.linalg.norm(error[:3])) < 0.05
        assert np.linalg.norm(error[3:]) < 1e-3
        assert np.all(np.abs(error) < 5.0 * np.sqrt(np.diag(result.covariance[v])[:6]))
        assert result.rig.cameras[v].matrix == pytest.approx(rig.cameras[v].matrix)


@pytest.mark.parametrize("lens", [LensModel.BROWN, LensModel.FISHEYE])
def test_lenses_are_estimated_and_chosen(lens):
    rig = board_rig(2, lens)
    result = calibrate_board(board_detections(rig, n_frames=80), BOARD, sizes(rig))
    assert result.error_px < 0.35
    for v, camera in enumerate(result.rig.cameras):
        sd = np.sqrt(np.diag(result.covariance[v]))
        assert abs(camera.matrix[0, 0] - rig.cameras[v].matrix[0, 0]) < 5.0 * sd[6]
        assert sd[6] < 10.0
        grid = np.stack(np.meshgrid(np.linspace(440, 840, 5), np.linspace(260, 460, 4)), axis=-1)
        rays = rig.cameras[v].rays(grid)[0]
        moved = replace(camera, camera_from_world=np.eye(4)).project(rays)[0] - grid
        # A shift of the principal point is a rotation of the camera.
        assert np.abs(moved - moved.mean(axis=(0, 1))).max() < 1.0


@pytest.mark.parametrize("offset_s", [0.02, -0.07])
def test_time_offsets_are_found(offset_s):
    rig = board_rig()
    detections = board_detections(rig, offset_s=(0.0, offset_s, 0.0), n_frames=80)
    result = calibrate_board(detections, BOARD, sizes(rig), intrinsics=unplaced(rig))
    found, sd = result.cameras[1].offset_s, result.cameras[1].offset_sd_s
    assert found == pytest.approx(offset_s, abs=0.004)
    assert 0.0 < sd < 0.004
    assert result.cameras[2].offset_s == pytest.approx(0.0, abs=0.004)
    assert result.error_px < 0.4


def test_images_too_far_apart_for_the_motion_of_the_board_state_no_time_offset():
    rig = board_rig(2)
    slow = board_detections(rig, n_frames=20).with_rate(1.0)
    result = calibrate_board(slow, BOARD, sizes(rig), intrinsics=unplaced(rig))
    assert result.cameras[0].offset_sd_s == 0.0
    assert result.cameras[1].offset_s == 0.0
    assert np.isnan(result.cameras[1].offset_sd_s)
    assert np.all(result.covariance[1] < 1.0)
    assert any("'cam_1' are too far apart in time" in note for note in result.notes)


@pytest.mark.parametrize("offset_s", [-0.15, 0.12])
def test_poses_that_only_a_late_camera_sees_do_not_diverge(offset_s):
    """Their velocity follows from those of their neighbors, which it is part of."""
    rig = board_rig()
    detections = board_detections(rig, offset_s=(0.0, offset_s, 0.0), n_frames=40)
    pixels = detections.dense()[0].copy()
    pixels[:3, [0, 2]] = np.nan
    pixels[:3, 1, 9:] = np.nan
    detections = Detections.from_dense(BOARD.skeleton, rig.names, pixels, rate_hz=RATE_HZ)
    result = calibrate_board(detections, BOARD, sizes(rig), intrinsics=unplaced(rig))
    assert result.solution.model.errors_px().max() < 2.0
    assert result.error_px == pytest.approx(0.2 * np.sqrt(2), rel=0.05)
    assert result.cameras[1].offset_s == pytest.approx(offset_s, abs=0.004)


def test_result_does_not_depend_on_the_order_of_cameras():
    rig = board_rig()
    detections = board_detections(rig)
    order = ("cam_2", "cam_0", "cam_1")
    one = calibrate_board(detections, BOARD, sizes(rig), intrinsics=unplaced(rig))
    other = calibrate_board(detections.views(order), BOARD, sizes(rig), intrinsics=unplaced(rig))
    for v in (1, 2):
        assert np.abs(differences(other.rig.select(rig.names), one.rig, v)).max() < 1e-4


def test_origin_frame_defines_the_world():
    rig = board_rig()
    result = calibrate_board(board_detections(rig), BOARD, sizes(rig), intrinsics=unplaced(rig), origin_frame=7)
    assert result.rig.up_axis == "z"
    for v in (1, 2):
        assert np.linalg.norm(differences(result.rig, rig, v)[3:]) < 1e-3
    model = result.solution.model
    corner = model.rig.cameras[0].project(model.origins_m[7])[0]
    assert result.rig.cameras[0].project(np.zeros(3))[0] == pytest.approx(corner)
    with pytest.raises(CalibrationError, match="closest frame is 59"):
        calibrate_board(board_detections(rig), BOARD, sizes(rig), intrinsics=unplaced(rig), origin_frame=99)


def test_outliers_do_not_move_the_cameras():
    rig, rng = board_rig(), np.random.default_rng(1)
    detections = board_detections(rig)
    pixels = detections.dense()[0]
    wrong = rng.random(pixels.shape[:3]) < 0.02
    pixels[wrong] += rng.normal(0.0, 40.0, (int(wrong.sum()), 2))
    spoiled = Detections.from_dense(BOARD.skeleton, rig.names, pixels, rate_hz=RATE_HZ)
    result = calibrate_board(spoiled, BOARD, sizes(rig), intrinsics=unplaced(rig))
    for v in (1, 2):
        assert np.linalg.norm(differences(result.rig, rig, v)[3:]) < 2e-3


def test_what_is_missing_is_named():
    rig = board_rig(4)
    detections = board_detections(rig)
    pixels = detections.dense()[0]

    def without(change):
        changed = pixels.copy()
        change(changed)
        return Detections.from_dense(BOARD.skeleton, rig.names, changed, rate_hz=RATE_HZ)

    def blind(p):
        p[:, 2] = np.nan

    def apart(p):
        p[:30, :2] = np.nan
        p[30:, 2:] = np.nan

    def empty(p):
        p[:] = np.nan

    def rare(p):
        p[3:, 1] = np.nan

    lenses = unplaced(rig)
    for change, lens, message in (
        (blind, lenses, "Camera 'cam_2' never shows the board"),
        (apart, lenses, "2 groups that never see the board together: cam_0, cam_1 and cam_2, cam_3"),
        (empty, lenses, "No image shows the board"),
        (rare, None, "Camera 'cam_1' shows the board in 3 images"),
    ):
        with pytest.raises(CalibrationError, match=message):
            calibrate_board(without(change), BOARD, sizes(rig), intrinsics=lens)


def test_stated_covariance_is_in_the_axes_of_the_camera():
    """A forward shift of a camera and its standard deviation do not depend on the world."""
    rig = board_rig()
    detections = board_detections(rig)
    one, other = (
        calibrate_board(detections, BOARD, sizes(rig), intrinsics=unplaced(rig), origin_frame=frame).rig
        for frame in (None, 7)
    )
    assert len(one.covariances) == 2
    for a, b in zip(one.covariances, other.covariances, strict=True):
        assert a.parameters == (*ROTATION, *CENTER)
        assert np.array_equal(a.matrix, b.matrix)
        error = relative_errors(one, rig, a)
        assert np.all(np.abs(error) < 5.0 * np.sqrt(np.diag(a.matrix)))


def relative_errors(found, truth, covariance):
    """Errors of a camera relative to the reference, about and along its own axes."""
    at = found.index(covariance.camera), found.index(covariance.reference)
    a, b = (
        r.cameras[at[0]].camera_from_world @ np.linalg.inv(r.cameras[at[1]].camera_from_world) for r in (found, truth)
    )
    turn = vector_from_rotation(a[:3, :3] @ b[:3, :3].T)
    return np.concatenate([turn, a[:3, :3] @ (-a[:3, :3].T @ a[:3, 3] + b[:3, :3].T @ b[:3, 3])])


def test_estimated_lens_has_a_covariance():
    rig = board_rig(2)
    result = calibrate_board(board_detections(rig), BOARD, sizes(rig), lens=LensModel.BROWN)
    first, second = result.rig.covariances
    assert (len(first.parameters), len(second.parameters)) == (9, 15)
    assert first.parameters[-5:] == ("k1", "k2", "p1", "p2", "k3")
    assert second.sd("fx_px") == pytest.approx(result.cameras[result.rig.index(second.camera)].focal_sd_px)


def test_time_offsets_can_be_disabled():
    rig = board_rig()
    detections = board_detections(rig, offset_s=(0.0, 0.05, 0.0))
    fixed = calibrate_board(detections, BOARD, sizes(rig), intrinsics=unplaced(rig), clocks="synchronized")
    assert [report.offset_s for report in fixed.cameras] == [0.0, 0.0, 0.0]
    free = calibrate_board(detections, BOARD, sizes(rig), intrinsics=unplaced(rig))
    assert free.held_out.rms_px < 0.6 * fixed.held_out.rms_px


def test_no_combination_of_parameters_is_exact_in_a_short_recording():
    """With fewer periods than parameters, the covariance of the variation between periods is singular."""
    rig = board_rig()
    covariance = calibrate_board(board_detections(rig, n_frames=12), BOARD, sizes(rig)).rig.covariance()
    assert len(covariance.parameters) == 3 * 9 + 2 * 6
    assert np.array_equal(covariance.matrix, covariance.matrix.T)
    sd = np.sqrt(np.diag(covariance.matrix))
    assert np.linalg.eigvalsh(covariance.matrix / sd / sd[:, None])[0] > 1e-8
