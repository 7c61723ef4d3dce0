"""Folders of results."""

import csv
import warnings
from dataclasses import replace

import c3d
import ezc3d
import numpy as np
import pytest

import posefuse
from posefuse.io.results import trc
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.csv import ANGLE_COLUMNS, columns
from posefuse.io.results.write import write_folder
from posefuse.model.joint_angles import WITHIN_95, AngleStatus, JointAngles
from posefuse.model.track_events import Event
from tests.properties.test_result_files import some_result


def rows_of(path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def angles_of(result) -> JointAngles:
    """Return arbitrary angles of a result, some of which are missing."""
    shape = np.asarray(result.poses.nis).shape
    degrees = np.random.default_rng(0).uniform(-90.0, 90.0, (*shape, 2)).astype(np.float32)
    status = np.zeros(degrees.shape, dtype=np.int8)
    status[3:6, 1, 1] = AngleStatus.NOT_OBSERVED
    status[5:, 3] = AngleStatus.ABSENT
    degrees[status != AngleStatus.OK] = np.nan
    pelvis = np.zeros((*shape, 3))
    return JointAngles(
        ("elbow_bend", "knee_bend"), ("keypoints",) * 2, "model", degrees, degrees * 0 + 2, status, pelvis
    )


class TestFolder:
    @pytest.fixture
    def folder(self, crowd_result, tmp_path):
        result = replace(crowd_result, joint_angles=angles_of(crowd_result))
        files, layer, _ = write_folder(result, tmp_path)
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
            np.testing.assert_allclose(points.reshape(expected.shape), expected, rtol=0.0, atol=5.001e-6)
            assert {row["source"] for row in rows} == {"", "measured" if layer == "measured" else "modeled"}

    def test_events(self, crowd_result, folder):
        rows = rows_of(folder / "events.csv")
        assert list(rows[0]) == ["frame", "time_s", "person", "what", "why"]
        actual = tuple(Event(int(r["frame"]), float(r["time_s"]), r["person"], r["what"], r["why"]) for r in rows)
        assert actual == crowd_result.events
        assert any("," in event.why for event in actual)

    def test_angles_are_tidy_and_missing_is_empty(self, crowd_result, folder):
        rows = rows_of(folder / "angles.csv")
        assert tuple(rows[0]) == ANGLE_COLUMNS
        angles = angles_of(crowd_result)
        present = angles.status != AngleStatus.ABSENT
        assert not present.all()
        assert len(rows) == present.sum()
        assert [row["angle"] for row in rows[:3]] == ["elbow_bend", "knee_bend", "elbow_bend"]
        assert [row["person"] for row in rows[:5:2]] == ["person_1", "person_2", "person_3"]
        degrees = np.array([float(row["degrees"] or "nan") for row in rows])
        np.testing.assert_allclose(degrees, angles.degrees[present], atol=6e-4)
        assert np.isnan(degrees).any()
        low, high = (np.array([float(row[f"{end}_degrees"] or "nan") for row in rows]) for end in ("low", "high"))
        np.testing.assert_allclose(high - low, 2.0 * WITHIN_95 * angles.sd_deg[present], atol=3e-3)
        assert {row["status"] for row in rows} == {"ok", "not_observed"}
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
