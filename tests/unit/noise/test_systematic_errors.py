"""Cameras with a systematic error, and the points of recordings with one of them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from benchmarks import motions
from benchmarks.walking import observe
from scipy.spatial.transform import Rotation

from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.rigs import build_rig

_WRONG = 2

pytestmark = pytest.mark.filterwarnings("ignore::posefuse.errors.PosefuseWarning")


@cache
def _scene(views, seed):
    points_m = motions.figure_at(np.arange(240) / 30.0, ("walk",), seed)
    data = observe(build_rig("ring", views), points_m, np.random.default_rng(seed))
    return motions.with_lasting_noise(replace(data, rate_hz=30.0), seed)


def _misplaced(rig, turn_deg=0.0, shift_m=0.0) -> CameraRig:
    move = np.eye(4)
    move[:3, :3] = Rotation.from_euler("y", turn_deg, degrees=True).as_matrix()
    move[0, 3] = shift_m
    cameras = list(rig.cameras)
    cameras[_WRONG] = replace(cameras[_WRONG], camera_from_world=move @ cameras[_WRONG].camera_from_world)
    return CameraRig(tuple(cameras))


def _solve(rig, detections) -> Reconstruction:
    return reconstruct(rig, detections, Options(people="one", bodies="none", health="off"))


def _error_mm(data, result) -> float:
    error_m = np.linalg.norm(np.asarray(result.layers["solved"].points_m)[:, 0] - data.points_m, axis=-1)
    return 1e3 * float(np.nanmedian(error_m))


@cache
def _error_without_mm(views, seed):
    data = _scene(views, seed)
    names = tuple(name for i, name in enumerate(data.rig.names) if i != _WRONG)
    return _error_mm(data, _solve(data.rig.select(names), data.detections.views(names)))


@pytest.mark.parametrize("views", [4, 5])
@pytest.mark.parametrize(
    ("turn_deg", "shift_m"), [(0.5, 0.0), (1.0, 0.0), (2.0, 0.0), (5.0, 0.0), (10.0, 0.0), (0.0, 0.05), (0.0, 0.2)]
)
def test_misplaced_camera_makes_points_no_worse_than_the_other_cameras_do(views, turn_deg, shift_m):
    data = _scene(views, 0)
    result = _solve(_misplaced(data.rig, turn_deg, shift_m), data.detections)
    assert _error_mm(data, result) < 1.05 * _error_without_mm(views, 0)


def test_no_labels_of_a_wrong_camera_are_swapped_and_it_is_not_used():
    data = _scene(5, 0)
    result = _solve(_misplaced(data.rig, turn_deg=5.0), data.detections)
    assert result.noise is not None
    np.testing.assert_array_equal(result.noise.is_used, np.arange(5) != _WRONG)
    status = np.asarray(result.layers["measured"].view_status)
    assert (status == ViewStatus.USED_SWAPPED).mean(axis=(0, 1, 2))[_WRONG] < 0.01
    assert (status == ViewStatus.OUTLIER).mean(axis=(0, 1, 2))[_WRONG] > 0.9
    assert any("cam_2" in note and "are not used" in note for note in result.provenance.notes)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_intact_cameras_keep_equal_noise(seed):
    data = _scene(5, seed)
    noise = _solve(data.rig, data.detections).noise
    assert noise is not None
    assert np.ptp(noise.scale_px) == 0.0


def test_points_of_two_of_five_views_show_no_systematic_error():
    data = _scene(5, 0)
    detections = data.detections
    view = np.repeat(np.tile(np.arange(5), detections.n_frames), np.diff(detections.offsets))
    keypoints = np.array(detections.keypoints_px)
    keypoints[view > 1] = np.nan
    result = _solve(data.rig, replace(detections, keypoints_px=keypoints))
    assert (result.noise.scale_px == result.noise.scale_px[0]).all()
