"""Replays and records are read by ranges of frames, and files that change meanwhile raise an error."""

import json

import numpy as np
import pytest

import posefuse
from posefuse.errors import DetectionsError, FileError
from posefuse.io.keypoints import replay
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.example_detections import example_detections
from tests.keypoint_files import WRITERS


def written(tmp_path):
    scene = simulate(SceneOptions(skeleton="coco_17", duration_s=1.0, cameras=3))
    replay.write(scene.detections, tmp_path / "replay.jsonl")
    return scene.detections, tmp_path / "replay.jsonl"


def test_ranges_in_any_order_equal_the_whole_file(tmp_path):
    original, path = written(tmp_path)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([lines[0], *reversed(lines[1:])]))
    detections = posefuse.read_detections(path)
    for start, stop in ((20, 30), (0, 5), (3, 4), (7, 7), (0, original.n_frames)):
        assert detections.frames(start, stop) == original.frames(start, stop)
    rows = np.array([17, 3, -1, 40])
    np.testing.assert_array_equal(detections.keypoints_px[rows], np.asarray(original.keypoints_px)[rows])
    np.testing.assert_array_equal(detections.confidence[5:9], np.asarray(original.confidence)[5:9])


def test_returned_arrays_are_copies(tmp_path):
    _, path = written(tmp_path)
    detections = posefuse.read_detections(path)
    detections.keypoints_px[0:10][:] = 0.0
    assert not (detections.keypoints_px[0:10] == 0.0).any()


@pytest.mark.parametrize("name", ["replay_lines", "payload_lines", "payload_arrays"])
def test_file_that_changes_while_it_is_read_is_an_error(name, tmp_path):
    path = WRITERS[name](example_detections(), tmp_path)
    file = next(iter(sorted(path.iterdir()))) if path.is_dir() else path
    detections = posefuse.read_detections(path, "coco_17")
    detections.frames(0, 1)
    file.write_bytes(b" " * file.stat().st_size)
    with pytest.raises(FileError, match=file.name):
        detections.frames(0, detections.n_frames)


@pytest.mark.parametrize(("number", "words"), [("1e400", "out of range|infinite"), ("-3", "must be positive")])
def test_impossible_numbers_are_refused_when_the_file_is_opened(number, words, tmp_path):
    frame = {"frame": 0, "cameras": {"a": {"detections": [{"keypoints": [[1.0, 2.0]] * 17, "sigma_px": ["X"] * 17}]}}}
    (tmp_path / "replay.jsonl").write_text(json.dumps(frame).replace('"X"', number) + "\n")
    with pytest.raises((FileError, DetectionsError), match=words):
        posefuse.read_detections(tmp_path / "replay.jsonl")
