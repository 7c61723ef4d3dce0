"""Shapes of bodies: radii follow the size of the subject."""

import numpy as np
import pytest

from posefuse.report.bodies import body_shapes
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate


def points_of(skeleton: str) -> np.ndarray:
    truth = simulate(SceneOptions(duration_s=0.5, cameras=3, skeleton=skeleton)).truth
    return np.asarray(truth.best_layer()[1].points_m[:])


@pytest.mark.parametrize("name", ["halpe_26", "body_20", "mouse_22", "coco_wholebody_133"])
def test_radii_scale_with_the_subject(name):
    skeleton, points = shipped_skeleton(name), points_of(name)
    once, twice = (body_shapes(scale * points, skeleton) for scale in (1.0, 2.0))
    radii = [np.outer(shapes["size"], shapes["radii"]) for shapes in (once, twice)]
    np.testing.assert_allclose(radii[1], 2.0 * radii[0], rtol=2e-3)
    assert (radii[0] > 0).all()
    extent = np.nanmax(np.ptp(points[0, 0], axis=0))
    assert radii[0].max() < 0.25 * extent


def test_fingers_and_faces_are_thin():
    """Fingers of 17 mm, the distance between two of them, would merge."""
    skeleton = shipped_skeleton("coco_wholebody_133")
    shapes = body_shapes(points_of("coco_wholebody_133"), skeleton)
    radii_mm = 1000 * shapes["size"][0] * np.array(shapes["radii"])
    assert shapes["fine"] == list(range(23, 133))
    assert radii_mm[shapes["fine"]].max() < 5
    assert radii_mm[skeleton.index("nose")] < 10
    assert body_shapes(points_of("halpe_26"), shipped_skeleton("halpe_26"))["fine"] == []


def test_stature_is_found_from_trunk_and_thighs():
    assert body_shapes(points_of("halpe_26"), shipped_skeleton("halpe_26"))["size"][0] == pytest.approx(1.75, abs=0.2)


def test_missing_people_and_keypoints_have_shapes():
    skeleton = shipped_skeleton("mouse_22")
    shapes = body_shapes(np.full((3, 2, len(skeleton), 3), np.nan), skeleton)
    assert len(shapes["size"]) == 2
    assert np.isfinite(shapes["radii"]).all()


def test_heads_hide_no_bones_of_animals():
    assert body_shapes(points_of("mouse_22"), shipped_skeleton("mouse_22"))["bare"] == []
    shown = body_shapes(points_of("halpe_26"), shipped_skeleton("halpe_26"))["bare"]
    names = {shipped_skeleton("halpe_26").edges[e] for e in shown}
    assert ("nose", "left_eye") in names
    assert ("neck", "left_shoulder") not in names


def test_no_ball_is_drawn_at_the_top_of_a_head_with_ears():
    skeleton = shipped_skeleton("body_25b")
    radii = dict(zip(skeleton.keypoints, body_shapes(points_of("halpe_26")[:, :, :25], skeleton)["radii"], strict=True))
    assert radii["head_top"] < 0.3 * radii["nose"]
