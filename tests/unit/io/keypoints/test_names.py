"""Names of views, trials and keypoints in file names."""

import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.calibration import anipose
from posefuse.io.keypoints.names import recordings_in, view_names
from posefuse.io.recording import find_recording
from posefuse.skeleton.from_names import skeleton_of
from tests.layouts import (
    SCENE,
    VIEWS,
    predictions,
)


def test_files_of_several_trials_are_refused(tmp_path):
    files = [tmp_path / name for name in ("t1_A_x.csv", "t1_B_x.csv", "t2_A_y.csv")]
    with pytest.raises(FileError, match="differ in more than the camera"):
        view_names(files)


@pytest.mark.parametrize(
    ("left", "right"), [("left_paw", "right_paw"), ("Ear_L", "Ear_R"), ("L_ear", "R_ear"), ("Paw_left", "Paw_right")]
)
def test_left_and_right_are_inferred_from_names(left, right):
    assert skeleton_of("animal", ("nose", right, left)).pairs == ((left, right),)
    assert skeleton_of("animal", ("tail", left)).pairs == ()


def test_trials_in_one_folder_are_separate_recordings(tmp_path):
    predictions(tmp_path, "fly_{trial}_Cam-{camera}_net.csv", trials=("1", "2"))
    recording = [item.path.name for item in find_recording(tmp_path).keypoints]
    assert recording == ["fly_1_Cam-*_net.csv", "fly_2_Cam-*_net.csv"]
    detections = read_detections(tmp_path / recording[1])
    assert detections.view_names == ("Cam-A", "Cam-B")
    with pytest.raises(FileError, match=r"Choose one of the recordings:\s+`keypoints='.*fly_1_Cam-\*_net.csv'"):
        read_detections(tmp_path)
    with pytest.raises(FileError, match="No keypoints at"):
        read_detections(tmp_path / "fly_3_*.csv")


def test_trials_are_separated_by_camera_names(tmp_path):
    anipose.write(SCENE.rig, tmp_path / "calibration.toml")
    names = [name.removeprefix("cam_") for name in VIEWS]
    files = [tmp_path / f"{trial}-{name}.csv" for trial in ("run", "walk") for name in names]
    assert recordings_in(files) == []
    assert recordings_in(files, VIEWS) == ["run-*.csv", "walk-*.csv"]
