"""Records of one camera and time."""

import numpy as np

from posefuse import read_detections
from posefuse.io.stream import lines_of
from tests.example_detections import example_detections


def test_saved_lines_of_a_stream_give_the_detections(tmp_path):
    original = example_detections(2).with_rate(10.0)
    path = tmp_path / "lines.jsonl"
    path.write_bytes(b"".join(line for _, line in lines_of(original)))
    detections = read_detections(path, original.skeleton)
    assert detections.view_names == original.view_names
    assert np.isnan(original.keypoints_px).any()
    np.testing.assert_array_equal(detections.offsets, original.offsets)
    np.testing.assert_array_equal(detections.keypoints_px, original.keypoints_px)
    np.testing.assert_array_equal(detections.confidence, original.confidence)
    np.testing.assert_array_equal(detections.track_ids, original.track_ids)
