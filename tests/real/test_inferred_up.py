"""Real recordings whose up axis is known: hidden from the inference, it is found or left unknown, never another one."""

import numpy as np
import pytest
from benchmarks import panoptic

import posefuse
from posefuse.alignment.infer_up import infer_up
from posefuse.model.cameras import CameraRig
from posefuse.model.up_axis import UpAxis
from posefuse.skeleton.skeletons import Skeleton

MAX_ERROR_DEG = 15.0


def check(points_m: np.ndarray, skeleton: Skeleton, rig: CameraRig, rate_hz: float, axis: UpAxis) -> str:
    """Return the evidence if the axis is found, else an empty text."""
    assert rig.up_axis == axis
    up, reason = infer_up([points_m], skeleton, rig.with_up(None), rate_hz)
    if up is None:
        return ""
    assert (up.axis, up.nearest_axis) == (axis, axis)
    assert up.angle_deg < min(MAX_ERROR_DEG, 2.0 * up.sd_deg)
    return reason


@pytest.mark.parametrize(
    ("recording", "people"), [("static_one_person", "one"), ("balancing_one_person", "many"), ("two_people", "many")]
)
def test_pose2sim(shared_data, recording, people):
    folder = shared_data("pose2sim")
    rig = posefuse.read_cameras(folder / "calibration" / "Calib.qca.txt")
    detections = posefuse.read_detections(folder / recording / "pose").with_rate(60.0)
    options = posefuse.Options(people=people, bodies="none", pick="largest" if people == "one" else None)
    result = posefuse.triangulate(rig, detections, options)
    points = np.asarray(result.layers["measured"].points_m)
    assert "4 of 4 cameras are level" in check(points, result.skeleton, rig, 60.0, "z")


def test_hidden_axis_is_inferred_by_the_pipeline(shared_data):
    folder = shared_data("pose2sim")
    rig = posefuse.read_cameras(folder / "calibration" / "Calib.qca.txt").with_up(None)
    detections = posefuse.read_detections(folder / "two_people" / "pose").with_rate(60.0)
    result = posefuse.reconstruct(rig, detections, posefuse.Options(people="many", bodies="none", health="off"))
    assert result.rig.up_text == "z (inferred)"


def test_panoptic_motion(shared_data):
    motion = panoptic.one_person(shared_data("panoptic_motion").parent)
    pieces = [motion.points_m[start : start + 300] for start in range(0, 7000, 500)]
    found = [check(part, motion.skeleton, motion.rig, motion.rate_hz, "-y") for part in pieces]
    # A person who stands still, before cameras of which two are on the ceiling, shows nothing.
    assert sum(map(bool, found)) >= 7


@pytest.mark.parametrize(("sequence", "known"), [("160906_band1", False), ("160906_band2", True)])
def test_panoptic_three_people(shared_data, sequence, known):
    """In the first, most people sit."""
    motion = panoptic.three_people(shared_data("panoptic_three_people").parent, sequence)
    assert bool(check(motion.points_m, motion.skeleton, motion.rig, motion.rate_hz, "-y")) == known
