"""Annotations and detections of MVOR."""

import numpy as np
import pytest

from posefuse import read_cameras, read_detections
from posefuse.errors import FileError
from tests.layouts import (
    operating_room,
)


class TestMvor:
    def test_poses_are_relative_to_the_first_camera(self, tmp_path):
        operating_room(tmp_path)
        rig = read_cameras(tmp_path / "camma_mvor_2018.json")
        np.testing.assert_allclose(rig.cameras[1].center_m, [1.0, 0.0, 0.0])

    def test_annotated_and_detected_people(self, tmp_path):
        operating_room(tmp_path)
        by_hand = read_detections(tmp_path / "camma_mvor_2018.json")
        assert (by_hand.view_names, by_hand.n_frames) == (("camera_1", "camera_2"), 2)
        assert by_hand.people_counts.tolist() == [[0, 0], [1, 0]]
        assert by_hand.track_ids[0] == 4
        assert np.isnan(np.asarray(by_hand.keypoints_px)[0, 1]).all()
        detected = read_detections(tmp_path / "openpose_kps.json")
        assert detected.people_counts.tolist() == [[0, 1], [0, 0]]
        (tmp_path / "camma_mvor_2018.json").unlink()
        with pytest.raises(FileError, match="must be in the same folder"):
            read_detections(tmp_path / "openpose_kps.json")
