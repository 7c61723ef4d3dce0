"""Cameras that moved since an earlier calibration are named, and the others keep its world."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.calibration.boards.earlier import compare_with_earlier
from posefuse.model.camera_covariance import CENTER, ROTATION
from posefuse.model.cameras import rotation_from_vector
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig, unplaced


def shifted(rig, name, turn_deg, shift_m):
    """A rig after one camera was turned about its vertical axis and moved."""
    camera = rig[name]
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(np.array([0.0, np.radians(turn_deg), 0.0])) @ camera.rotation
    pose[:3, 3] = -pose[:3, :3] @ (camera.center_m + np.array([shift_m, 0.0, 0.0]))
    return replace(
        rig,
        cameras=tuple(replace(c, camera_from_world=pose) if c.name == name else c for c in rig.cameras),
        up_axis="z",
    )


@pytest.fixture(scope="module")
def truth():
    return replace(board_rig(4), up_axis="z")


@pytest.fixture(scope="module")
def new(truth):
    sizes: dict[str, tuple[int, int]] = dict.fromkeys(truth.names, SIZE_PX)
    return calibrate_board(board_detections(truth), BOARD, sizes, intrinsics=unplaced(truth)).rig


@pytest.mark.parametrize("name", ["cam_0", "cam_2"])
def test_moved_camera_is_named(name, truth, new):
    compared = compare_with_earlier(new, shifted(truth, name, 3.0, 0.08))
    (moved,) = compared.moved
    assert moved.name == name
    assert moved.turned_deg == pytest.approx(3.0, abs=0.1)
    assert moved.moved_m == pytest.approx(0.08, abs=0.005)
    assert compared.kept == tuple(each for each in truth.names if each != name)
    assert compared.rig.up_axis == "z"
    for found, true in zip(compared.rig.cameras, truth.cameras, strict=True):
        assert np.linalg.norm(found.center_m - true.center_m) < 0.003


def test_no_camera_moved(truth, new):
    compared = compare_with_earlier(new, truth)
    assert compared.moved == ()
    assert compared.kept == truth.names


def test_all_cameras_moved(truth, new):
    earlier = truth
    for k, name in enumerate(truth.names):
        earlier = shifted(earlier, name, 4.0 * k - 9.0, 0.1 * k)
    compared = compare_with_earlier(new, earlier)
    assert compared.kept == ()
    assert compared.rig is new


def test_certain_earlier_pose_is_a_prior(truth, new):
    """Earlier poses that are more certain than the new ones draw these to them."""
    tight = tuple(replace(each, matrix=each.matrix * 1e-4) for each in new.covariances)
    compared = compare_with_earlier(new, replace(truth, covariances=tight))
    before = compare_with_earlier(new, truth).rig
    name = compared.rig.covariances[0].camera
    distance = [np.linalg.norm(rig[name].center_m - truth[name].center_m) for rig in (compared.rig, before)]
    assert distance[0] <= distance[1]
    sds = [np.diag(rig.covariance(name).block((*ROTATION, *CENTER))) for rig in (compared.rig, new)]
    assert np.all(sds[0] < 0.01 * sds[1])


def test_covariance_of_all_cameras_is_that_of_the_weighted_means(truth, new):
    """Camera by camera it is that of the mean; between cameras, it follows from the weights of the new poses."""
    compared = compare_with_earlier(new, truth)
    before, after = new.covariance(), compared.rig.covariance()
    assert before is not None
    assert after is not None
    pose = (*ROTATION, *CENTER)
    # The covariance of the mean of two independent estimates is that of one times the weight of the other.
    keep = {
        name: np.linalg.solve(*(joint.block([(name, each) for each in pose]) for joint in (before, after))).T
        for name in ("cam_1", "cam_2")
    }
    pairs = [(name, each) for name in ("cam_1", "cam_2") for each in pose]
    between = before.block(pairs)[:6, 6:]
    assert np.abs(between).max() > 0.0
    found = after.block(pairs)
    assert found[:6, 6:] == pytest.approx(keep["cam_1"] @ between @ keep["cam_2"].T, rel=1e-3, abs=1e-12)
    assert np.linalg.eigvalsh(found).min() > -1e-12
