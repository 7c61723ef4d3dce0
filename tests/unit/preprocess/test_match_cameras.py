"""Matching of views to cameras."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import MatchError, OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.view_names import plain_name
from posefuse.preprocess.match_cameras import match_views
from tests.scenes import ring, skeleton_of


def named(rig: CameraRig, *names: str) -> CameraRig:
    return CameraRig(tuple(replace(c, name=name) for c, name in zip(rig.cameras, names, strict=True)))


def views(*names: str) -> Detections:
    return Detections.from_dense(skeleton_of(17), names, np.zeros((1, len(names), 17, 2)))


class TestMatching:
    def test_equal_names_in_any_order(self):
        rig, detections, notes = match_views(named(ring(3), "a", "b", "c"), views("c", "a"), Options())
        assert rig.names == ("c", "a") == detections.view_names
        assert notes == ("1 calibrated cameras have no view and are left out: b.",)

    def test_names_alike_but_for_punctuation_and_endings(self):
        rig, _, notes = match_views(named(ring(2), "cam_01", "cam_02"), views("cam02_json", "Cam01"), Options())
        assert rig.names == ("cam_02", "cam_01")
        assert "cam02_json = cam_02, Cam01 = cam_01" in notes[0]

    def test_views_are_not_matched_by_position(self):
        with pytest.raises(
            MatchError, match=r"View '0' matches no camera by name.*Cameras: left, right.*`camera_order`"
        ):
            match_views(named(ring(2), "left", "right"), views("0", "1"), Options())

    def test_camera_order_may_name_cameras_that_a_refinement_left_out(self):
        rig = replace(named(ring(2), "left", "right"), left_out=("middle",))
        order = Options(camera_order=("right", "middle", "left"))
        rig, detections, notes = match_views(rig, views("0", "1", "2"), order)
        assert (rig.names, detections.view_names) == (("right", "left"), ("0", "2"))
        assert "were left out when the calibration was refined: 1." in notes[0]

    def test_by_camera_order(self):
        order = Options(camera_order=("right", "left"))
        rig, _, _ = match_views(named(ring(2), "left", "right"), views("0", "1"), order)
        assert rig.names == ("right", "left")

    def test_options_name_a_camera_once(self):
        with pytest.raises(OptionsError, match="camera_order must not name anything twice, got left"):
            Options(camera_order=("left", "left"))

    @pytest.mark.parametrize("order", [("left",), ("left", "rihgt")])
    def test_camera_order_must_name_each_camera_once(self, order):
        with pytest.raises(MatchError, match="camera_order must name one|Did you mean 'right'"):
            match_views(named(ring(2), "left", "right"), views("0", "1"), Options(camera_order=order))

    def test_ambiguous_names(self):
        with pytest.raises(MatchError, match=r"View 'cam1' could be any of cam_1, Cam-1"):
            match_views(named(ring(2), "cam_1", "Cam-1"), views("cam1"), Options())

    def test_two_views_of_one_camera(self):
        with pytest.raises(MatchError, match="Views cam1, cam_1_json all match camera 'cam_1'"):
            match_views(named(ring(2), "cam_1", "cam_2"), views("cam1", "cam_1_json"), Options())

    def test_cameras_are_selected_and_excluded(self):
        rig = named(ring(3), "a", "b", "c")
        chosen, detections, _ = match_views(rig, views("a", "b", "c"), Options(cameras=("c", "a")))
        assert chosen.names == ("c", "a") == detections.view_names
        chosen, detections, _ = match_views(rig, views("a", "b", "c"), Options(exclude_camera=("b",)))
        assert chosen.names == ("a", "c") == detections.view_names
        with pytest.raises(MatchError, match="No camera 'd'"):
            match_views(rig, views("a", "b", "c"), Options(exclude_camera=("d",)))
        with pytest.raises(MatchError, match="Camera 'c' is calibrated but has no view"):
            match_views(rig, views("a", "b"), Options(cameras=("c",)))
        with pytest.raises(MatchError, match="No camera is left"):
            match_views(
                rig,
                views(
                    "a",
                ),
                Options(exclude_camera=("a",)),
            )

    @pytest.mark.parametrize(
        ("name", "plain"), [("cam01_json", "cam01"), ("Cam-01_keypoints", "cam01"), ("c_keypoints_json", "c")]
    )
    def test_plain_names(self, name, plain):
        assert plain_name(name) == plain
