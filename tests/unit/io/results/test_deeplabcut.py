"""DeepLabCut 3D results."""

import warnings

import numpy as np
import pandas
import pytest

import posefuse


class TestDeepLabCut:
    def test_pandas_reads_one_and_several_people(self, layered_result, pair_result, tmp_path):
        for original, layer, levels in ((layered_result, "solved", 3), (pair_result, "measured", 4)):
            points = np.asarray(original.layers[layer].points_m)
            for name in ("a.h5", "a.csv"):
                posefuse.write(original, tmp_path / name, "deeplabcut", overwrite=True)
            h5 = pandas.read_hdf(tmp_path / "a.h5")
            text = pandas.read_csv(tmp_path / "a.csv", header=list(range(levels)), index_col=0)
            names = ["scorer", "individuals", "bodyparts", "coords"]
            assert list(h5.columns.names) == [name for name in names if name != "individuals" or levels == 4]
            rows = original.frame_numbers - original.frame_numbers[0]
            np.testing.assert_array_equal(h5.to_numpy()[rows].reshape(points.shape), points)
            np.testing.assert_array_equal(text.to_numpy(), h5.to_numpy())
            assert list(text.columns) == list(h5.columns)
            assert list(h5.index) == list(range(original.frame_numbers[0], original.frame_numbers[-1] + 1))
        assert h5["posefuse_measured", "ben", "tail"].shape == (len(h5), 3)

    @pytest.mark.parametrize("layout", ["fixed", "table"])
    def test_files_written_by_pandas_are_read(self, layout, tmp_path):
        levels = [["net"], ["nose", "paw"], ["x", "y", "z"]]
        columns = pandas.MultiIndex.from_product(levels, names=["scorer", "bodyparts", "coords"])
        values = np.random.default_rng(0).normal(size=(5, 6))
        table = pandas.DataFrame(values, columns=columns, index=np.arange(5))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table.to_hdf(tmp_path / "mouse.h5", key="df_with_missing", mode="w", format=layout)
        points = posefuse.read_points(tmp_path / "mouse.h5")
        assert (points.keypoints, points.person_ids) == (("nose", "paw"), ("mouse",))
        np.testing.assert_array_equal(points.points_m.reshape(5, 6), values)
