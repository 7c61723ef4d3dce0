"""Parquet tables of results."""

import json

import numpy as np
import pandas
import pyarrow.parquet

import posefuse
from posefuse.model.status import is_used


class TestParquet:
    def test_pandas_reads_the_rows_of_the_csv(self, layered_result, tmp_path):
        posefuse.write(layered_result, tmp_path / "p.parquet")
        posefuse.write(layered_result, tmp_path / "p.csv")
        columns = list(pandas.read_csv(tmp_path / "p.csv").columns)
        actual = pandas.read_parquet(tmp_path / "p.parquet")
        assert list(actual.columns[: len(columns)]) == columns
        row = actual.iloc[3 * 17 + 5]
        assert (row["status"], list(row["views"])) == ("not_seen", [])
        assert list(row["view_status"]) == ["unseen"] * 4
        used = is_used(np.asarray(layered_result.layers["solved"].view_status))[0, 0, 0]
        assert list(actual.iloc[0]["views"]) == [
            name for name, one in zip(layered_result.rig.names, used, strict=True) if one
        ]

    def test_metadata_contain_cameras_and_layer(self, layered_result, tmp_path):
        posefuse.write(layered_result, tmp_path / "p.parquet")
        metadata = pyarrow.parquet.read_schema(tmp_path / "p.parquet").metadata
        messages = json.loads(metadata[b"posefuse"])
        assert (messages["layer"], messages["unit"], messages["rate_hz"]) == ("solved", "m", 60.0)
        for camera, original in zip(messages["cameras"], layered_result.rig.cameras, strict=True):
            np.testing.assert_array_equal(camera["camera_from_world"], original.camera_from_world)
        assert b"[triangulation]" in metadata[b"options"]
        assert b"min_views = 2" in metadata[b"resolved_options"]
