"""Folders of results."""

import csv
import warnings

import c3d
import ezc3d
import numpy as np
import pytest

import posefuse
from posefuse.io.results import trc
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.csv import columns
from posefuse.io.results.write import write_folder
from posefuse.model.track_events import Event
from tests.properties.test_result_files import some_result


def rows_of(path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


class TestFolder:
    @pytest.fixture
    def folder(self, crowd_result, tmp_path):
        names = ("elbow_bend", "knee_bend")

        def angles(part):
            return names, np.asarray(part.poses.directions)[..., 0] * 90, np.asarray(part.poses.angle_sd_deg)

        files, layer, _ = write_folder(crowd_result, tmp_path, angles=angles)
        people = [f"person_{i}.{form}" for i in range(1, 5) for form in ("trc", "c3d")]
        assert files == ["keypoints.csv", "model.csv", "events.csv", "angles.csv", *people]
        assert layer == "model"
        return tmp_path

    def test_each_layer_has_the_same_columns(self, crowd_result, folder):
        for name, layer in (("keypoints.csv", "measured"), ("model.csv", "model")):
            rows = rows_of(folder / name)
            assert tuple(rows[0]) == columns("m")
            points = np.array([[float(row[f"{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
            expected = crowd_result.layers[layer].points_m
            np.testing.assert_array_equal(points.reshape(expected.shape), expected)
            assert {row["source"] for row in rows} == {"", "measured" if layer == "measured" else "modeled"}

    def test_events(self, crowd_result, folder):
        rows = rows_of(folder / "events.csv")
        assert list(rows[0]) == ["frame", "time_s", "person", "what", "why"]
        actual = tuple(Event(int(r["frame"]), float(r["time_s"]), r["person"], r["what"], r["why"]) for r in rows)
        assert actual == crowd_result.events
        assert any("," in event.why for event in actual)

    def test_angles_are_tidy_and_missing_is_empty(self, crowd_result, folder):
        rows = rows_of(folder / "angles.csv")
        assert list(rows[0]) == ["frame", "time_s", "person", "angle", "degrees", "sd_degrees", "layer"]
        assert [row["angle"] for row in rows[:3]] == ["elbow_bend", "knee_bend", "elbow_bend"]
        assert [row["person"] for row in rows[:9:2]] == ["person_1", "person_2", "person_3", "person_4", "person_1"]
        degrees = np.array([float(row["degrees"] or "nan") for row in rows])
        expected = np.asarray(crowd_result.poses.directions)[..., 0] * 90
        np.testing.assert_array_equal(degrees.reshape(expected.shape), expected)
        assert np.isnan(degrees).any()
        sds = np.array([float(row["sd_degrees"] or "nan") for row in rows])
        np.testing.assert_array_equal(sds, crowd_result.poses.angle_sd_deg.ravel())
        assert "nan" not in (folder / "angles.csv").read_text()

    def test_person_who_leaves_and_returns(self, crowd_result, folder):
        expected = np.asarray(crowd_result.layers["model"].points_m)[:, 3]
        present = np.isfinite(expected[..., 0])
        away = ~present.any(axis=1)
        assert 0 < away.sum() < len(away)
        table = trc.read(folder / "person_4.trc")
        np.testing.assert_allclose(table.points_m, expected @ y_up_from_world("z").T, atol=5e-7)
        content = ezc3d.c3d(str(folder / "person_4.c3d"))["data"]
        np.testing.assert_array_equal(content["meta_points"]["residuals"][0].T < 0, ~present)
        with (folder / "person_4.c3d").open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            frames = [points for _, points, _ in c3d.Reader(file).read_frames()]
        assert all((frames[f][:, 3] == -1).all() for f in np.flatnonzero(away))
        np.testing.assert_allclose(frames[0][present[0], :3], 1000 * expected[0][present[0]], atol=1e-2)


def test_names_of_people_do_not_leave_the_folder(tmp_path):
    names = ["../../x", "/etc/x", "a/b"]
    original = some_result(3, names, ["nose", "tail", "left_paw", "right_paw"], ["a", "b"], 6)
    (tmp_path / "in" / "out").mkdir(parents=True)
    files, *_ = write_folder(original, tmp_path / "in" / "out")
    assert [file.name for file in tmp_path.rglob("*") if file.is_file() and file.parent.name != "out"] == []
    assert sorted(files) == sorted(file.name for file in (tmp_path / "in" / "out").iterdir())
    assert {"_.._x.trc", "_etc_x.trc", "a_b.trc", "_.._x.c3d"} <= set(files)
    assert posefuse.read_points(tmp_path / "in" / "out" / "keypoints.csv").person_ids == tuple(names)
