"""DeepLabCut and SLEAP: one file per camera, views by file names, skeletons by keypoint names."""

import json

import h5py
import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError
from posefuse.io.keypoints.names import skeleton_of, view_names
from tests import keypoint_files
from tests.unit.io.keypoints.test_keypoint_formats import some

CHECKPOINT_FOLDER = ("nose", "ear_L", "ear_R", "tail")


def write_deeplabcut(file, values):
    """Return values of shape (frame, part, 3)."""
    rows = [
        ["scorer"] + ["net"] * 3 * len(CHECKPOINT_FOLDER),
        ["bodyparts"] + [part for part in CHECKPOINT_FOLDER for _ in range(3)],
        ["coords"] + ["x", "y", "likelihood"] * len(CHECKPOINT_FOLDER),
        *[[n, *["" if np.isnan(v) else repr(float(v)) for v in row.ravel()]] for n, row in enumerate(values)],
    ]
    file.write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n")


def write_sleap(file, pixels, scores):
    """Return pixels (track, frame, node, 2) and scores (track, frame, node)."""
    with h5py.File(file, "w") as content:
        content["tracks"] = pixels.transpose(0, 3, 2, 1)
        content["point_scores"] = scores.transpose(0, 2, 1)
        content["node_names"] = np.array([part.encode() for part in CHECKPOINT_FOLDER])
        content["edge_inds"] = np.array([[0, 1], [0, 2], [0, 3]])


@pytest.fixture
def values(rng):
    values = rng.uniform(1, 500, (7, 4, 3))
    values[..., 2] = rng.uniform(0.1, 1.0, (7, 4))
    values[2, 1] = np.nan
    return values


def test_deeplabcut_survives_a_round_trip(tmp_path, values):
    for name, shift in (("A", 0.0), ("B", 5.0), ("C", 9.0)):
        write_deeplabcut(tmp_path / f"trial_1_Cam-{name}_resnet.csv", values + np.array([shift, 0.0, 0.0]))
    found = posefuse.read_detections(tmp_path)
    assert found.view_names == ("Cam-A", "Cam-B", "Cam-C")
    assert found.skeleton.keypoints == CHECKPOINT_FOLDER
    assert found.skeleton.pairs == (("ear_L", "ear_R"),)
    assert found.n_frames == 7
    pixels = np.asarray(found.keypoints_px).reshape(7, 3, 4, 2)
    np.testing.assert_array_equal(pixels[:, 1], values[..., :2] + np.array([5.0, 0.0]))
    np.testing.assert_array_equal(np.asarray(found.confidence).reshape(7, 3, 4)[:, 2], values[..., 2])


def test_a_truncated_deeplabcut_file_is_reported_with_its_line(tmp_path, values):
    file = tmp_path / "cam.csv"
    write_deeplabcut(file, values)
    text = file.read_text()
    file.write_text(text[: len(text) - 40])
    with pytest.raises(FileError, match=r"line 10: .*truncated"):
        posefuse.read_detections(file)


def test_sleap_survives_a_round_trip_with_tracks(tmp_path, rng):
    pixels = rng.uniform(1, 500, (2, 6, 4, 2))
    pixels[1, 3:] = np.nan
    scores = rng.uniform(0.2, 1.0, (2, 6, 4))
    for camera in ("top", "side"):
        (tmp_path / camera).mkdir()
        write_sleap(tmp_path / camera / "mouse.analysis.h5", pixels, scores)
    found = posefuse.read_detections(tmp_path)
    assert found.view_names == ("side", "top")
    assert found.skeleton.edges == (("nose", "ear_L"), ("nose", "ear_R"), ("nose", "tail"))
    np.testing.assert_array_equal(found.people_counts, [[2, 2]] * 3 + [[1, 1]] * 3)
    np.testing.assert_array_equal(np.asarray(found.keypoints_px)[1], pixels[1, 0])
    np.testing.assert_array_equal(np.asarray(found.confidence)[1], scores[1, 0])
    assert set(np.asarray(found.track_ids).tolist()) == {0, 1}


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


def test_a_camera_with_a_truncated_file_is_an_error(tmp_path, rng, values):
    for camera in ("side", "top"):
        (tmp_path / camera).mkdir()
        write_sleap(tmp_path / camera / "mouse.analysis.h5", rng.uniform(1, 9, (1, 5, 4, 2)), np.ones((1, 5, 4)))
    cut = tmp_path / "top" / "mouse.analysis.h5"
    cut.write_bytes(cut.read_bytes()[:1000])
    with pytest.raises(FileError, match=r"top.*1000 bytes.*truncated"):
        posefuse.read_detections(tmp_path)
    folder = tmp_path / "dlc"
    folder.mkdir()
    for name in ("A", "B"):
        write_deeplabcut(folder / f"trial_{name}_net.csv", values)
    for kept in ("", "scorer,net,net\nbodyparts,nose,nose\n"):
        (folder / "trial_B_net.csv").write_text(kept)
        with pytest.raises(FileError, match=r"trial_B_net.csv contains no frames"):
            posefuse.read_detections(folder)


def test_analysis_files_whose_axes_are_named(tmp_path):
    """sleap-io uses another order of axes, which the shape does not reveal for two animals."""
    folder = keypoint_files.sleap(some(), tmp_path / "usual")
    usual = posefuse.read_detections(folder)
    for file in folder.iterdir():
        with h5py.File(file, "a") as content:
            for name, order, dims in (
                ("tracks", (3, 0, 2, 1), ["frame", "track", "node", "xy"]),
                ("point_scores", (2, 0, 1), ["frame", "track", "node"]),
            ):
                values = np.asarray(content[name]).transpose(order)
                del content[name]
                content[name] = values
                content[name].attrs["dims"] = json.dumps(dims)
    assert posefuse.read_detections(folder) == usual


def test_names_in_meta_info_identify_the_skeleton(tmp_path):
    given = some()
    folder = keypoint_files.mmpose(given, tmp_path / "mmpose")
    animal = [f"part_{i}" for i in range(len(given.skeleton))]
    for names in (given.skeleton.keypoints, animal):
        for file in folder.glob("*.json"):
            content = json.loads(file.read_text())
            content["meta_info"] = {"keypoint_id2name": {str(i): name for i, name in enumerate(names)}}
            file.write_text(json.dumps(content))
        found = posefuse.read_detections(folder)
        assert found.skeleton.keypoints == tuple(names)
    assert found.skeleton.name == "mmpose"
