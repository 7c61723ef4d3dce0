"""Tables, replays, records and landmarks: hand-written cases, and errors of invalid ones."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import sleap_io

from posefuse import read_detections
from posefuse.errors import DetectionsError, FileError, SkeletonError
from posefuse.io.keypoints import detection_tables, openpose, tidy
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.io.recording import find_recording
from tests.keypoint_files import WRITERS
from tests.unit.io.keypoints.test_keypoint_formats import BODY, some

HEADER = "camera,frame,time_s,person,track,keypoint,x_px,y_px,confidence"


def tidy_file(path, *rows, header=HEADER):
    file = path / "k.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


class TestTidy:
    def test_a_hand_written_table(self, tmp_path):
        file = tidy_file(
            tmp_path, "b,7,0.5,0,3,paw,10,20,0.5", "b,7,0.5,0,3,nose,,,", "a,7,0.48,,,,,,", "b,8,0.6,,,,,,"
        )
        found = read_detections(file)
        assert found.view_names == ("a", "b")
        assert found.skeleton.keypoints == ("paw", "nose")
        assert found.recorded.tolist() == [[True, True], [False, True]]
        assert found.people_counts.tolist() == [[0, 1], [0, 0]]
        np.testing.assert_array_equal(found.time_s, [[0.48, 0.5], [np.nan, 0.6]])
        np.testing.assert_array_equal(found.keypoints_px[:], [[[10, 20], [np.nan, np.nan]]])
        assert found.track_ids[:].tolist() == [3]
        assert found.rate_hz == pytest.approx(10.0)

    def test_five_columns_are_enough(self, tmp_path):
        file = tidy_file(tmp_path, "1,0,nose,5,6", "2,0,nose,7,8", header="camera,frame,keypoint,x_px,y_px")
        found = read_detections(file)
        assert found.view_names == ("1", "2")
        assert np.isnan(found.confidence[:]).all()
        assert found.rate_hz is None

    @pytest.mark.parametrize(
        ("row", "words"),
        [
            ("a,7,0,0,,nose,1,2,1", "row 2: nose of person 0 occurs twice in frame 7 of camera a"),
            ("a,7.5,0,0,,nose,1,2,1", "expected an integer for frame, got 7.5"),
            ("a,,0,0,,nose,1,2,1", "expected an integer for frame, got nothing"),
            ("a,8,0,,,nose,1,2,1", "row 2: a keypoint without a person"),
            ("a,8,0,0,,nose,left,2,1", "the column x_px does not contain numbers"),
            (",8,0,0,,nose,1,2,1", "row 2: no camera"),
            ("a,8,0,0", "Is the file truncated"),
            ("a,9000000,0,0,,nose,1,2,1", "only 2 frames"),
        ],
    )
    def test_invalid_rows_are_reported_with_their_number(self, tmp_path, row, words):
        with pytest.raises(FileError, match=words):
            read_detections(tidy_file(tmp_path, "a,7,0,0,,nose,1,2,1", row))

    def test_infinity_is_refused(self, tmp_path):
        with pytest.raises(DetectionsError, match="infinite"):
            read_detections(tidy_file(tmp_path, "a,7,0,0,,nose,inf,2,1"))

    def test_parquet_is_read_on_demand(self, tmp_path):
        given = some()
        tidy.write(given, tmp_path / "k.parquet")
        found = read_detections(tmp_path / "k.parquet")
        assert not isinstance(found.keypoints_px, np.ndarray)
        np.testing.assert_array_equal(found.confidence[[3, 0]], np.asarray(given.confidence)[[3, 0]])
        np.testing.assert_array_equal(found.track_ids[-1], given.track_ids[-1])
        with pytest.raises(IndexError):
            found.keypoints_px[10_000]

    def test_reordered_rows_are_read(self, tmp_path):
        given = some()
        tidy.write(given, tmp_path / "k.parquet")
        table = pq.read_table(tmp_path / "k.parquet")
        pq.write_table(table.sort_by("x_px"), tmp_path / "sorted.parquet")
        found = read_detections(tmp_path / "sorted.parquet")
        np.testing.assert_array_equal(found.keypoints_px[:], given.keypoints_px)


class TestDetectionTables:
    def table(self, path, frames, people, **more):
        shape = [[[[float(f), 2.0]] * 17 for _ in range(n)] for f, n in zip(frames, people, strict=True)]
        scores = [[[0.5] * 17 for _ in range(n)] for n in people]
        pq.write_table(pa.table({"frame": frames, "keypoints": shape, "scores": scores} | more), path)

    def test_tables_of_other_programs_with_frames_in_any_order(self, tmp_path):
        self.table(tmp_path / "a.parquet", [3, 1], [2, 0], timestamp_ns=[2_000_000_000, 1_000_000_000])
        self.table(tmp_path / "b.parquet", [1, 2], [1, 1], timestamp_ns=[1_100_000_000, 1_600_000_000])
        found = read_detections(tmp_path, "coco_17")
        assert found.people_counts.tolist() == [[0, 1], [0, 1], [2, 0]]
        assert found.recorded.tolist() == [[True, True], [False, True], [True, False]]
        np.testing.assert_allclose(found.time_s, [[1.0, 1.1], [np.nan, 1.6], [2.0, np.nan]])
        assert found.keypoints_px[:][:, 0, 0].tolist() == [1.0, 2.0, 3.0, 3.0]

    def test_one_table_of_all_cameras(self, tmp_path):
        self.table(tmp_path / "all.parquet", [1, 1, 2], [1, 2, 1], camera=["b", "a", "b"])
        found = read_detections(tmp_path / "all.parquet", "coco_17")
        assert found.people_counts[:, found.view_names.index("a")].tolist() == [2, 0]

    def test_folders_of_parts(self, tmp_path):
        for camera in "ab":
            (tmp_path / camera).mkdir()
            self.table(tmp_path / camera / "x.parquet", [3], [2])
        self.table(tmp_path / "a" / "0.parquet", [0, 1], [1, 1])
        self.table(tmp_path / "a" / "1.parquet", [2], [1])
        assert read_detections(tmp_path, "coco_17").people_counts.tolist() == [[1, 0], [1, 0], [1, 0], [2, 2]]

    def test_a_frame_twice_is_an_error(self, tmp_path):
        self.table(tmp_path / "a.parquet", [1, 1], [1, 1])
        with pytest.raises(FileError, match="'a' has two rows for frame 1"):
            read_detections(tmp_path, "coco_17")

    def test_names_never_leave_the_folder(self, tmp_path):
        given = some()
        hostile = given.views(["left"])
        object.__setattr__(hostile, "view_names", ("../outside",))
        for write in (detection_tables.write, openpose.write):
            with pytest.raises(FileError, match="is not a valid file name"):
                write(hostile, tmp_path / "out")
        assert list(tmp_path.iterdir()) == []


class TestRecords:
    def lines(self, path, *records):
        file = path / "r.jsonl"
        file.write_text("".join(json.dumps(record) + "\n" for record in records))
        return file

    def test_frames_are_assigned_by_time(self, tmp_path):
        start, person = 1_700_000_000_000_000_000, {"keypoints": [[1, 2, 0.5]] * 133}
        times = {"a": (0, 40, 121), "b": (3, 43, 80)}
        records = [
            {"label": name, "timestamp": start + ms * 1_000_000, "people": [person]}
            for name, several in times.items()
            for ms in several
        ]
        found = read_detections(self.lines(tmp_path, *records))
        assert found.skeleton.name == "coco_wholebody_133"
        assert found.recorded.tolist() == [[True, True], [True, True], [False, True], [True, False]]
        np.testing.assert_allclose(found.time_s[:, 0], [0.0, 0.04, np.nan, 0.121], atol=1e-9)

    @pytest.mark.parametrize(
        ("record", "words"),
        [
            ({"camera": "a", "people": []}, "neither a frame"),
            ({"camera": "a", "timestamp": "now", "people": []}, "expected a number for timestamp"),
            ({"camera": "a", "timestamp": 2, "people": [{"x": 1}]}, "a person without keypoints"),
            ({"camera": "a", "timestamp": 2, "people": 4}, "expected a list of people"),
        ],
    )
    def test_incomplete_records_are_reported_with_their_line(self, tmp_path, record, words):
        file = self.lines(tmp_path, {"camera": "a", "timestamp": 1, "people": []}, record)
        with pytest.raises(FileError, match=f"line 2.*{words}"):
            read_detections(file)


class TestLandmarks:
    def test_fractions_need_the_size_of_the_image(self, tmp_path):
        landmarks = [{"x": 0.5, "y": 0.25, "z": -0.1, "visibility": 0.9}] * 33
        (tmp_path / "a.json").write_text(json.dumps([{"pose_landmarks": landmarks}, {"pose_landmarks": None}]))
        with pytest.raises(FileError, match="--image-size"):
            read_detections(tmp_path)
        found = read_keypoints(tmp_path, Request(image_size_px=(1000, 600)))
        assert found.keypoints_px[0, 0].tolist() == [500.0, 150.0]
        assert found.depth[0, 0] == -100.0
        assert found.people_counts.tolist() == [[1], [0]]

    @pytest.mark.parametrize(("mesh", "skeleton"), [(468, "mediapipe_holistic_543"), (478, "mediapipe_holistic_553")])
    def test_hands_and_face_have_the_order_of_the_skeleton(self, tmp_path, mesh, skeleton):
        def points(n, x):
            return {"landmark": [{"x": x, "y": 10.0, "visibility": 1.0}] * n}

        frame = {
            "pose_landmarks": points(33, 100.0), "face_landmarks": points(mesh, 200.0),
            "left_hand_landmarks": points(21, 300.0), "right_hand_landmarks": points(21, 400.0),
        }  # fmt: skip
        (tmp_path / "a.json").write_text(json.dumps({"fps": 25, "frames": [frame]}))
        found = read_detections(tmp_path)
        assert found.skeleton.name == skeleton
        assert found.rate_hz == 25.0
        for name, x in {"nose": 100.0, "left_hand_root": 300.0, "right_thumb_4": 400.0}.items():
            assert found.keypoints_px[0, found.skeleton.index(name), 0] == x


def test_a_manual_instance_replaces_the_prediction_that_it_corrects(tmp_path):
    skeleton = sleap_io.Skeleton(nodes=["a", "b"], edges=[("a", "b")])
    video = sleap_io.Video(filename="cam.mp4", open_backend=False)
    guess = sleap_io.PredictedInstance.from_numpy(np.array([[1.0, 2], [3, 4]]), skeleton, point_scores=np.ones(2))
    hand = sleap_io.Instance.from_numpy(np.array([[5.0, 6], [7, 8]]), skeleton)
    hand.from_predicted = guess
    frame = sleap_io.LabeledFrame(video=video, frame_idx=2, instances=[guess, hand])
    sleap_io.save_file(sleap_io.Labels([frame]), tmp_path / "x.slp", verbose=False)
    found = read_detections(tmp_path / "x.slp")
    np.testing.assert_array_equal(found.keypoints_px[:], [[[5, 6], [7, 8]]])
    assert np.isnan(found.confidence[:]).all()
    assert found.skeleton.edges == (("a", "b"),)


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_is_found_in_a_folder(name, tmp_path):
    given = some(1, body=BODY.get(name))
    WRITERS[name](given, tmp_path / "recording" / "keypoints")
    (found,) = find_recording(tmp_path / "recording").keypoints
    assert read_detections(found.path, given.skeleton).view_names == given.view_names


@pytest.mark.parametrize(
    "name", ["detection_folder", "payload_arrays", "mediapipe_json", "mediapipe_wide", "mediapipe_long", "deeplabcut"]
)
def test_a_camera_with_an_empty_file_is_an_error(name, tmp_path):
    path = WRITERS[name](some(1, body=BODY.get(name)), tmp_path)
    max(file for file in tmp_path.rglob("*") if file.is_file()).write_bytes(b"")
    with pytest.raises(FileError, match=r"truncated"):
        read_detections(path)


def test_a_skeleton_of_another_number_is_refused(tmp_path):
    path = WRITERS["replay_without_head"](some(), tmp_path)
    with pytest.raises((FileError, SkeletonError), match="17 keypoints per person"):
        read_detections(path, "body_25")
