"""Caliscope's tracked points."""

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError

HEADER = "sync_index,port,frame_index,frame_time,point_id,img_loc_x,img_loc_y,obj_loc_x,obj_loc_y"


def write(file, rows, header=HEADER):
    file.write_text("\n".join([header, *(",".join(map(str, row)) + ",," for row in rows)]) + "\n")


def test_points_of_all_cameras_come_from_one_file(tmp_path):
    rows = [
        (frame, port, frame, 100.0 + 0.04 * frame, point, 10 * point + port, 20 * point + frame)
        for frame in (3, 4, 6)
        for port in (0, 2)
        for point in (0, 12, 32, 105)
        if not (frame == 4 and port == 2)
    ]
    write(tmp_path / "xy_HOLISTIC.csv", rows)
    detections = posefuse.read_detections(tmp_path)
    assert detections.view_names == ("cam_0", "cam_2")
    assert detections.skeleton.name == "mediapipe_33"
    np.testing.assert_array_equal(detections.frame_numbers, [3, 4, 5, 6])
    np.testing.assert_array_equal(detections.recorded, [[1, 1], [1, 0], [0, 0], [1, 1]])
    assert detections.rate_hz == pytest.approx(25.0)
    first = np.asarray(detections.keypoints_px)[1]
    np.testing.assert_array_equal(first[[0, 12, 32]], [[2, 3], [122, 243], [322, 643]])
    assert np.isnan(first[1]).all()
    assert "5 observations of hands and face are ignored" in detections.notes[0]


@pytest.mark.parametrize(
    "row", ["4,0,4,1.0,7,12.5", "4,0,4,1.0,7,12.5,x,,", "nan,0,4,1,7,2,2", "2.5,0,4,1,7,2,2", "4,0,4,1,-1,2,2"]
)
def test_truncated_line_is_reported(row, tmp_path):
    file = tmp_path / "xy.csv"
    write(file, [(3, 0, 3, 1.0, 0, 1, 2)])
    file.write_text(file.read_text() + row)
    with pytest.raises(FileError, match=r"xy.csv, line 3: expected 7 numbers"):
        posefuse.read_detections(file)


def test_empty_or_second_file_is_an_error(tmp_path):
    write(tmp_path / "xy_A.csv", [])
    with pytest.raises(FileError, match="contains no points"):
        posefuse.read_detections(tmp_path)
    write(tmp_path / "xy_B.csv", [])
    with pytest.raises(FileError, match="several recordings: xy_A.csv, xy_B.csv"):
        posefuse.read_detections(tmp_path)


@pytest.mark.parametrize("objects", [(0, 1), (4, 4)])
def test_object_ids_are_track_ids(objects, tmp_path):
    header = HEADER.replace("port", "cam_id").replace("point_id", "object_id,keypoint_id")
    rows = [
        (f, c, f, 0.04 * f, o, k, 100 * place + k, c)
        for f in range(3)
        for c in (0, 1)
        for place, o in enumerate(objects[: len(set(objects))])
        for k in range(9)
    ]
    write(tmp_path / "xy_POSE.csv", rows, header)
    detections = posefuse.read_detections(tmp_path)
    assert (detections.people_counts == len(set(objects))).all()
    assert set(np.asarray(detections.track_ids).tolist()) == ({0, 1} if len(set(objects)) == 2 else {-1})
    np.testing.assert_array_equal(
        np.asarray(detections.keypoints_px)[-1, :9, 0], 100 * (len(set(objects)) - 1) + np.arange(9)
    )
