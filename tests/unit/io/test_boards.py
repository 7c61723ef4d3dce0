"""Corners of boards, and calibrations that exclude cameras."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from posefuse.errors import FileError, RecordingError
from posefuse.io.boards import find_board, read_board
from posefuse.io.calibration import anipose
from posefuse.io.calibration.read import read_cameras
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.preprocess.match_cameras import match_views
from posefuse.skeleton.skeletons import Skeleton
from tests.scenes import ring


def test_corners_of_sleap_anipose(tmp_path):
    corners = np.arange(2 * 3 * 4 * 2, dtype=float).reshape(2, 3, 4, 2)
    corners[1, 2, 3] = np.nan
    corners[0, 0, 0] = 0.0
    with h5py.File(tmp_path / "calibration.metadata.h5", "w") as file:
        file["detected_corners"] = corners
        file["frames"] = [5, 7, 9]
    read = read_board(find_board(tmp_path), ("a", "b"))
    pixels, _ = read.dense()
    assert read.view_names == ("a", "b")
    assert read.frame_numbers.tolist() == [5, 7, 9]
    assert np.array_equal(pixels[2, 0, 1], corners[0, 2, 1])
    assert np.isnan(pixels[2, 1, 3]).all()
    assert np.isnan(pixels[0, 0, 0]).all(), "a corner at (0, 0) is missing"
    with pytest.raises(FileError, match="corners of 2 unnamed cameras"):
        read_board(tmp_path / "calibration.metadata.h5", ("a", "b", "c"))


def test_corners_of_caliscope(tmp_path):
    header = "sync_index,port,frame_index,frame_time,point_id,img_loc_x,img_loc_y,obj_loc_x,obj_loc_y\n"
    (tmp_path / "xy.csv").write_text(header + "416,2,1,0.0,1,10.5,20.5,0,0\n417,1,1,0.0,0,30,40,0,0\n")
    read = read_board(find_board(tmp_path), ())
    pixels, _ = read.dense()
    assert read.view_names == ("1", "2")
    assert pixels[0, 1, 1].tolist() == [10.5, 20.5]
    assert np.isfinite(pixels[..., 0]).sum() == 2


def test_files_without_a_board_are_refused_with_the_option(tmp_path):
    with pytest.raises(RecordingError, match="`keypoints"):
        find_board(tmp_path)
    (tmp_path / "xy.csv").write_text("a,b\n1,2\n")
    with pytest.raises(FileError, match="contains no board corners"):
        read_board(tmp_path / "xy.csv", ("a",))


def test_excluded_camera_survives_a_round_trip_and_its_view_is_not_used(tmp_path):
    rig = ring(4)
    anipose.write(replace(rig.select(rig.names[:3]), left_out=("cam_3",), notes=("Refined.",)), tmp_path / "r.toml")
    back = read_cameras(tmp_path / "r.toml")
    assert back.left_out == ("cam_3",)
    assert back.notes == ("Refined.",)
    observed = Detections.from_dense(Skeleton("p", ("p",)), rig.names, np.zeros((2, 4, 1, 2)))
    matched, views, notes = match_views(back, observed, Options())
    assert views.view_names == matched.names == rig.names[:3]
    assert any("cam_3" in note for note in notes)
