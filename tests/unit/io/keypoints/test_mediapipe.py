"""MediaPipe landmarks."""

import json

import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request


class TestLandmarks:
    def test_normalized_coordinates_need_the_image_size(self, tmp_path):
        landmarks = [{"x": 0.5, "y": 0.25, "z": -0.1, "visibility": 0.9}] * 33
        (tmp_path / "a.json").write_text(json.dumps([{"pose_landmarks": landmarks}, {"pose_landmarks": None}]))
        with pytest.raises(FileError, match="`image_size="):
            read_detections(tmp_path)
        detections = read_keypoints(tmp_path, Request(image_size_px=(1000, 600)))
        assert detections.keypoints_px[0, 0].tolist() == [500.0, 150.0]
        assert detections.depth[0, 0] == -100.0
        assert detections.people_counts.tolist() == [[1], [0]]

    @pytest.mark.parametrize(("mesh", "skeleton"), [(468, "mediapipe_holistic_543"), (478, "mediapipe_holistic_553")])
    def test_hands_and_face_have_the_order_of_the_skeleton(self, tmp_path, mesh, skeleton):
        def points(n, x):
            return {"landmark": [{"x": x, "y": 10.0, "visibility": 1.0}] * n}

        frame = {
            "pose_landmarks": points(33, 100.0), "face_landmarks": points(mesh, 200.0),
            "left_hand_landmarks": points(21, 300.0), "right_hand_landmarks": points(21, 400.0),
        }  # fmt: skip
        (tmp_path / "a.json").write_text(json.dumps({"fps": 25, "frames": [frame]}))
        detections = read_detections(tmp_path)
        assert detections.skeleton.name == skeleton
        assert detections.rate_hz == 25.0
        for name, x in {"nose": 100.0, "left_hand_root": 300.0, "right_thumb_4": 400.0}.items():
            assert detections.keypoints_px[0, detections.skeleton.index(name), 0] == x
