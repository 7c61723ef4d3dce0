"""NetCDF results."""

from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from h5py._hl.base import HLObject

import posefuse
from posefuse.arrays import same
from posefuse.errors import FileError
from posefuse.io.netcdf import CHUNK_FRAMES, StoredArray, skeleton_from_text, skeleton_text
from posefuse.io.results import netcdf, netcdf_angles, netcdf_contact
from posefuse.io.results.rounding import rounded
from posefuse.io.results.write import write_folder
from posefuse.model.label_swaps import Swaps
from posefuse.model.options.sync import SyncOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.people import without_people


class TestNetcdf:
    def test_round_trip_reads_on_demand(self, frame_result, tmp_path):
        path = tmp_path / "reconstruction.nc"
        posefuse.write(frame_result, path)
        result = posefuse.read_reconstruction(path)
        assert isinstance(result.layers["measured"].points_m, StoredArray)
        assert result == rounded(frame_result)
        assert result.frames(2, 5) == rounded(frame_result.frames(2, 5))

    def test_interpolated_views_are_marked(self, frame_result, tmp_path):
        path, (_, second, third, _) = tmp_path / "reconstruction.nc", frame_result.rig.names
        sync = SyncOptions((second, third), (0.0, 0.0), (0.7 / 60.0, 2.05 / 60.0), (0.0, 0.0))
        posefuse.write(replace(frame_result, options=replace(frame_result.options, sync=sync)), path)
        with xarray.open_dataset(path, engine="h5netcdf") as data:
            assert data["retimed"].values.all(axis=0).tolist() == [False, True, False, False]
        assert posefuse.read_reconstruction(path).retimed[4].tolist() == [False, True, False, False]
        assert not frame_result.retimed.any()

    def test_swaps_round_trip(self, frame_result, tmp_path):
        state = np.random.default_rng(0).integers(-1, 2, (9, 1, 4, 2)).astype(np.int8)
        results = replace(frame_result, swaps=Swaps(("arm", "leg"), state))
        netcdf.write(results.chunks(4), tmp_path / "told.nc")
        assert posefuse.read_reconstruction(tmp_path / "told.nc") == rounded(results)
        believed = replace(frame_result, swaps=None)
        posefuse.write(believed, tmp_path / "believed.nc")
        assert posefuse.read_reconstruction(tmp_path / "believed.nc").swaps is None

    @pytest.mark.parametrize("size", [1, 4, 9])
    def test_writing_in_ranges_gives_the_same_file(self, size, frame_result, tmp_path):
        netcdf.write(frame_result.chunks(size), tmp_path / "parts.nc")
        assert posefuse.read_reconstruction(tmp_path / "parts.nc") == rounded(frame_result)

    def test_same_input_gives_the_same_bytes(self, frame_result, tmp_path):
        for name in ("a.nc", "b.nc"):
            posefuse.write(frame_result, tmp_path / name)
        assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()

    @pytest.mark.parametrize("seed", range(4))
    def test_bytes_do_not_depend_on_handles_that_others_hold(self, frame_result, tmp_path, monkeypatch, seed):
        """A thread that samples the stack holds handles for a moment; the collector may free them at any time."""

        def write(path: Path) -> bytes:
            netcdf.write(replace(frame_result, joint_angles=None).chunks(4), path)
            netcdf_angles.add([frame_result.joint_angles], path)
            shape = frame_result.n_frames, len(frame_result.person_ids), 2
            netcdf_contact.add_contact(path, np.zeros((*shape, 2)), np.zeros(shape), "measured")
            return path.read_bytes()

        expected = write(tmp_path / "a.nc")
        held: list[object] = []
        n_held = 0
        rng, open_handle = np.random.default_rng(seed), HLObject.__init__

        def hold_some(self: HLObject, handle: object) -> None:
            nonlocal n_held
            open_handle(self, handle)
            if not isinstance(handle, h5py.h5f.FileID) and rng.random() < 0.2:
                held.append(handle)
                n_held += 1
            if held and rng.random() < 0.2:
                del held[int(rng.integers(len(held)))]

        monkeypatch.setattr(HLObject, "__init__", hold_some)
        actual = write(tmp_path / "b.nc")
        assert n_held > 100
        assert actual == expected

    def test_result_without_optional_fields_round_trips(self, frame_result, tmp_path):
        bare = replace(frame_result, tracks=None, noise=None, rate_hz=None, rig=replace(frame_result.rig, up_axis=None))
        posefuse.write(bare, tmp_path / "bare.nc")
        assert posefuse.read_reconstruction(tmp_path / "bare.nc") == rounded(bare)

    def test_several_layers(self, frame_result, tmp_path):
        both = replace(
            frame_result,
            layers={"measured": frame_result.layers["measured"], "solved": frame_result.layers["measured"]},
        )
        posefuse.write(both, tmp_path / "both.nc")
        assert posefuse.read_reconstruction(tmp_path / "both.nc") == rounded(both)

    def test_xarray_opens_it_with_named_axes(self, frame_result, tmp_path):
        posefuse.write(frame_result, tmp_path / "reconstruction.nc")
        with xarray.open_dataset(tmp_path / "reconstruction.nc") as data:
            position = data["measured_position"]
            assert position.dims == ("time", "individual", "keypoint", "space")
            points = rounded(frame_result).layers["measured"].points_m
            np.testing.assert_array_equal(position.values, points)
            one = position.sel(individual="person_1", keypoint="nose", space="z")
            np.testing.assert_array_equal(one.values, points[:, 0, 0, 2])
            np.testing.assert_allclose(data["time"].values, frame_result.time_s)
            status = data["measured_status"]
            assert status.attrs["flag_meanings"].split()[:2] == ["ok", "two_views"]
            assert position.attrs["units"] == "m"

    @pytest.mark.parametrize("keep", [0, 10, 0.5, 0.99])
    def test_truncated_file_is_an_error(self, keep, frame_result, tmp_path):
        path = tmp_path / "reconstruction.nc"
        posefuse.write(frame_result, path)
        content = path.read_bytes()
        path.write_bytes(content[: int(keep * len(content)) if keep < 1 else int(keep)])
        with pytest.raises(FileError, match=r"reconstruction\.nc"):
            posefuse.read_reconstruction(path)

    def test_other_files_are_refused(self, tmp_path):
        with pytest.raises(FileError, match="No reconstruction at"):
            posefuse.read_reconstruction(tmp_path / "reconstruction.nc")
        xarray.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
        with pytest.raises(FileError, match="not a posefuse reconstruction file"):
            posefuse.read_reconstruction(tmp_path / "other.nc")

    def test_missing_attribute_is_an_error(self, frame_result, tmp_path):
        posefuse.write(frame_result, tmp_path / "r.nc", "netcdf")
        with h5py.File(tmp_path / "r.nc", "r+") as file:
            del file.attrs["noise_spread"]
        with pytest.raises(FileError, match=r"r.nc lacks the attribute noise_spread: another version"):
            posefuse.read_reconstruction(tmp_path / "r.nc")


