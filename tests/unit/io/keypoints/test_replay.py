"""Replays: one record per camera and frame."""

import json

import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.open_recording import open_recording
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests import calibrations, keypoint_files


def test_one_file_holds_cameras_and_frames(tmp_path):
    """A scene with frames is a whole recording, also if it is larger than a calibration may be."""
    scene = simulate(SceneOptions(duration_s=0.3, cameras=3, detector=CLEAN))
    (tmp_path / "parts").mkdir()
    cameras = json.loads(calibrations.scene(scene.rig, tmp_path / "parts").read_text())["cameras"]
    replay = json.loads(keypoint_files.replay_json(scene.detections, tmp_path / "parts").read_text())
    (tmp_path / "recording").mkdir()
    del replay["notes"]
    text = json.dumps({**replay, "cameras": cameras, "notes": ["x" * 9_000_000]})
    (tmp_path / "recording" / "scene.json").write_text(text)
    opened = open_recording(tmp_path / "recording")
    assert opened.rig.names == scene.rig.names
    np.testing.assert_allclose([c.matrix for c in opened.rig.cameras], [c.matrix for c in scene.rig.cameras])
    np.testing.assert_array_equal(opened.detections.keypoints_px[:], scene.detections.keypoints_px[:])
    assert opened.detections.view_names == scene.detections.view_names


def test_list_of_frames(tmp_path):
    frames = [
        {"frame": f, "cameras": {"a": {"time_s": f / 10, "detections": [{"keypoints": [[f, 2, 0.5]] * 17}]}}}
        for f in (3, 1, 2)
    ]
    (tmp_path / "replay.json").write_text(json.dumps(frames))
    detections = read_detections(tmp_path / "replay.json", "coco_17")
    assert detections.frame_numbers.tolist() == [1, 2, 3]
    np.testing.assert_array_equal(detections.keypoints_px[:, 0, 0], [1, 2, 3])
    frames[1]["cameras"]["a"]["detections"][0]["keypoints"] = [[1.0]] * 17
    (tmp_path / "replay.json").write_text(json.dumps(frames))
    with pytest.raises(FileError, match=r"frame 1 of the list, camera 'a': expected keypoints \[x, y\]"):
        read_detections(tmp_path / "replay.json", "coco_17")
    (tmp_path / "replay.json").write_text(json.dumps(frames)[:-9])
    with pytest.raises(FileError, match="is not a valid replay.*truncated"):
        read_detections(tmp_path / "replay.json", "coco_17")


class TestRecords:
    def lines(self, path, *records):
        file = path / "r.jsonl"
        file.write_text("".join(json.dumps(record) + "\n" for record in records))
        return file

    def test_frames_are_assigned_by_time(self, tmp_path):
        start, person = 1_700_000_000_000_000_000, {"keypoints": [[1, 2, 0.5]] * 133}
        times = {"a": (0, 40, 121), "b": (3, 43, 80)}
        records = [
            {"label": name, "timestamp": start + ms * 1_000_000, "people": [person]}
            for name, several in times.items()
            for ms in several
        ]
        detections = read_detections(self.lines(tmp_path, *records))
        assert detections.skeleton.name == "coco_wholebody_133"
        assert detections.recorded.tolist() == [[True, True], [True, True], [False, True], [True, False]]
        np.testing.assert_allclose(detections.time_s[:, 0], [0.0, 0.04, np.nan, 0.121], atol=1e-9)

    @pytest.mark.parametrize(
        ("record", "words"),
        [
            ({"camera": "a", "people": []}, "neither a frame"),
            ({"camera": "a", "timestamp": "now", "people": []}, "expected a number for timestamp"),
            ({"camera": "a", "timestamp": 2, "people": [{"x": 1}]}, "a person has no keypoints"),
            ({"camera": "a", "timestamp": 2, "people": 4}, "expected a list of people"),
        ],
    )
    def test_incomplete_records_are_reported_with_their_line(self, tmp_path, record, words):
        file = self.lines(tmp_path, {"camera": "a", "timestamp": 1, "people": []}, record)
        with pytest.raises(FileError, match=f"line 2.*{words}"):
            read_detections(file)
