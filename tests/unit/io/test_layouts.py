"""Recordings in the folder layouts of other programs are found and matched, and other files are reported."""

import json
import pickle

import numpy as np
import pytest

from posefuse import Options, read_cameras, read_detections
from posefuse.cli.main import main
from posefuse.errors import DetectionsError, FileError
from posefuse.io.calibration import anipose
from posefuse.io.files import read_npz
from posefuse.io.keypoints.names import recordings_in
from posefuse.io.recording import choose_calibration, choose_keypoints, find_recording, ignored_in
from posefuse.model.view_names import has_name
from posefuse.preprocess.match_cameras import match_views
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests import calibrations, keypoint_files
from tests.files import write_openpose

SCENE = simulate(SceneOptions(skeleton="body_25", duration_s=0.2, cameras=2))
VIEWS = SCENE.detections.view_names


def predictions(folder, pattern, trials=("1",), cameras=("A", "B")):
    """Write DeepLabCut files of one body part, named by trial and camera."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = ["scorer,n,n,n", "bodyparts,paw,paw,paw", "coords,x,y,likelihood", *(f"{f},{f}.5,2,0.9" for f in range(3))]
    for trial in trials:
        for camera in cameras:
            (folder / pattern.format(trial=trial, camera=camera)).write_text("\n".join(rows) + "\n")


def freemocap(folder):
    raw = folder / "output_data" / "raw_data"
    raw.mkdir(parents=True)
    pixels, _ = SCENE.detections.dense()
    three = np.concatenate([np.moveaxis(pixels, 1, 0), np.zeros((2, len(pixels), 25, 1))], axis=-1)
    np.save(raw / "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy", three)
    np.save(raw / "mediapipe_3dData_numFrames_numTrackedPoints_spatialXYZ.npy", np.zeros((6, 25, 3)))
    (folder / "synchronized_videos" / "timestamps").mkdir(parents=True)
    for name in VIEWS:
        (folder / "synchronized_videos" / f"{name}.mp4").touch()
        times = 1e9 * (1_700_000_000 + np.arange(len(pixels)) / 25)
        np.save(folder / "synchronized_videos" / "timestamps" / f"{name}_timestamps.npy", times)
    anipose.write(SCENE.rig, folder / "rec_camera_calibration.toml")


def anipose_session(folder):
    anipose.write(SCENE.rig, folder / "calibration" / "calibration.toml")
    predictions(folder / "pose-2d", "2019-08-02-vid01-{camera}.csv", cameras=VIEWS)
    (folder / "videos-raw").mkdir()
    (folder / "videos-raw" / "vid.avi").touch()


def easymocap(folder):
    calibrations.easymocap(SCENE.rig, folder)
    keypoint_files.easymocap(SCENE.detections, folder / "annots")


def opencap(folder):
    calibrations.opencap(SCENE.rig, folder / "Videos")
    write_openpose(folder / "Keypoints", SCENE.detections, "")
    (folder / "Videos" / "out.pkl").touch()


def opencap_pickles(folder):
    calibrations.opencap(SCENE.rig, folder / "Videos")
    keypoint_files.opencap(SCENE.detections, folder / "Videos")


def caliscope(folder):
    calibrations.caliscope_old(SCENE.rig, folder)
    header = "sync_index,cam_id,frame_index,frame_time,object_id,keypoint_id,img_loc_x,img_loc_y"
    rows = [
        f"{f},{c},{f},{100 + f / 20 + 0.01 * c},0,{k},{k + 5},9" for f in range(4) for c in (0, 1) for k in range(3)
    ]
    (folder / "xy_POSE.csv").write_text("\n".join([header, *rows]) + "\n")


LAYOUTS = {
    freemocap: ("anipose", "freemocap"),
    anipose_session: ("anipose", "deeplabcut"),
    easymocap: ("easymocap", "easymocap"),
    opencap: ("opencap", "openpose"),
    opencap_pickles: ("opencap", "opencap"),
    caliscope: ("caliscope", "caliscope"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_is_found_and_its_views_match_cameras(layout, tmp_path, capsys):
    layout(tmp_path)
    found = find_recording(tmp_path)
    assert (found.calibrations[0].format, found.keypoints[0].format) == LAYOUTS[layout]
    detections = read_detections(choose_keypoints(found))
    rig, chosen, _ = match_views(read_cameras(choose_calibration(found)), detections, Options())
    assert (len(rig), chosen.n_views) == (2, 2)
    main(["inspect", str(tmp_path)])
    said = " ".join(capsys.readouterr().out.split())
    assert f"recognized by: {found.keypoints[0].recognized_by}" in said
    assert "2 views match 2 cameras; posefuse reconstruct can process this folder" in said
    assert "cannot be read" not in said


def test_times_of_freemocap_are_found_and_start_at_zero(tmp_path, capsys):
    freemocap(tmp_path)
    main(["inspect", str(tmp_path)])
    said = " ".join(capsys.readouterr().out.split())
    assert "times read as nanoseconds" in said
    assert "rate 25 Hz" in said
    assert "frames 0 to 5, 0.000 to 0.200 s" in said
    assert "images and videos" in said
    assert "spatialXYZ.npy: 3D results" in said


def test_files_that_are_not_read_are_listed_with_the_reason(tmp_path):
    opencap(tmp_path)
    for name in ("person.trc", "notes.md", "strange.json", "model.slp"):
        (tmp_path / name).touch()
    reasons = {name: each.reason for each in ignored_in(find_recording(tmp_path)) for name in each.names}
    assert set(reasons) == {"person.trc", "notes.md", "strange.json", "model.slp", "Videos/out.pkl"}
    assert "3D" in reasons["person.trc"]
    assert "pickle" in reasons["Videos/out.pkl"]
    assert "known format" in reasons["strange.json"]


def test_trials_of_opencap_are_separate_recordings(tmp_path):
    opencap_pickles(tmp_path)
    for camera in VIEWS:
        folder = tmp_path / "Videos" / camera / "OutputPkl_default"
        (folder / "jump").mkdir()
        whole = (folder / "walk" / "walk_rotated_pp.pkl").read_bytes()
        (folder / "jump" / "jump_rotated_pp.pkl").write_bytes(whole)
        (folder / "jump" / "jump_rotated.pkl").write_bytes(b"the detector's own")
    found = find_recording(tmp_path)
    assert [item.path.name for item in found.keypoints] == ["jump_rotated_pp.pkl", "walk_rotated_pp.pkl"]
    assert read_detections(found.keypoints[1].path).view_names == VIEWS
    with pytest.raises(FileError, match=r"has 2 OpenCap trials.*\n  --keypoints .*jump_rotated_pp.pkl"):
        read_detections(tmp_path / "Videos")
    left = {name for each in ignored_in(found) for name in each.names}
    assert left == {f"Videos/{camera}/OutputPkl_default/jump/jump_rotated.pkl" for camera in VIEWS}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (pickle.dumps([[print]]), "refers to builtins.print"),
        (pickle.dumps({"frames": []}), "expected a list of frames"),
        (pickle.dumps([[{"preds_with_flip": [1.0]}]]), "frame 0: a person without pose_keypoints_2d"),
        (pickle.dumps([["nobody"]]), "frame 0: a person without pose_keypoints_2d"),
        (pickle.dumps([[{"pose_keypoints_2d": ["x"]}]]), "frame 0: a person without pose_keypoints_2d"),
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


def test_trials_in_one_folder_are_separate_recordings(tmp_path):
    predictions(tmp_path, "fly_{trial}_Cam-{camera}_net.csv", trials=("1", "2"))
    found = [item.path.name for item in find_recording(tmp_path).keypoints]
    assert found == ["fly_1_Cam-*_net.csv", "fly_2_Cam-*_net.csv"]
    detections = read_detections(tmp_path / found[1])
    assert detections.view_names == ("Cam-A", "Cam-B")
    with pytest.raises(FileError, match=r"Choose one of the recordings:\s+--keypoints '.*fly_1_Cam-\*_net.csv'"):
        read_detections(tmp_path)
    with pytest.raises(FileError, match="No keypoints at"):
        read_detections(tmp_path / "fly_3_*.csv")


def test_trials_are_separated_by_camera_names(tmp_path):
    anipose.write(SCENE.rig, tmp_path / "calibration.toml")
    names = [name.removeprefix("cam_") for name in VIEWS]
    files = [tmp_path / f"{trial}-{name}.csv" for trial in ("run", "walk") for name in names]
    assert recordings_in(files) == []
    assert recordings_in(files, VIEWS) == ["run-*.csv", "walk-*.csv"]


@pytest.mark.parametrize(
    ("view", "camera", "has"),
    [("2019-08-02-vid01-camA", "A", True), ("trial_top", "Top", True), ("trial_1", "10", False), ("camAB", "A", False)],
)
def test_a_camera_name_is_found_as_a_word_of_the_view_name(view, camera, has):
    assert has_name(view, camera) == has


class TestArrays:
    def test_cameras_and_points_of_one_file(self, tmp_path):
        """Read the arrays of one rig, world to camera."""
        rig = SCENE.rig
        content = {
            "K": np.stack([c.matrix for c in rig.cameras]), "R": np.stack([c.rotation for c in rig.cameras]),
            "tvec": np.stack([c.translation_m for c in rig.cameras]), "points2d_px": np.ones((2, 4, 38, 2)),
            "names": np.array(rig.names), "size": np.array([c.size_px for c in rig.cameras]),
        }  # fmt: skip
        np.savez(tmp_path / "fly.npz", **content)
        found = read_cameras(tmp_path / "fly.npz", length_unit="m")
        for a, b in zip(found.cameras, rig.cameras, strict=True):
            assert (a.name, a.size_px) == (b.name, b.size_px)
            np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-12)
        fly = read_detections(tmp_path / "fly.npz")
        assert (fly.skeleton.name, fly.view_names, fly.n_frames) == ("fly_38", ("0", "1"), 4)
        np.savez(tmp_path / "fly.npz", **(content | {"tvec": np.zeros((3, 3))}))
        with pytest.raises(FileError, match=r"t should have 2 cameras, as K has; got shape \(3, 3\)"):
            read_cameras(tmp_path / "fly.npz")

    def test_points_without_a_skeleton(self, tmp_path):
        np.save(tmp_path / "p2d.npy", np.array([[[1.0, 2], [3, 4]], [[np.nan, np.nan], [5, 6]]]))
        found = read_detections(tmp_path / "p2d.npy")
        assert found.skeleton.keypoints == ("point",)
        np.testing.assert_array_equal(found.dense()[0][:, 0, 0], [[1, 2], [3, 4]])

    def test_a_bomb_is_refused(self, tmp_path, monkeypatch):
        """The limit is lowered, so that megabytes of zeros stand for gigabytes."""
        monkeypatch.setattr("posefuse.io.files._LARGE_BYTES", 256_000)
        file = tmp_path / "bomb.npz"
        np.savez_compressed(file, keypoints=np.zeros((2, 20_000, 17, 2)))
        with pytest.raises(FileError, match=r"would expand to 10880128 bytes"):
            read_detections(file)
        assert set(read_npz(file, ())) == {"keypoints"}

    def test_objects_are_refused(self, tmp_path):
        np.save(tmp_path / "evil.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
        with pytest.raises(FileError, match="not a complete NumPy array file: Object arrays cannot be loaded"):
            read_detections(tmp_path / "evil.npy")


def operating_room(folder):
    """Write small files in the format of MVOR."""
    pose = np.eye(4)
    pose[:3, 3] = 1000.0, 0.0, 0.0
    lens = {"focallength": [500, 510], "principalpoint": [320, 240], "imagesize": [640, 480], "skew_value": 0}
    parameters = {"intrinsics": [lens, lens], "extrinsics": [np.eye(4).ravel().tolist(), pose.ravel().tolist()]}
    people = [{"image_id": 21, "person_id": 4, "keypoints": [5, 6, 2, 0, 0, 0]}]
    data = {
        "multiview_images": [{"images": [{"id": 10 * f + v} for v in (1, 2)]} for f in (1, 2)],
        "annotations": people, "categories": [{"keypoints": ["head", "neck"], "skeleton": [[1, 2]]}],
        "cameras_info": {"camParams": parameters},
    }  # fmt: skip
    (folder / "camma_mvor_2018.json").write_text(json.dumps(data))
    found = [{"image_id": 12, "coco_keypoints": [1.0, 2.0, 0.5] * 17, "keypoints": []}]
    (folder / "openpose_kps.json").write_text(json.dumps(found))


class TestMvor:
    def test_poses_are_relative_to_the_first_camera(self, tmp_path):
        operating_room(tmp_path)
        rig = read_cameras(tmp_path / "camma_mvor_2018.json")
        np.testing.assert_allclose(rig.cameras[1].center_m, [1.0, 0.0, 0.0])

    def test_annotated_and_detected_people(self, tmp_path):
        operating_room(tmp_path)
        by_hand = read_detections(tmp_path / "camma_mvor_2018.json")
        assert (by_hand.view_names, by_hand.n_frames) == (("camera_1", "camera_2"), 2)
        assert by_hand.people_counts.tolist() == [[0, 0], [1, 0]]
        assert by_hand.track_ids[0] == 4
        assert np.isnan(np.asarray(by_hand.keypoints_px)[0, 1]).all()
        detected = read_detections(tmp_path / "openpose_kps.json")
        assert detected.people_counts.tolist() == [[0, 1], [0, 0]]
        (tmp_path / "camma_mvor_2018.json").unlink()
        with pytest.raises(FileError, match="is required beside it"):
            read_detections(tmp_path / "openpose_kps.json")


def test_implausible_frame_numbers_are_an_error(tmp_path):
    people = [{"image_id": 10_010_000_001, "category_id": 1, "keypoints": [1.0, 2.0, 0.5] * 17, "score": 1.0}]
    (tmp_path / "a.json").write_text(json.dumps(people))
    with pytest.raises(FileError, match="frames are numbered up to 10010000001"):
        read_detections(tmp_path)


@pytest.mark.parametrize(
    ("tracker", "third", "field"),
    [("mediapipe_", 0.5, "depth"), ("openpose_", 0.5, "confidence"), ("yolo_", np.nan, None)],
)
def test_the_third_channel_depends_on_the_tracker(tracker, third, field, tmp_path):
    freemocap(tmp_path)
    (array,) = (tmp_path / "output_data" / "raw_data").glob("*2dData*")
    content = np.load(array)
    content[..., 2] = np.where(np.isnan(content[..., 0]), np.nan, third)
    array.unlink()
    np.save(array.with_name(array.name.replace("mediapipe_", tracker)), content)
    found = read_detections(tmp_path, "body_25")
    for name in ("depth", "confidence"):
        values = getattr(found, name)
        assert bool(values is not None and np.isfinite(values).any()) is (name == field)


def test_an_unknown_third_channel_is_an_error(tmp_path):
    freemocap(tmp_path)
    (array,) = (tmp_path / "output_data" / "raw_data").glob("*2dData*")
    array.rename(array.with_name("rtmpose_2dData_pixelXY.npy"))
    with pytest.raises(DetectionsError, match="--third-channel"):
        read_detections(tmp_path, "body_25")
