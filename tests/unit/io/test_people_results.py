"""Results of several people as files: everything comes back, and each person has their own."""

import csv
import warnings
from dataclasses import fields, replace

import c3d
import ezc3d
import h5py
import numpy as np
import pytest

import posefuse
from posefuse.arrays import same
from posefuse.io.netcdf import CHUNK_FRAMES, StoredArray, skeleton_from_text, skeleton_text
from posefuse.io.results import netcdf, trc
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.csv import columns
from posefuse.io.results.write import write_folder
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.track_events import Event
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.people import crowd, followed, without_people


@pytest.fixture(scope="module")
def scene():
    return crowd()


@pytest.fixture(scope="module")
def result(scene) -> Reconstruction:
    return followed(scene)


def rows_of(path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


class TestNetcdf:
    @pytest.mark.parametrize("size", [9, 17, 1000])
    def test_everything_comes_back(self, size, result, tmp_path):
        netcdf.write(result.chunks(size), tmp_path / "r.nc")
        found = posefuse.read_reconstruction(tmp_path / "r.nc")
        assert found == result
        assert isinstance(found.poses.turns, StoredArray)
        assert found.frames(3, 20) == result.frames(3, 20)

    def test_ranges_that_know_all_events_say_each_once(self, result, tmp_path):
        parts = [replace(part, events=result.events) for part in result.chunks(10)]
        netcdf.write(parts, tmp_path / "r.nc")
        assert posefuse.read_reconstruction(tmp_path / "r.nc").events == result.events
        assert Reconstruction.concatenate(parts) == result

    def test_without_poses_and_events_it_still_reads(self, result, tmp_path):
        bare = replace(result, poses=None, events=())
        netcdf.write(bare.chunks(), tmp_path / "r.nc")
        assert posefuse.read_reconstruction(tmp_path / "r.nc") == bare

    def test_results_from_before_angles_had_sds(self, result, tmp_path):
        netcdf.write(result.chunks(), tmp_path / "r.nc")
        with h5py.File(tmp_path / "r.nc", "a") as file:
            file.move("pose_angle_sd", "other")
        poses = posefuse.read_reconstruction(tmp_path / "r.nc").poses
        assert poses.angles == ()
        assert poses.angle_sd_deg.shape == (result.n_frames, len(result.person_ids), 0)

    def test_a_body_without_segments(self, result, tmp_path):
        poses = result.poses
        stick = replace(poses, segments=(), turns=poses.turns[:, :, :0])
        netcdf.write(replace(result, poses=stick).chunks(), tmp_path / "r.nc")
        assert posefuse.read_reconstruction(tmp_path / "r.nc").poses == stick

    @pytest.mark.parametrize("name", ["body_20", "coco_wholebody_133", "h36m_17"])
    def test_the_tree_of_a_skeleton_comes_back(self, name):
        tree = shipped_skeleton(name).tree
        found = skeleton_from_text(skeleton_text(shipped_skeleton(name))).tree
        for field in fields(tree):
            mine, theirs = getattr(tree, field.name), getattr(found, field.name)
            assert same(mine, theirs), field.name
        assert all(same(mine, theirs) for mine, theirs in zip(tree.packed, found.packed, strict=True))

    def test_poses_are_packed_like_layers(self, result, tmp_path):
        netcdf.write(result.chunks(), tmp_path / "r.nc")
        with h5py.File(tmp_path / "r.nc") as file:
            for name in ("measured_position", "pose_turn", "pose_direction"):
                assert file[name].chunks[0] == CHUNK_FRAMES
                assert file[name].compression == "gzip"

    def test_nobody(self, scene, tmp_path):
        empty = without_people(scene)
        netcdf.write(empty.chunks(10), tmp_path / "r.nc")
        assert posefuse.read_reconstruction(tmp_path / "r.nc") == empty
        (tmp_path / "out").mkdir()
        assert write_folder(empty, tmp_path / "out")[0] == ["keypoints.csv", "model.csv"]


class TestFolder:
    @pytest.fixture
    def folder(self, result, tmp_path):
        names = ("elbow_bend", "knee_bend")

        def angles(part):
            return names, np.asarray(part.poses.directions)[..., 0] * 90, np.asarray(part.poses.angle_sd_deg)

        files, layer = write_folder(result, tmp_path, angles=angles)
        people = [f"person_{i}.{form}" for i in range(1, 5) for form in ("trc", "c3d")]
        assert files == ["keypoints.csv", "model.csv", "events.csv", "angles.csv", *people]
        assert layer == "model"
        return tmp_path

    def test_each_layer_has_the_same_columns(self, result, folder):
        for name, layer in (("keypoints.csv", "measured"), ("model.csv", "model")):
            rows = rows_of(folder / name)
            assert tuple(rows[0]) == columns("m")
            points = np.array([[float(row[f"{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
            expected = result.layers[layer].points_m
            np.testing.assert_array_equal(points.reshape(expected.shape), expected)
            assert {row["source"] for row in rows} == {"", "measured" if layer == "measured" else "modeled"}

    def test_events(self, result, folder):
        rows = rows_of(folder / "events.csv")
        assert list(rows[0]) == ["frame", "time_s", "person", "what", "why"]
        found = tuple(Event(int(r["frame"]), float(r["time_s"]), r["person"], r["what"], r["why"]) for r in rows)
        assert found == result.events
        assert any("," in event.why for event in found)

    def test_angles_are_tidy_and_missing_is_empty(self, result, folder):
        rows = rows_of(folder / "angles.csv")
        assert list(rows[0]) == ["frame", "time_s", "person", "angle", "degrees", "sd_degrees", "layer"]
        assert [row["angle"] for row in rows[:3]] == ["elbow_bend", "knee_bend", "elbow_bend"]
        assert [row["person"] for row in rows[:9:2]] == ["person_1", "person_2", "person_3", "person_4", "person_1"]
        degrees = np.array([float(row["degrees"] or "nan") for row in rows])
        expected = np.asarray(result.poses.directions)[..., 0] * 90
        np.testing.assert_array_equal(degrees.reshape(expected.shape), expected)
        assert np.isnan(degrees).any()
        sds = np.array([float(row["sd_degrees"] or "nan") for row in rows])
        np.testing.assert_array_equal(sds, result.poses.angle_sd_deg.ravel())
        assert "nan" not in (folder / "angles.csv").read_text()

    def test_somebody_who_goes_and_comes_back(self, result, folder):
        expected = np.asarray(result.layers["model"].points_m)[:, 3]
        there = np.isfinite(expected[..., 0])
        away = ~there.any(axis=1)
        assert 0 < away.sum() < len(away)
        table = trc.read(folder / "person_4.trc")
        np.testing.assert_allclose(table.points_m, expected @ y_up_from_world("z").T, atol=5e-7)
        content = ezc3d.c3d(str(folder / "person_4.c3d"))["data"]
        np.testing.assert_array_equal(content["meta_points"]["residuals"][0].T < 0, ~there)
        with (folder / "person_4.c3d").open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            frames = [points for _, points, _ in c3d.Reader(file).read_frames()]
        assert all((frames[f][:, 3] == -1).all() for f in np.flatnonzero(away))
        np.testing.assert_allclose(frames[0][there[0], :3], 1000 * expected[0][there[0]], atol=1e-2)
