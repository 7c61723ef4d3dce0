"""OpenPose folders."""

import json
from dataclasses import replace

import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import DetectionsError, FileError, SkeletonError
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.example_detections import ragged_detections
from tests.files import openpose_person, write_openpose, write_openpose_frame


@pytest.fixture(scope="module")
def walk() -> Detections:
    return simulate(SceneOptions(skeleton="body_25", duration_s=0.5, cameras=3, detector=CLEAN)).detections


class TestOpenPose:
    def test_written_detections_are_read(self, walk, tmp_path):
        detections = read_detections(write_openpose(tmp_path, walk))
        assert detections.skeleton.name == "body_25"
        assert detections.view_names == ("cam_0_json", "cam_1_json", "cam_2_json")
        for first, second in zip(detections.dense(), walk.dense(), strict=True):
            np.testing.assert_array_equal(first, second)
        assert detections.rate_hz is None
        assert np.isnan(detections.time_s).all()

    def test_any_number_of_people(self, tmp_path, rng):
        crowd = replace(ragged_detections(rng, keypoints=17), skeleton=find_skeleton("coco_17"), depth=None)
        detections = read_detections(write_openpose(tmp_path, crowd, suffix=""), "coco_17")
        np.testing.assert_array_equal(detections.people_counts, crowd.people_counts)
        np.testing.assert_array_equal(detections.keypoints_px, crowd.keypoints_px)
        np.testing.assert_array_equal(detections.track_ids, crowd.track_ids)
        assert detections.frame_numbers.tolist() == crowd.frame_numbers.tolist()

    def test_result_folders_are_not_cameras(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        results = tmp_path / "result"
        results.mkdir()
        (results / "reconstruction.nc").write_bytes(b"")
        (results / "evaluation.json").write_text('{"people": []}')
        assert read_detections(tmp_path).view_names == ("cam_0_json", "cam_1_json", "cam_2_json")

    def test_frames_missing_in_one_view(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        (tmp_path / "cam_1_json" / "cam_1_000000000004_keypoints.json").unlink()
        detections = read_detections(tmp_path)
        assert not detections.recorded[4, 1]
        assert detections.recorded.sum() == detections.recorded.size - 1
        assert np.isnan(detections.with_rate(30).time_s[4, 1])

    def test_empty_person_makes_the_list_index_the_identity(self, walk, tmp_path):
        folder = tmp_path / "cam"
        folder.mkdir()
        for f in range(6):
            person = openpose_person(walk, f * 3)
            write_openpose_frame(folder / f"cam.{f:04d}.json", [{}, person] if f != 2 else [person, {}])
        detections = read_detections(tmp_path)
        assert detections.people_counts.ravel().tolist() == [1] * 6
        assert detections.track_ids.tolist() == [1, 1, 0, 1, 1, 1]

    def test_single_camera(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        detections = read_detections(tmp_path / "cam_1_json")
        assert detections.view_names == ("cam_1_json",)

    def test_nan_in_a_file_is_missing(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        path = tmp_path / "cam_1_json" / "cam_1_000000000004_keypoints.json"
        person = openpose_person(walk, 4 * 3 + 1)
        person["pose_keypoints_2d"][3] = float("nan")
        path.write_text(json.dumps({"people": [person]}))
        detections = read_detections(tmp_path)
        assert np.isnan(detections.dense()[0][4, 1, 1, 0])

    def test_body_25_and_body_25b_are_distinguished(self, tmp_path):
        other = simulate(SceneOptions(skeleton="body_25b", duration_s=0.5, cameras=3)).detections
        detections = read_detections(write_openpose(tmp_path, other))
        assert detections.skeleton.name == "body_25b"
        assert "not as body_25" in detections.notes[0]

    def test_settings_of_pose2sim_are_used(self, walk, tmp_path):
        (tmp_path / "Config.toml").write_text('[project]\nframe_rate = 50\n[pose]\npose_model = "BODY_25"\n')
        detections = read_detections(write_openpose(tmp_path / "pose", walk))
        assert detections.rate_hz == 50
        assert detections.skeleton.name == "body_25"
        assert detections.notes == ("Frame rate 50 Hz read from Config.toml.",)

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            ('{"people": [{"pose_keypoints_2d": [1, 2', ["is not complete JSON", "truncated"]),
            ('{"persons": []}', ["not an OpenPose file", "people"]),
            ('{"people": [{"pose_keypoints_2d": [1, "x", 3]}]}', ["not an OpenPose file", "pose_keypoints_2d[1]"]),
            ('{"people": [{"pose_keypoints_2d": [1, 2]}]}', ["person 0", "has 2 numbers"]),
            ('{"people": [{"pose_keypoints_2d": [1, 2, 0.5]}]}', ["keypoints", "must have the same keypoints"]),
            ("", ["is not complete JSON", "(0 bytes)"]),
            ("[]", ["not an OpenPose file"]),
        ],
    )
    def test_broken_file_is_named(self, content, words, walk, tmp_path):
        write_openpose(tmp_path, walk)
        (tmp_path / "cam_1_json" / "cam_1_000000000004_keypoints.json").write_text(content)
        with pytest.raises(FileError) as error:
            read_detections(tmp_path)
        for word in [*words, "cam_1_json"]:
            assert word in str(error.value)

    def test_infinite_numbers_are_refused_with_their_place(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        person = openpose_person(walk, 4 * 3 + 1)
        person["pose_keypoints_2d"][3] = float("inf")
        (tmp_path / "cam_1_json" / "cam_1_000000000004_keypoints.json").write_text(json.dumps({"people": [person]}))
        with pytest.raises(DetectionsError, match="view 'cam_1_json', frame 4, contains an infinite number"):
            read_detections(tmp_path)

    def test_folder_is_not_a_frame(self, walk, tmp_path):
        write_openpose(tmp_path / "pose", walk)
        camera = next((tmp_path / "pose").iterdir())
        (camera / "cam_000000000999_keypoints.json").mkdir()
        assert read_detections(tmp_path / "pose").n_frames == walk.n_frames

    def test_names_without_numbers(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        (tmp_path / "cam_1_json" / "extra.json").write_text('{"people": []}')
        with pytest.raises(FileError, match="extra.json: expected a frame number"):
            read_detections(tmp_path)

    def test_two_files_of_one_frame(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        (tmp_path / "cam_1_json" / "other_4.json").write_text('{"people": []}')
        with pytest.raises(FileError, match="two files for frame 4"):
            read_detections(tmp_path)

    def test_frame_numbers_of_two_recordings(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        (tmp_path / "cam_1_json" / "other_9000000.json").write_text('{"people": []}')
        with pytest.raises(FileError, match="range from 0 to 9000000"):
            read_detections(tmp_path)

    def test_wrong_skeleton_is_refused(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        with pytest.raises(FileError, match="has 25 keypoints per person, but skeleton coco_17 has 17"):
            read_detections(tmp_path, "coco_17")

    def test_no_person_in_any_view(self, tmp_path):
        for f in range(3):
            (tmp_path / "cam").mkdir(exist_ok=True)
            write_openpose_frame(tmp_path / "cam" / f"{f}.json", [])
        with pytest.raises(FileError, match="no person was detected in any view"):
            read_detections(tmp_path)
        detections = read_detections(tmp_path, "coco_17")
        assert detections.people_counts.sum() == 0

    def test_unknown_number_of_keypoints(self, tmp_path):
        (tmp_path / "cam").mkdir()
        write_openpose_frame(tmp_path / "cam" / "0.json", [{"pose_keypoints_2d": [1.0, 2.0, 0.5] * 7}])
        with pytest.raises(SkeletonError, match=r"has 7 keypoints, but no shipped skeleton does"):
            read_detections(tmp_path)

    def test_ambiguous_skeletons_are_an_error(self, tmp_path):
        (tmp_path / "cam").mkdir()
        write_openpose_frame(tmp_path / "cam" / "0.json", [{"pose_keypoints_2d": [5.0, 5.0, 0.5] * 25}])
        with pytest.raises(SkeletonError, match="may be body_25, body_25b, and the detections do not determine which"):
            read_detections(tmp_path)
