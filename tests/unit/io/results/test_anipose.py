"""Anipose results."""

from dataclasses import replace

import numpy as np
import pandas

import posefuse
from posefuse.model.alignment import Alignment


class TestAnipose:
    def test_world_transform_restores_calibrated_coordinates(self, layered_result, tmp_path):
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        alignment = Alignment(turn, np.array([0.5, -0.25, 1.0]), 1.1)
        before = np.asarray(layered_result.layers["measured"].points_m)[:, 0]
        layer = replace(layered_result.layers["measured"], points_m=alignment.points(before)[:, None])
        rig = replace(layered_result.rig, meters_per_unit=0.001)
        posefuse.write(
            replace(layered_result, rig=rig, alignment=alignment, layers={"measured": layer}), tmp_path / "anipose.csv"
        )
        table = pandas.read_csv(tmp_path / "anipose.csv")
        matrix = np.array([[table[f"M_{i}{j}"][0] for j in range(3)] for i in range(3)])
        center = np.array([table[f"center_{i}"][0] for i in range(3)])
        nose = table[["nose_x", "nose_y", "nose_z"]].to_numpy()
        # As Anipose's project-3d does it: to the calibration's own unit, here millimeters.
        np.testing.assert_allclose((nose + center) @ np.linalg.inv(matrix.T), 1000.0 * before[:, 0], rtol=1e-9)

    def test_columns_are_those_of_anipose(self, layered_result, tmp_path):
        posefuse.write(layered_result, tmp_path / "anipose.csv")
        table = pandas.read_csv(tmp_path / "anipose.csv")
        assert list(table.columns[:6]) == [f"nose_{kind}" for kind in ("x", "y", "z", "error", "ncams", "score")]
        assert list(table["fnum"]) == list(range(9))
        assert np.isnan(table["left_shoulder_ncams"][3])
        assert table["nose_ncams"][0] == layered_result.layers["solved"].n_views[0, 0, 0]

    def test_anipose_file_is_read(self, tmp_path):
        header = "a_b_x,a_b_y,a_b_z,a_b_error,a_b_ncams,a_b_score,"
        header += ",".join([*(f"M_{i}{j}" for i in range(3) for j in range(3)), "center_0,center_1,center_2", "fnum"])
        rest = "1,0,0,0,1,0,0,0,1,0,0,0"
        (tmp_path / "fly.csv").write_text(f"{header}\n1,2,3,0.5,2.0,0.9,{rest},0\n,,,,,,{rest},1\n")
        points = posefuse.read_points(tmp_path / "fly.csv")
        assert (points.keypoints, points.person_ids, points.unit, points.layer) == (("a_b",), ("fly",), "", "")
        np.testing.assert_array_equal(points.points_m[:, 0, 0], [[1, 2, 3], [np.nan] * 3])
        np.testing.assert_array_equal(points.n_views, [[[2]], [[0]]])
