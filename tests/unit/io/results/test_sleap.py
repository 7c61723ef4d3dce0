"""SLEAP Anipose results."""

import h5py
import numpy as np

import posefuse


class TestSleap:
    def test_tracks_are_those_of_sleap_anipose(self, pair_result, tmp_path):
        posefuse.write(pair_result, tmp_path / "points3d.h5")
        points = np.asarray(pair_result.layers["measured"].points_m)
        with h5py.File(tmp_path / "points3d.h5") as file:
            tracks = file["tracks"][:]
        assert tracks.shape == (pair_result.frame_numbers[-1] - pair_result.frame_numbers[0] + 1, 2, 4, 3)
        np.testing.assert_array_equal(tracks[pair_result.frame_numbers - pair_result.frame_numbers[0]], points)

    def test_sleap_anipose_file_is_read(self, tmp_path):
        points = np.random.default_rng(0).normal(size=(4, 2, 3, 3))
        with h5py.File(tmp_path / "points3d.h5", "w") as file:
            file["tracks"] = points
        actual = posefuse.read_points(tmp_path / "points3d.h5")
        assert actual.keypoints == ("node_0", "node_1", "node_2")
        np.testing.assert_array_equal(actual.points_m, points)
