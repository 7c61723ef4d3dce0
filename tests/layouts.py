"""Recordings in the folder layouts of other programs."""

import json
import shutil

import numpy as np

from posefuse.io.calibration import anipose
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
    for v, name in enumerate(VIEWS):
        (folder / "synchronized_videos" / f"{name}.mp4").touch()
        skellycam_times(folder / "synchronized_videos" / "timestamps", name, np.arange(len(pixels)) / 25 + 0.003 * v)
    anipose.write(SCENE.rig, folder / "rec_camera_calibration.toml")


def skellycam_times(folder, name, time_s):
    """Write the times of a video like FreeMoCap 1.8: nanoseconds of the computer's clock, as an array and as text."""
    times_ns = np.round(1e9 * (81_000 + np.asarray(time_s)))
    np.save(folder / f"{name}_binary.npy", times_ns)
    rows = [",0", *(f"{f},{time}" for f, time in enumerate(times_ns))]
    (folder / f"{name}_timestamps_human_readable.csv").write_text("\n".join(rows) + "\n")


def anipose_session(folder):
    """Write a session with the videos of the board beside the calibration, as Anipose stores them."""
    anipose.write(SCENE.rig, folder / "calibration" / "calibration.toml")
    for name in ("board-camA.avi", "zoom-camB.avi"):
        (folder / "calibration" / name).touch()
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


def opencap_download(folder):
    """Write a session as OpenCap's web application exports it."""
    opencap_pickles(folder)
    for file in list(folder.glob("Videos/*/OutputPkl_default/walk/walk_rotated_pp.pkl")):
        camera = file.parents[2]
        (camera / "OutputPkl").mkdir()
        file.rename(camera / "OutputPkl" / "walk_keypoints.pkl")
        shutil.rmtree(camera / "OutputPkl_default")
    (folder / "Videos" / "mappingCamDevice.pickle").write_bytes(b"the cameras of the devices")


def caliscope(folder):
    calibrations.caliscope_old(SCENE.rig, folder)
    header = "sync_index,cam_id,frame_index,frame_time,object_id,keypoint_id,img_loc_x,img_loc_y"
    rows = [
        f"{f},{c},{f},{100 + f / 20 + 0.01 * c},0,{k},{k + 5},9" for f in range(4) for c in (0, 1) for k in range(3)
    ]
    (folder / "xy_POSE.csv").write_text("\n".join([header, *rows]) + "\n")


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
    actual = [{"image_id": 12, "coco_keypoints": [1.0, 2.0, 0.5] * 17, "keypoints": []}]
    (folder / "openpose_kps.json").write_text(json.dumps(actual))
