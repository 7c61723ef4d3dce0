"""2D keypoints of other programs: every format gives the same detections, and broken files raise errors."""

import json
import pickle

import h5py
import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import FileError, PosefuseError, SkeletonError
from posefuse.io.recording import find_recording
from posefuse.skeleton.skeletons import shipped_skeleton
from tests import keypoint_files
from tests.broken import broken
from tests.example_detections import SKELETONS, example_detections
from tests.keypoint_files import WRITERS

NO_CONFIDENCE = ("coco_annotations", "label3d")
ONE = ("label3d", "deeplabcut", "mediapipe_wide", "mediapipe_long", "eks")
NAMELESS = ("payload_arrays", "mediapipe_json", "mediapipe_wide", "mediapipe_long", "opencap")


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_detections(name, tmp_path):
    original = example_detections(1 if name in ONE else 2, body=SKELETONS.get(name))
    detections = read_detections(WRITERS[name](original, tmp_path / "keypoints"), original.skeleton)
    assert detections.view_names == original.view_names
    np.testing.assert_array_equal(detections.frame_numbers, original.frame_numbers)
    np.testing.assert_array_equal(detections.recorded, original.recorded)
    np.testing.assert_array_equal(detections.offsets, original.offsets)
    np.testing.assert_allclose(detections.keypoints_px, original.keypoints_px, rtol=1e-12)
    tracks = np.full_like(original.track_ids, -1) if name in NAMELESS else original.track_ids
    np.testing.assert_array_equal(detections.track_ids, tracks)
    confidence = np.asarray(original.confidence)
    if name in NO_CONFIDENCE:
        confidence = np.where(np.isnan(confidence), np.nan, 1.0)
    np.testing.assert_allclose(detections.confidence, confidence, rtol=1e-12)


def test_frame_numbers_of_the_file_are_kept(tmp_path):
    detections = example_detections()
    folder = keypoint_files.mmpose(detections, tmp_path)
    for file in folder.glob("*.json"):
        content = json.loads(file.read_text())
        for frame in content["instance_info"]:
            frame["frame_id"] += 1
        file.write_text(json.dumps(content))
    assert read_detections(folder, "coco_17").frame_numbers.tolist() == [1, 2, 3, 4, 5, 6]


def test_ignored_hands_are_reported(tmp_path):
    detections = example_detections()
    folder = keypoint_files.openpose(detections, tmp_path)
    assert not any("are not read" in note for note in read_detections(folder, detections.skeleton).notes)
    for file in folder.rglob("*.json"):
        content = json.loads(file.read_text())
        for person in content["people"]:
            person["hand_left_keypoints_2d"] = [1.0, 2.0, 0.5] * 21
        file.write_text(json.dumps(content))
    assert any("are not read" in note for note in read_detections(folder, detections.skeleton).notes)


def test_annotations_name_their_keypoints_and_bones(tmp_path):
    detections = read_detections(keypoint_files.coco_annotations(example_detections(), tmp_path))
    assert detections.skeleton.keypoints == shipped_skeleton("coco_17").keypoints
    assert detections.skeleton.edges == shipped_skeleton("coco_17").edges


EKS = ("x", "y", "likelihood", "x_ens_median", "x_ens_var", "y_ens_var", "x_posterior_var", "y_posterior_var")


def eks_file(path, rows, kinds=EKS):
    """Write one body part of one animal."""
    header = [["scorer", *("eks" for _ in kinds)], ["bodyparts", *("paw" for _ in kinds)], ["coords", *kinds]]
    lines = [",".join(map(str, row)) for row in (*header, *rows)]
    path.write_text("\n".join(lines) + "\n")


def test_variances_give_the_noise_of_each_detection(tmp_path):
    eks_file(
        tmp_path / "a.csv",
        [[0, 1, 2, 0.9, 1, 4, 4, 1, 9], [1, 3, 4, 0.8, 1, 4, 4, "", ""], [2, 3, 4, 0.8, 1, 4, 4, 0, 0]],
    )
    detections = read_detections(tmp_path)
    np.testing.assert_array_equal(np.asarray(detections.keypoints_px)[0, 0], [1.0, 2.0])
    np.testing.assert_allclose(np.asarray(detections.sigma_px)[:, 0], [5.0**0.5, np.nan, np.nan])
    assert "x_ens_median" in detections.notes[0]
    assert "posterior" not in detections.notes[0]


def test_ensemble_variances_are_used_without_posterior_variances(tmp_path):
    eks_file(tmp_path / "a.csv", [[0, 1, 2, 0.9, 1, 4, 16]], EKS[:6])
    assert np.asarray(read_detections(tmp_path).sigma_px)[0, 0] == pytest.approx(10.0**0.5)


def test_without_variances_there_are_no_standard_deviations(tmp_path):
    eks_file(tmp_path / "a.csv", [[0, 1, 2, 0.9]], EKS[:3])
    assert read_detections(tmp_path).sigma_px is None


def test_table_whose_pickle_executes_code_is_refused(tmp_path):
    class Evil:
        def __reduce__(self):
            return (print, ("ran",))

    folder = keypoint_files.deeplabcut_h5(example_detections(), tmp_path)
    with h5py.File(folder / "trial_left_dlc.h5", "a") as file:
        file["df_with_missing"].attrs["non_index_axes"] = np.void(pickle.dumps(Evil(), protocol=0))
    with pytest.raises(FileError, match="only numbers and strings are read"):
        read_detections(folder)


def test_table_whose_pickle_allocates_gigabytes_is_refused(tmp_path):
    """The pickle uses memo index 999,999,999."""
    folder = keypoint_files.deeplabcut_h5(example_detections(), tmp_path)
    with h5py.File(folder / "trial_left_dlc.h5", "a") as file:
        file["df_with_missing"].attrs["non_index_axes"] = np.void(b"(lp999999999\n.")
    with pytest.raises(FileError, match="allocates memory for 999999999 values"):
        read_detections(folder)


