"""Scale of the world: bone lengths of people, and the stated size of animals."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.diagnostics.world_scale import scale_finding
from posefuse.errors import PosefuseWarning
from posefuse.skeleton.skeletons import find_skeleton, parse_skeleton
from posefuse.skeleton.trees import ADULT_M
from tests.scenes import ring, simulate_detections

MOUSE = """
name = "mouse"
keypoints = ["nose", "ear_l", "ear_r", "neck", "tail"]
edges = [["nose", "neck"], ["ear_l", "neck"], ["ear_r", "neck"], ["neck", "tail"]]
[tree]
size_m = 0.09
"""
SHAPE = np.array([[0.0, 0.0, 0.0], [0.01, 0.01, 0.0], [0.01, -0.01, 0.0], [0.02, 0.0, 0.01], [0.08, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("factor", "meters_per_unit", "unit"), [(1000.0, 1.0, "mm"), (100.0, 1.0, "cm"), (0.001, 0.001, "m")]
)
def test_bodies_of_another_size_than_stated_name_the_unit(factor, meters_per_unit, unit):
    points = factor * np.tile(SHAPE, (20, 1, 1, 1))
    finding = scale_finding([points], parse_skeleton(MOUSE, "mouse.toml"), meters_per_unit)
    assert finding is not None
    assert f"bodies measure {0.0831 * factor:.3g} m" in finding.sentence
    assert f"is probably in {unit}: add `length_unit={unit!r}`." in finding.remedy
    assert finding.is_certain


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_bodies_of_about_the_stated_size_are_accepted(factor):
    assert scale_finding([factor * np.tile(SHAPE, (20, 1, 1, 1))], parse_skeleton(MOUSE, "mouse.toml"), 1.0) is None


def test_bodies_with_few_keypoints_and_skeletons_without_a_size_are_not_judged():
    points = 1000.0 * np.tile(SHAPE, (20, 1, 1, 1))
    points[:, :, 2:] = np.nan
    assert scale_finding([points], parse_skeleton(MOUSE, "mouse.toml"), 1.0) is None
    without = replace(parse_skeleton(MOUSE, "mouse.toml"), tree=None)
    assert scale_finding([1000.0 * np.tile(SHAPE, (20, 1, 1, 1))], without, 1.0) is None


def test_people_are_judged_by_their_bones():
    skeleton = find_skeleton("coco_17")
    points = np.full((20, 17, 3), np.nan)
    for a, b, low, high in skeleton.plausible_m:
        points[:, skeleton.index(a)] = 0.0
        points[:, skeleton.index(b)] = [1000.0 * np.sqrt(low * high), 0.0, 0.0]
    finding = scale_finding([points], skeleton, 1.0)
    assert finding is not None
    assert "add `length_unit='mm'`" in finding.remedy
    assert finding.is_certain


@pytest.mark.parametrize(("factor", "certain"), [(1.3, False), (10.0, True), (0.05, True)])
def test_bodies_of_an_unusual_size_are_no_certain_fault(factor, certain):
    """Children and giants exist; a tree without a size has that of an adult, which a mouse is not."""
    skeleton = find_skeleton("coco_17")
    points = np.full((20, 17, 3), np.nan)
    for a, b, _, high in skeleton.plausible_m:
        points[:, skeleton.index(a)] = 0.0
        points[:, skeleton.index(b)] = [factor * high, 0.0, 0.0]
    finding = scale_finding([points], skeleton, 1.0)
    assert finding is not None
    assert finding.is_certain == certain
    without_size = parse_skeleton(MOUSE.replace("size_m = 0.09", f"size_m = {ADULT_M}"), "mouse.toml")
    finding = scale_finding([np.tile(SHAPE, (20, 1, 1, 1))], without_size, 1.0)
    assert finding is not None
    assert not finding.is_certain


@pytest.mark.parametrize("people", ["one", "many"])
def test_reconstruction_in_wrong_units_warns(rng, people):
    # A mouse in front of cameras whose positions are in mm, read as m.
    move = np.stack([20.0 * np.sin(np.arange(90) / 15.0), np.zeros(90), np.full(90, 900.0)], axis=1)
    points = 1000.0 * SHAPE + move[:, None]
    rig = ring(4)
    cameras = []
    for camera in rig.cameras:
        pose = camera.camera_from_world.copy()
        pose[:3, 3] *= 1000.0
        cameras.append(replace(camera, camera_from_world=pose))
    rig = replace(rig, cameras=tuple(cameras))
    detections = replace(simulate_detections(rig, points, rng, 0.2), skeleton=parse_skeleton(MOUSE, "mouse.toml"))
    with pytest.warns(PosefuseWarning) as warned:
        posefuse.reconstruct(rig, detections, posefuse.Options(people=people))
    texts = [str(each.message) for each in warned]
    assert any(text.startswith("The scale is wrong for this skeleton") for text in texts)
    assert any("`length_unit='mm'`" in text for text in texts)
