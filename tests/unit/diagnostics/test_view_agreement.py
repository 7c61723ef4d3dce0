"""Agreement of calibration and keypoints."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.diagnostics.view_agreement import coincidence_finding
from posefuse.errors import PosefuseWarning
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, ring, simulate_detections


@pytest.mark.parametrize("cameras", [3, 5, 8])
@pytest.mark.parametrize("sigma_px", [2.0, 15.0])
def test_noise_is_not_reported_as_disagreement(cameras, sigma_px, rng):
    rig = ring(cameras)
    result = reconstruct(rig, simulate_detections(rig, body_points(rng, 40), rng, sigma_px))
    assert not any("do not agree" in note for note in result.provenance.notes)


@pytest.mark.parametrize("cameras", [3, 5, 8])
def test_wrong_camera_order_is_reported_as_disagreement(cameras, rng):
    rig = ring(cameras)
    detections = simulate_detections(rig, body_points(rng, 40), rng)
    wrong = Options(camera_order=tuple(reversed(rig.names)))
    with pytest.warns(PosefuseWarning, match="The views do not agree"):
        reconstruct(rig, detections, wrong)


def test_cameras_with_the_same_position_are_reported():
    rig = ring(4)
    assert coincidence_finding(rig) is None
    assert coincidence_finding(ring(1)) is None
    copy = replace(rig.cameras[0], name="copy")
    finding = coincidence_finding(CameraRig((*rig.cameras, copy)))
    assert finding is not None
    assert "'cam_0' and 'copy'" in finding


def test_close_cameras_are_not_reported():
    pose = np.eye(4)
    pose[0, 3] = -0.06
    first = ring(1).cameras[0]
    stereo = [Camera(n, first.size_px, first.matrix, p) for n, p in (("left", np.eye(4)), ("right", pose))]
    assert coincidence_finding(CameraRig(tuple(stereo))) is None


def test_camera_that_contradicts_the_others_is_named(rng):
    rig = ring(5)
    detections = simulate_detections(rig, body_points(rng, 60), rng)
    pixels = np.asarray(detections.keypoints_px).reshape(60, 5, 17, 2).copy()
    pixels[:, 3] += rng.uniform(50, 200, (60, 17, 2))
    wrong = Detections.from_dense(detections.skeleton, rig.names, pixels, rate_hz=60.0)
    with pytest.warns(PosefuseWarning, match=r"detections of camera 'cam_3' \(100 %\) contradict"):
        reconstruct(rig, wrong)