def test_people_of_different_lengths_are_an_error(tmp_path):
    folder = keypoint_files.coco_results(example_detections(), tmp_path)
    file = folder / "left.json"
    content = json.loads(file.read_text())
    content[1]["keypoints"] = content[1]["keypoints"][:-3]
    file.write_text(json.dumps(content))
    with pytest.raises(FileError, match=r"left.json, frame 0: a person has 16 keypoints, but others have 17"):
        read_detections(folder)


def read_broken(name: str, folder, cases: int) -> int:
    """Read broken recordings of a format and return how many were still readable."""
    detections = example_detections(1 if name in ONE else 2, body=SKELETONS.get(name))
    path = WRITERS[name](detections, folder)
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    rng = np.random.default_rng(len(name))
    read = 0
    for case in range(cases):
        file = files[case % len(files)]
        original = file.read_bytes()
        file.write_bytes(broken(original, rng))
        try:
            # Read arrays that stay in their file, too.
            pixels = np.asarray(read_detections(path, detections.skeleton).keypoints_px[:])
        except PosefuseError:
            pass
        else:
            assert pixels.shape[1:] == (len(detections.skeleton), 2)
            read += 1
        file.write_bytes(original)
    return read


# The netCDF library fails to close a file that it could not open.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_broken_files_raise_posefuse_errors(name, tmp_path):
    assert read_broken(name, tmp_path / "k", 200) < 200


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_many_broken_files_raise_posefuse_errors(name, tmp_path):
    assert read_broken(name, tmp_path / "k", 10_000) < 10_000


A_FILE_A_CAMERA = (
    "mmpose", "rtmlib", "alphapose", "coco_results", "coco_annotations", "deeplabcut_many", "deeplabcut_h5",
    "deeplabcut", "sleap", "opencap", "eks", "payload_arrays", "mediapipe_json", "mediapipe_wide", "mediapipe_long",
    "detection_folder",
)  # fmt: skip


def damage(kind: str, content: bytes) -> bytes:
    """Return damaged content: empty, zeros, or the first half, up to a comma if there is one."""
    half = content.rfind(b",", 0, len(content) // 2)
    return {"empty": b"", "zeros": bytes(len(content)), "half": content[:half]}[kind]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("kind", ["empty", "zeros", "half"])
@pytest.mark.parametrize("name", A_FILE_A_CAMERA)
def test_damaged_file_of_one_camera_is_an_error_that_names_it(name, kind, tmp_path):
    detections = example_detections(1 if name in ONE else 2, body=SKELETONS.get(name))
    path = WRITERS[name](detections, tmp_path / "keypoints")
    for file in sorted(file for file in path.rglob("*") if file.is_file()):
        whole = file.read_bytes()
        file.write_bytes(damage(kind, whole))
        with pytest.raises(FileError) as error:
            read_detections(path, detections.skeleton)
        assert file.name in str(error.value)
        file.write_bytes(whole)


@pytest.mark.parametrize("name", ["alphapose", "coco_results", "rtmlib"])
def test_camera_without_people_is_kept(name, tmp_path):
    original = example_detections()
    path = WRITERS[name](original, tmp_path / "keypoints")
    next(file for file in path.rglob("*.json") if "right" in str(file)).write_text("[]")
    detections = read_detections(path, original.skeleton)
    assert detections.view_names == ("left", "right")
    assert detections.people_counts[:, 1].tolist() == [0] * 6


@pytest.mark.parametrize("name", ["alphapose", "coco_results", "mmpose", "payload_arrays", "mediapipe_json"])
def test_other_files_in_the_folder_are_ignored(name, tmp_path):
    detections = example_detections(body=SKELETONS.get(name))
    path = WRITERS[name](detections, tmp_path / "keypoints")
    (path / "settings.json").write_text('{"model": "large", "loss": NaN}')
    (path / "._left.json").write_bytes(b"\0\5\x16\7")
    assert read_detections(path, detections.skeleton).view_names == detections.view_names


@pytest.mark.parametrize("name", ["openpose", "easymocap"])
def test_first_frame_of_a_camera_that_is_damaged_is_named(name, tmp_path):
    path = WRITERS[name](example_detections(), tmp_path / "keypoints")
    first = min(path.rglob("*.json"))
    first.write_bytes(b"")
    with pytest.raises(FileError, match=first.name):
        read_detections(path, "coco_17")


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_is_found_in_a_folder(name, tmp_path):
    original = example_detections(1, body=SKELETONS.get(name))
    WRITERS[name](original, tmp_path / "recording" / "keypoints")
    (recording,) = find_recording(tmp_path / "recording").keypoints
    assert read_detections(recording.path, original.skeleton).view_names == original.view_names


@pytest.mark.parametrize(
    "name", ["detection_folder", "payload_arrays", "mediapipe_json", "mediapipe_wide", "mediapipe_long", "deeplabcut"]
)
def test_camera_with_an_empty_file_is_an_error(name, tmp_path):
    path = WRITERS[name](example_detections(1, body=SKELETONS.get(name)), tmp_path)
    max(file for file in tmp_path.rglob("*") if file.is_file()).write_bytes(b"")
    with pytest.raises(FileError, match=r"truncated"):
        read_detections(path)


def test_skeleton_of_another_number_is_refused(tmp_path):
    path = WRITERS["replay_without_head"](example_detections(), tmp_path)
    with pytest.raises((FileError, SkeletonError), match="17 keypoints per person"):
        read_detections(path, "body_25")
