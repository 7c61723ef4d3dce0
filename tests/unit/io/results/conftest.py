"""Results that tests of several formats write."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.reconstruct import reconstruct
from tests.people import simulate_walkers, track_perfectly
from tests.properties.test_result_files import some_result
from tests.scenes import body_points, ring, simulate_detections


@pytest.fixture
def frame_result(rng) -> Reconstruction:
    """Nine frames; one keypoint is missing in frame 3, one has two views, one view lacks a frame."""
    rig = ring(4, "barrel")
    detections = simulate_detections(rig, body_points(rng, 9), rng, rate_hz=60.0)
    keypoints = np.array(detections.keypoints_px)
    keypoints[3 * 4 : 3 * 4 + 4, 5] = np.nan
    keypoints[2 * 4 : 2 * 4 + 2, 7] = np.nan
    options = Options(solve="frame", triangulation=TriangulationOptions(min_views=2))
    return reconstruct(rig, replace(detections, keypoints_px=keypoints), options)


@pytest.fixture(scope="module")
def crowd_scene():
    return simulate_walkers()


@pytest.fixture(scope="module")
def crowd_result(crowd_scene) -> Reconstruction:
    return track_perfectly(crowd_scene)


@pytest.fixture(scope="module")
def layered_result() -> Reconstruction:
    """Nine frames of one person, a keypoint missing in frame 3; measured, and a second layer a centimeter off."""
    rng = np.random.default_rng(1)
    rig = ring(4, "barrel")
    detections = simulate_detections(rig, body_points(rng, 9), rng, rate_hz=60.0)
    keypoints = np.array(detections.keypoints_px)
    keypoints[3 * 4 : 3 * 4 + 4, 5] = np.nan
    result = reconstruct(rig, replace(detections, keypoints_px=keypoints), Options(solve="frame"))
    measured = result.layers["measured"]
    solved = replace(measured, points_m=np.asarray(measured.points_m) + 0.01)
    return replace(result, layers={"measured": measured, "solved": solved})


@pytest.fixture(scope="module")
def pair_result() -> Reconstruction:
    """Two pair_result, numbers of any kind."""
    return some_result(3, ["anna", "ben"], ["nose", "tail", "left_paw", "right_paw"], ["a", "b"], 6)
