"""SLEAP project files."""

import json
from typing import Any

import h5py
import numpy as np
import pytest
import sleap_io

from posefuse import read_detections
from posefuse.errors import FileError
from tests import keypoint_files
from tests.layouts import SCENE


def test_manual_instance_replaces_the_prediction_that_it_corrects(tmp_path):
    skeleton = sleap_io.Skeleton(nodes=["a", "b"], edges=[("a", "b")])
    video = sleap_io.Video(filename="cam.mp4", open_backend=False)
    guess = sleap_io.PredictedInstance.from_numpy(np.array([[1.0, 2], [3, 4]]), skeleton, point_scores=np.ones(2))
    hand = sleap_io.Instance.from_numpy(np.array([[5.0, 6], [7, 8]]), skeleton)
    hand.from_predicted = guess
    frame = sleap_io.LabeledFrame(video=video, frame_idx=2, instances=[guess, hand])
    sleap_io.save_file(sleap_io.Labels([frame]), tmp_path / "x.slp", verbose=False)
    detections = read_detections(tmp_path / "x.slp")
    np.testing.assert_array_equal(detections.keypoints_px[:], [[[5, 6], [7, 8]]])
    assert np.isnan(detections.confidence[:]).all()
    assert detections.skeleton.edges == (("a", "b"),)


def as_the_browser_writes(file, *, with_number):
    """Store tables as matrices, of integers for frames, with the names of the columns, like luc3d in the browser."""
    with h5py.File(file, "r+") as content:
        for name in ("frames", "instances", "points", "pred_points"):
            table: Any = np.asarray(content[name])
            del content[name]
            kind = np.int64 if name == "frames" else np.float64
            matrix = np.array([list(row) for row in table.tolist()], dtype=kind)
            content[name] = matrix.reshape(len(table), len(table.dtype.names))
            content[name].attrs["field_names"] = json.dumps(table.dtype.names)
        if not with_number:
            del content["metadata"].attrs["format_id"]


def test_files_without_the_number_of_their_layout_are_read_as_the_newest(tmp_path):
    expected = read_detections(keypoint_files.slp(SCENE.detections, tmp_path / "expected"))
    file = keypoint_files.slp(SCENE.detections, tmp_path / "browser")
    as_the_browser_writes(file, with_number=False)
    before = file.read_bytes()
    with pytest.raises(Exception, match="format_id"):
        sleap_io.load_file(str(file))
    detections = read_detections(file)
    np.testing.assert_array_equal(detections.keypoints_px[:], expected.keypoints_px[:])
    np.testing.assert_array_equal(detections.confidence[:], expected.confidence[:])
    assert detections.view_names == expected.view_names
    assert detections.skeleton == expected.skeleton
    assert detections.notes == (
        *expected.notes, "labels.slp: the number of the layout (format_id) is missing; read as the newest layout.",
    )  # fmt: skip
    assert file.read_bytes() == before


def test_a_stated_layout_is_read_without_a_note(tmp_path):
    file = keypoint_files.slp(SCENE.detections, tmp_path)
    as_the_browser_writes(file, with_number=True)
    assert not any("layout" in note for note in read_detections(file).notes)


def test_errors_name_the_file_without_a_number(tmp_path):
    file = keypoint_files.slp(SCENE.detections, tmp_path)
    as_the_browser_writes(file, with_number=False)
    with h5py.File(file, "r+") as content:
        del content["points"]
        del content["instances"]
    with pytest.raises(FileError) as caught:
        read_detections(file)
    assert str(file) in str(caught.value)
    assert str(caught.value).count(".slp") == 1
