"""Replays: one record per camera and frame."""

import json

import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import FileError


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
