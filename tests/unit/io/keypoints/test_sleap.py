"""SLEAP analysis files: one file per camera."""

import json

import h5py
import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError
from tests import keypoint_files
from tests.example_detections import example_detections

PARTS = ("nose", "ear_L", "ear_R", "tail")


def write_sleap(file, pixels, scores):
    """Write pixels (track, frame, node, 2) and scores (track, frame, node)."""
    with h5py.File(file, "w") as content:
        content["tracks"] = pixels.transpose(0, 3, 2, 1)
        content["point_scores"] = scores.transpose(0, 2, 1)
        content["node_names"] = np.array([part.encode() for part in PARTS])
        content["edge_inds"] = np.array([[0, 1], [0, 2], [0, 3]])


def test_sleap_survives_a_round_trip_with_tracks(tmp_path, rng):
    pixels = rng.uniform(1, 500, (2, 6, 4, 2))
    pixels[1, 3:] = np.nan
    scores = rng.uniform(0.2, 1.0, (2, 6, 4))
    for camera in ("top", "side"):
        (tmp_path / camera).mkdir()
        write_sleap(tmp_path / camera / "mouse.analysis.h5", pixels, scores)
    detections = posefuse.read_detections(tmp_path)
    assert detections.view_names == ("side", "top")
    assert detections.skeleton.edges == (("nose", "ear_L"), ("nose", "ear_R"), ("nose", "tail"))
    np.testing.assert_array_equal(detections.people_counts, [[2, 2]] * 3 + [[1, 1]] * 3)
    np.testing.assert_array_equal(np.asarray(detections.keypoints_px)[1], pixels[1, 0])
    np.testing.assert_array_equal(np.asarray(detections.confidence)[1], scores[1, 0])
    assert set(np.asarray(detections.track_ids).tolist()) == {0, 1}


def test_truncated_file_of_one_camera_is_an_error(tmp_path, rng):
    for camera in ("side", "top"):
        (tmp_path / camera).mkdir()
        write_sleap(tmp_path / camera / "mouse.analysis.h5", rng.uniform(1, 9, (1, 5, 4, 2)), np.ones((1, 5, 4)))
    cut = tmp_path / "top" / "mouse.analysis.h5"
    cut.write_bytes(cut.read_bytes()[:1000])
    with pytest.raises(FileError, match=r"top.*1000 bytes.*truncated"):
        posefuse.read_detections(tmp_path)


def test_analysis_files_whose_axes_are_named(tmp_path):
    """sleap-io uses another order of axes, which the shape does not reveal for two animals."""
    folder = keypoint_files.sleap(example_detections(), tmp_path / "usual")
    usual = posefuse.read_detections(folder)
    for file in folder.iterdir():
        with h5py.File(file, "a") as content:
            for name, order, dims in (
                ("tracks", (3, 0, 2, 1), ["frame", "track", "node", "xy"]),
                ("point_scores", (2, 0, 1), ["frame", "track", "node"]),
            ):
                values = np.asarray(content[name]).transpose(order)
                del content[name]
                content[name] = values
                content[name].attrs["dims"] = json.dumps(dims)
    assert posefuse.read_detections(folder) == usual
