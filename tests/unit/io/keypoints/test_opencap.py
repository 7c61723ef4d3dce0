"""Keypoints of OpenCap."""

import pickle

import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.recording import find_recording, ignored_in
from tests.layouts import (
    VIEWS,
    opencap_download,
    opencap_pickles,
)


def test_trials_of_opencap_are_separate_recordings(tmp_path):
    opencap_pickles(tmp_path)
    for camera in VIEWS:
        folder = tmp_path / "Videos" / camera / "OutputPkl_default"
        (folder / "jump").mkdir()
        whole = (folder / "walk" / "walk_rotated_pp.pkl").read_bytes()
        (folder / "jump" / "jump_rotated_pp.pkl").write_bytes(whole)
        (folder / "jump" / "jump_rotated.pkl").write_bytes(b"the detector's own")
    recording = find_recording(tmp_path)
    assert [item.path.name for item in recording.keypoints] == ["jump_rotated_pp.pkl", "walk_rotated_pp.pkl"]
    assert read_detections(recording.keypoints[1].path).view_names == VIEWS
    with pytest.raises(FileError, match=r"has 2 OpenCap trials.*\n  `keypoints=.*jump_rotated_pp.pkl"):
        read_detections(tmp_path / "Videos")
    left = {name for each in ignored_in(recording) for name in each.names}
    assert left == {f"Videos/{camera}/OutputPkl_default/jump/jump_rotated.pkl" for camera in VIEWS}


def test_trials_of_a_downloaded_session_are_separate_recordings(tmp_path):
    opencap_download(tmp_path)
    for camera in VIEWS:
        folder = tmp_path / "Videos" / camera / "OutputPkl"
        (folder / "jump_keypoints.pkl").write_bytes((folder / "walk_keypoints.pkl").read_bytes())
    recording = find_recording(tmp_path)
    assert [item.path.name for item in recording.keypoints] == ["jump_keypoints.pkl", "walk_keypoints.pkl"]
    assert read_detections(recording.keypoints[0].path).view_names == VIEWS


@pytest.mark.parametrize("layout", [opencap_pickles, opencap_download])
def test_frame_rate_of_the_session_applies_to_one_trial(layout, tmp_path):
    layout(tmp_path / "session")
    (tmp_path / "session" / "sessionMetadata.yaml").write_text("framerate: 120\n")
    detections = read_detections(find_recording(tmp_path / "session").keypoints[0].path)
    file = next((tmp_path / "session").rglob("walk_*.pkl"))
    assert read_detections(file).rate_hz == detections.rate_hz == 120.0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (pickle.dumps([[print]]), "refers to builtins.print"),
        (pickle.dumps({"frames": []}), "expected a list of frames"),
        (pickle.dumps([[{"preds_with_flip": [1.0]}]]), "frame 0: a person lacks pose_keypoints_2d"),
        (pickle.dumps([["nobody"]]), "frame 0: a person lacks pose_keypoints_2d"),
        (pickle.dumps([[{"pose_keypoints_2d": ["x"]}]]), "frame 0: a person lacks pose_keypoints_2d"),
        (pickle.dumps([[{"pose_keypoints_2d": [10**400] * 75}]]), "frame 0: a keypoint of a person is not a number"),
        (pickle.dumps([[{"pose_keypoints_2d": [1.0] * 75}] * 1000] * 10**4), "would expand to 6000000000 bytes"),
        (pickle.dumps([[{"pose_keypoints_2d": [1.0] * 75}]])[:-40], "is not a complete pickle of OpenCap keypoints"),
    ],
)
def test_pickles_without_opencap_keypoints_are_refused(content, words, tmp_path):
    opencap_pickles(tmp_path)
    file = tmp_path / "Videos" / VIEWS[1] / "OutputPkl_default" / "walk" / "walk_rotated_pp.pkl"
    file.write_bytes(content)
    with pytest.raises(FileError, match=words) as error:
        read_detections(tmp_path / "Videos")
    assert str(file) in str(error.value)
