"""Hands and faces in OpenPose files are read as openpose_137 and written from it."""

import json
from pathlib import Path

import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.keypoints import openpose
from posefuse.io.keypoints.openpose_parts import HAND_AND_FACE_LISTS
from posefuse.io.results import openpose as overlays
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate

WHOLE = shipped_skeleton("openpose_137")


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(skeleton="openpose_137", duration_s=0.15, cameras=2, detector=CLEAN))


def write(detections: Detections, folder: Path) -> Path:
    openpose.write(detections, folder)
    return folder


def change(folder: Path, keys: tuple[str, ...], every: int = 1) -> None:
    """Empty some lists of every n-th file."""
    for path in sorted(folder.rglob("*_keypoints.json"))[::every]:
        content = json.loads(path.read_text())
        for person in content["people"]:
            person.update({key: [] for key in keys})
        path.write_text(json.dumps(content))


def test_hands_and_faces_are_read_by_default(scene, tmp_path):
    detections = read_detections(write(scene.detections, tmp_path / "pose"))
    assert detections.skeleton == WHOLE
    assert [note[:31] for note in detections.notes] == ["25 keypoints read as body_25, w"]
    for first, second in zip(detections.dense(), scene.detections.dense(), strict=True):
        np.testing.assert_array_equal(first, second)


def test_keypoint_lists_equal_those_of_openpose(scene, tmp_path):
    first = min(write(scene.detections, tmp_path / "pose").rglob("*_keypoints.json"))
    person = json.loads(first.read_text())["people"][0]
    lengths = {key: len(values) for key, values in person.items() if key.endswith("_2d")}
    assert lengths == {
        "pose_keypoints_2d": 75, "hand_left_keypoints_2d": 63, "hand_right_keypoints_2d": 63, "face_keypoints_2d": 210,
    }  # fmt: skip
    root = scene.detections.dense()[0][0, 0, WHOLE.index("left_hand_root")]
    assert person["hand_left_keypoints_2d"][:2] == root.tolist()
    nose = scene.detections.dense()[0][0, 0, WHOLE.index("face_30")]
    assert person["face_keypoints_2d"][90:92] == nose.tolist()


def test_bodies_without_hands_are_read_as_bodies(scene, tmp_path):
    folder = write(scene.detections, tmp_path / "pose")
    change(folder, tuple(part.key for part in HAND_AND_FACE_LISTS))
    detections = read_detections(folder)
    assert detections.skeleton.name == "body_25"
    assert [note[:31] for note in detections.notes] == ["25 keypoints read as body_25, w"]
    np.testing.assert_array_equal(detections.dense()[0], scene.detections.dense()[0][..., :25, :])


def test_missing_lists_are_reported(scene, tmp_path):
    folder = write(scene.detections, tmp_path / "pose")
    change(folder, ("face_keypoints_2d",))
    change(folder, ("hand_left_keypoints_2d",), every=2)
    detections = read_detections(folder)
    people = detections.offsets[-1]
    lacking = len(sorted(folder.rglob("*_keypoints.json"))[::2])
    assert detections.skeleton == WHOLE
    assert detections.notes[1:] == (
        f"These files have left hands of {people - lacking} of {people} detected people, no faces. The other keypoints "
        "of openpose_137 are missing.",
    )
    places = np.isfinite(np.asarray(detections.keypoints_px)[..., 0])
    assert not places[:, 67:].any()
    assert places[:, 25:46].any(axis=1).sum() == people - lacking
    assert places[:, 46:67].any(axis=1).all()


def test_requested_body_skeleton_ignores_hands_and_faces(scene, tmp_path):
    detections = read_detections(write(scene.detections, tmp_path / "pose"), "body_25")
    assert detections.skeleton.name == "body_25"
    assert "`skeleton='openpose_137'`" in detections.notes[0]


def test_other_bodies_with_hands_are_read_as_bodies(tmp_path):
    bodies = simulate(SceneOptions(skeleton="body_25b", duration_s=0.3, cameras=2)).detections
    folder = write(bodies, tmp_path / "pose")
    for path in folder.rglob("*_keypoints.json"):
        content = json.loads(path.read_text())
        for person in content["people"]:
            person["hand_left_keypoints_2d"] = [5.0, 6.0, 0.5] * 21
        path.write_text(json.dumps(content))
    detections = read_detections(folder)
    assert detections.skeleton.name == "body_25b"
    assert any("Hands and faces in these files are not read" in note for note in detections.notes)
    with pytest.raises(FileError, match="17 body keypoints, but skeleton openpose_137 has 25"):
        other = simulate(SceneOptions(skeleton="coco_17", duration_s=0.1, cameras=2)).detections
        read_detections(write(other, tmp_path / "other"), "openpose_137")


def test_hands_of_another_size_are_an_error(scene, tmp_path):
    folder = write(scene.detections, tmp_path / "pose")
    path = min(folder.rglob("*_keypoints.json"))
    content = json.loads(path.read_text())
    content["people"][0]["hand_left_keypoints_2d"].pop()
    path.write_text(json.dumps(content))
    with pytest.raises(FileError, match="person 0: hand_left_keypoints_2d has 62 numbers; expected x, y, confidence"):
        read_detections(folder)


def test_view_without_people(scene, tmp_path):
    folder = write(scene.detections, tmp_path / "pose")
    for path in (folder / scene.detections.view_names[1]).glob("*.json"):
        path.write_text('{"people": []}')
    for skeleton in (None, "body_25"):
        detections = read_detections(folder, skeleton)
        assert detections.people_counts[:, 1].tolist() == [0] * detections.n_frames
        assert detections.recorded.all()


def test_overlays_have_hands_and_faces_in_the_right_lists(scene, tmp_path):
    overlays.write(scene.truth, tmp_path / "overlay", "measured")
    detections = read_detections(tmp_path / "overlay")
    assert detections.skeleton == WHOLE
    pixels = scene.rig.cameras[0].project(np.asarray(scene.truth.layers["measured"].points_m)[0, 0])[0]
    np.testing.assert_allclose(detections.dense()[0][0, 0], pixels, atol=5e-4)
