"""COCO annotations."""

import json

import pytest

from posefuse import read_detections
from posefuse.errors import FileError


def test_implausible_frame_numbers_are_an_error(tmp_path):
    people = [{"image_id": 10_010_000_001, "category_id": 1, "keypoints": [1.0, 2.0, 0.5] * 17, "score": 1.0}]
    (tmp_path / "a.json").write_text(json.dumps(people))
    with pytest.raises(FileError, match="frames are numbered up to 10010000001"):
        read_detections(tmp_path)