class TestNetcdfOfPeople:
    @pytest.mark.parametrize("size", [9, 17, 1000])
    def test_result_round_trips(self, size, crowd_result, tmp_path):
        netcdf.write(crowd_result.chunks(size), tmp_path / "r.nc")
        result = posefuse.read_reconstruction(tmp_path / "r.nc")
        assert result == rounded(crowd_result)
        assert isinstance(result.poses.turns, StoredArray)
        assert result.frames(3, 20) == rounded(crowd_result.frames(3, 20))

    def test_events_repeated_in_ranges_are_stored_once(self, crowd_result, tmp_path):
        parts = [replace(part, events=crowd_result.events) for part in crowd_result.chunks(10)]
        netcdf.write(parts, tmp_path / "r.nc")
        assert posefuse.read_reconstruction(tmp_path / "r.nc").events == crowd_result.events
        assert Reconstruction.concatenate(parts) == crowd_result

    def test_result_without_poses_and_events_round_trips(self, crowd_result, tmp_path):
        bare = replace(crowd_result, poses=None, events=())
        netcdf.write(bare.chunks(), tmp_path / "r.nc")
        assert posefuse.read_reconstruction(tmp_path / "r.nc") == rounded(bare)

    def test_results_without_angle_sds_are_read(self, crowd_result, tmp_path):
        netcdf.write(crowd_result.chunks(), tmp_path / "r.nc")
        with h5py.File(tmp_path / "r.nc", "a") as file:
            file.move("pose_angle_sd", "other")
        poses = posefuse.read_reconstruction(tmp_path / "r.nc").poses
        assert poses.angles == ()
        assert poses.angle_sd_deg.shape == (crowd_result.n_frames, len(crowd_result.person_ids), 0)

    def test_body_without_segments_round_trips(self, crowd_result, tmp_path):
        poses = crowd_result.poses
        stick = replace(poses, segments=(), turns=poses.turns[:, :, :0])
        netcdf.write(replace(crowd_result, poses=stick).chunks(), tmp_path / "r.nc")
        assert (
            posefuse.read_reconstruction(tmp_path / "r.nc").poses == rounded(replace(crowd_result, poses=stick)).poses
        )

    @pytest.mark.parametrize("name", ["body_20", "coco_wholebody_133", "h36m_17"])
    def test_kinematic_tree_round_trips(self, name):
        tree = shipped_skeleton(name).tree
        actual = skeleton_from_text(skeleton_text(shipped_skeleton(name))).tree
        for field in fields(tree):
            first, second = getattr(tree, field.name), getattr(actual, field.name)
            assert same(first, second), field.name
        assert all(same(first, second) for first, second in zip(tree.packed, actual.packed, strict=True))

    def test_poses_are_compressed_in_chunks(self, crowd_result, tmp_path):
        netcdf.write(crowd_result.chunks(), tmp_path / "r.nc")
        with h5py.File(tmp_path / "r.nc") as file:
            for name in ("measured_position", "pose_turn", "pose_direction"):
                assert file[name].chunks[0] == CHUNK_FRAMES
                assert file[name].compression == "gzip"

    def test_result_without_people_round_trips(self, crowd_scene, tmp_path):
        empty = without_people(crowd_scene)
        netcdf.write(empty.chunks(10), tmp_path / "r.nc")
        assert posefuse.read_reconstruction(tmp_path / "r.nc") == empty
        (tmp_path / "out").mkdir()
        assert write_folder(empty, tmp_path / "out")[0] == ["keypoints.csv", "model.csv"]
