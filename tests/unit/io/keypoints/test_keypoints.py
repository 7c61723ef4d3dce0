"""Keypoint files: OpenPose folders, arrays, FreeMoCap recordings and posefuse's own, and errors of broken ones."""

import json
from dataclasses import replace

import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import DetectionsError, FileError, PosefuseError, SkeletonError
from posefuse.io.keypoints import native
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.io.netcdf import StoredArray
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.files import openpose_person, write_openpose, write_openpose_frame
from tests.unit.model.test_detections import ragged


@pytest.fixture(scope="module")
def walk() -> Detections:
    return simulate(SceneOptions(skeleton="body_25", duration_s=0.5, cameras=3, detector=CLEAN)).detections


class TestOpenPose:
    def test_written_detections_are_read(self, walk, tmp_path):
        found = read_detections(write_openpose(tmp_path, walk))
        assert found.skeleton.name == "body_25"
        assert found.view_names == ("cam_0_json", "cam_1_json", "cam_2_json")
        for mine, theirs in zip(found.dense(), walk.dense(), strict=True):
            np.testing.assert_array_equal(mine, theirs)
        assert found.rate_hz is None
        assert np.isnan(found.time_s).all()

    def test_any_number_of_people(self, tmp_path, rng):
        crowd = replace(ragged(rng, keypoints=17), skeleton=find_skeleton("coco_17"), depth=None)
        found = read_detections(write_openpose(tmp_path, crowd, suffix=""), "coco_17")
        np.testing.assert_array_equal(found.people_counts, crowd.people_counts)
        np.testing.assert_array_equal(found.keypoints_px, crowd.keypoints_px)
        np.testing.assert_array_equal(found.track_ids, crowd.track_ids)
        assert found.frame_numbers.tolist() == crowd.frame_numbers.tolist()

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
        found = read_detections(tmp_path)
        assert not found.recorded[4, 1]
        assert found.recorded.sum() == found.recorded.size - 1
        assert np.isnan(found.with_rate(30).time_s[4, 1])

    def test_an_empty_person_makes_the_list_index_the_identity(self, walk, tmp_path):
        folder = tmp_path / "cam"
        folder.mkdir()
        for f in range(6):
            person = openpose_person(walk, f * 3)
            write_openpose_frame(folder / f"cam.{f:04d}.json", [{}, person] if f != 2 else [person, {}])
        found = read_detections(tmp_path)
        assert found.people_counts.ravel().tolist() == [1] * 6
        assert found.track_ids.tolist() == [1, 1, 0, 1, 1, 1]

    def test_one_camera(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        found = read_detections(tmp_path / "cam_1_json")
        assert found.view_names == ("cam_1_json",)

    def test_nan_in_a_file_is_missing(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        path = tmp_path / "cam_1_json" / "cam_1_000000000004_keypoints.json"
        person = openpose_person(walk, 4 * 3 + 1)
        person["pose_keypoints_2d"][3] = float("nan")
        path.write_text(json.dumps({"people": [person]}))
        found = read_detections(tmp_path)
        assert np.isnan(found.dense()[0][4, 1, 1, 0])

    def test_body_25_and_body_25b_are_distinguished(self, tmp_path):
        other = simulate(SceneOptions(skeleton="body_25b", duration_s=0.5, cameras=3)).detections
        found = read_detections(write_openpose(tmp_path, other))
        assert found.skeleton.name == "body_25b"
        assert "not as body_25" in found.notes[0]

    def test_settings_of_pose2sim_are_used(self, walk, tmp_path):
        (tmp_path / "Config.toml").write_text('[project]\nframe_rate = 50\n[pose]\npose_model = "BODY_25"\n')
        found = read_detections(write_openpose(tmp_path / "pose", walk))
        assert found.rate_hz == 50
        assert found.skeleton.name == "body_25"
        assert found.notes == ("Frame rate 50 Hz read from Config.toml.",)

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
    def test_a_broken_file_is_named(self, content, words, walk, tmp_path):
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

    def test_a_folder_is_not_a_frame(self, walk, tmp_path):
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

    def test_the_wrong_skeleton(self, walk, tmp_path):
        write_openpose(tmp_path, walk)
        with pytest.raises(FileError, match="has 25 keypoints per person, skeleton coco_17 has 17"):
            read_detections(tmp_path, "coco_17")

    def test_no_person_in_any_view(self, tmp_path):
        for f in range(3):
            (tmp_path / "cam").mkdir(exist_ok=True)
            write_openpose_frame(tmp_path / "cam" / f"{f}.json", [])
        with pytest.raises(FileError, match="no person was detected in any view"):
            read_detections(tmp_path)
        found = read_detections(tmp_path, "coco_17")
        assert found.people_counts.sum() == 0

    def test_an_unknown_number_of_keypoints(self, tmp_path):
        (tmp_path / "cam").mkdir()
        write_openpose_frame(tmp_path / "cam" / "0.json", [{"pose_keypoints_2d": [1.0, 2.0, 0.5] * 7}])
        with pytest.raises(SkeletonError, match=r"has 7 keypoints, but no shipped skeleton does"):
            read_detections(tmp_path)

    def test_ambiguous_skeletons_are_an_error(self, tmp_path):
        (tmp_path / "cam").mkdir()
        write_openpose_frame(tmp_path / "cam" / "0.json", [{"pose_keypoints_2d": [5.0, 5.0, 0.5] * 25}])
        with pytest.raises(SkeletonError, match="may be body_25, body_25b; the detections do not decide"):
            read_detections(tmp_path)


class TestArrays:
    @pytest.fixture
    def pixels(self, walk) -> np.ndarray:
        return np.moveaxis(walk.to_skeleton(find_skeleton("halpe_26")).dense()[0], 0, 1)

    def test_two_channels(self, pixels, tmp_path):
        np.save(tmp_path / "points.npy", pixels)
        found = read_detections(tmp_path / "points.npy")
        assert found.skeleton.name == "halpe_26"
        np.testing.assert_array_equal(found.dense()[0], np.moveaxis(pixels, 0, 1))
        assert found.view_names == ("0", "1", "2")

    @pytest.mark.parametrize("meaning", ["confidence", "depth"])
    def test_three_channels_need_a_meaning(self, meaning, pixels, tmp_path):
        third = np.linspace(0.1, 0.9, pixels[..., 0].size).reshape(pixels.shape[:-1])
        path = tmp_path / "points.npy"
        np.save(path, np.concatenate([pixels, third[..., None]], axis=-1))
        with pytest.raises(DetectionsError, match="--third-channel confidence or --third-channel depth"):
            read_detections(path)
        found = read_keypoints(path, Request(third_channel=meaning))
        values = found.confidence if meaning == "confidence" else found.depth
        np.testing.assert_array_equal(np.asarray(values).reshape(found.n_frames, 3, 26), np.moveaxis(third, 0, 1))
        assert (found.depth is None) == (meaning == "confidence")

    def test_npz_with_names_rate_and_confidence(self, pixels, tmp_path):
        path = tmp_path / "points.npz"
        np.savez(path, keypoints=pixels, names=["a", "b", "c"], rate_hz=25.0, confidence=np.full(pixels.shape[:3], 0.5))
        found = read_detections(path)
        assert found.view_names == ("a", "b", "c")
        assert found.rate_hz == 25.0
        assert (np.asarray(found.confidence) == 0.5).all()

    @pytest.mark.parametrize(
        ("extra", "words"),
        [
            ({"confidence": np.ones((2, 3))}, r"expected confidence \[camera, frame, keypoint\]"),
            ({"rate_hz": np.array([30.0, 60.0])}, "expected one number for rate_hz"),
            ({"rate_hz": np.array("thirty")}, "expected one number for rate_hz"),
        ],
    )
    def test_inconsistent_npz_is_refused(self, extra, words, pixels, tmp_path):
        np.savez(tmp_path / "k.npz", keypoints=pixels, **extra)
        with pytest.raises(FileError, match=words):
            read_detections(tmp_path / "k.npz")

    def test_zeros_are_missing(self, pixels, tmp_path):
        spoilt = pixels.copy()
        spoilt[0, 1, 2] = spoilt[1, 0, 4] = 0.0
        np.save(tmp_path / "k.npy", spoilt)
        found = read_detections(tmp_path / "k.npy")
        assert np.isnan(found.dense()[0][1, 0, 2]).all()
        assert "2 keypoints at exactly (0, 0)" in found.notes[-1]

    def test_a_skeleton_of_another_size(self, pixels, tmp_path):
        np.save(tmp_path / "k.npy", pixels)
        with pytest.raises(FileError, match="26 keypoints per person, skeleton coco_17 has 17"):
            read_detections(tmp_path / "k.npy", "coco_17")

    def test_one_coordinate_alone_is_missing(self, pixels, tmp_path):
        pixels[0, 0, 3, 1] = np.nan
        np.save(tmp_path / "points.npy", pixels)
        assert np.isnan(read_detections(tmp_path / "points.npy").dense()[0][0, 0, 3]).all()

    @pytest.mark.parametrize(
        ("array", "words"),
        [
            (np.zeros((3, 4, 26)), r"\[camera, frame, keypoint, 2 or 3\], got float64 of shape \(3, 4, 26\)"),
            (np.zeros((3, 4, 26, 4)), r"shape \(3, 4, 26, 4\)"),
            (np.full((3, 4, 26, 2), "x"), "got <U1"),
            (np.full((3, 4, 26, 2), np.inf), "infinite"),
        ],
    )
    def test_other_shapes_are_refused(self, array, words, tmp_path):
        np.save(tmp_path / "points.npy", array)
        with pytest.raises(PosefuseError, match=words):
            read_detections(tmp_path / "points.npy", "halpe_26")

    def test_pickles_are_refused(self, tmp_path):
        np.save(tmp_path / "points.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
        with pytest.raises(FileError, match="cannot be|can be read"):
            read_detections(tmp_path / "points.npy")

    def test_truncated(self, pixels, tmp_path):
        path = tmp_path / "points.npy"
        np.save(path, pixels)
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.raises(FileError, match="truncated"):
            read_detections(path)

    def test_npz_without_a_keypoint_array(self, pixels, tmp_path):
        np.savez(tmp_path / "points.npz", a=pixels, b=pixels)
        with pytest.raises(FileError, match="must be called 'keypoints'"):
            read_detections(tmp_path / "points.npz")


class TestFreeMoCap:
    def recording(self, folder, cameras: int = 2, videos: int = 2):
        raw = folder / "output_data" / "raw_data"
        raw.mkdir(parents=True)
        array = np.random.default_rng(0).uniform(0, 1000, (cameras, 4, 553, 3))
        np.save(raw / "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy", array)
        (folder / "synchronized_videos").mkdir()
        for i in range(videos):
            (folder / "synchronized_videos" / f"{'aB'[i % 2]}_{i}.mp4").touch()
        return array

    def test_third_channel_is_depth_and_views_are_videos(self, tmp_path):
        array = self.recording(tmp_path)
        found = read_detections(tmp_path)
        assert found.skeleton.name == "mediapipe_holistic_553"
        assert found.view_names == ("a_0", "B_1")
        np.testing.assert_array_equal(np.asarray(found.depth)[0], array[0, 0, :, 2])
        assert np.isnan(found.confidence).all()

    def test_without_videos_views_have_no_names(self, tmp_path):
        self.recording(tmp_path, videos=0)
        assert read_detections(tmp_path).view_names == ("camera_0", "camera_1")

    def test_the_number_of_videos_must_match(self, tmp_path):
        self.recording(tmp_path, cameras=3)
        with pytest.raises(FileError, match="2 videos, but .* has 3 cameras"):
            read_detections(tmp_path)


class TestNative:
    def test_survives_a_round_trip_and_stays_in_the_file(self, tmp_path, rng):
        crowd = ragged(rng)
        native.write(crowd, tmp_path / "keypoints.nc")
        found = read_detections(tmp_path / "keypoints.nc")
        assert isinstance(found.keypoints_px, StoredArray)
        assert found == crowd
        np.testing.assert_array_equal(found.frames(2, 4).keypoints_px, crowd.frames(2, 4).keypoints_px)

    def test_same_bytes(self, tmp_path, rng):
        crowd = ragged(rng)
        for name in ("a.nc", "b.nc"):
            native.write(crowd, tmp_path / name)
        assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()

    def test_mapping_on_request(self, walk, tmp_path):
        native.write(walk, tmp_path / "keypoints.nc")
        assert read_detections(tmp_path / "keypoints.nc", "coco_17").skeleton.name == "coco_17"

    @pytest.mark.parametrize("keep", [0, 10, 0.3, 0.95])
    def test_truncated_files_are_refused(self, keep, tmp_path, rng):
        path = tmp_path / "keypoints.nc"
        native.write(ragged(rng), path)
        content = path.read_bytes()
        path.write_bytes(content[: int(keep * len(content)) if keep < 1 else int(keep)])
        with pytest.raises(FileError, match=r"keypoints\.nc"):
            read_detections(path)


def test_unknown_formats_are_refused(tmp_path):
    with pytest.raises(FileError, match="No keypoints at .*nowhere"):
        read_detections(tmp_path / "nowhere")
    with pytest.raises(FileError, match="no keypoints in a known format. Formats: posefuse"):
        read_detections(tmp_path)
