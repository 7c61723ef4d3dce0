"""caliscope's calibration by its scripting interface; prints its figures as JSON.

``run.py FOLDER --mode board`` calibrates the videos of a ChArUco board, with the lenses of ``camera_array.toml``: once
as its quick start does (bootstrap, then optimize) and once by ``calibrate_extrinsics`` without free lenses.

``run.py FOLDER --mode people`` calibrates by matched keypoints: ``points.npy``, shape (camera, frame, keypoint, 2), and
``lenses.json``, a list of ``size``, ``matrix`` and five ``distortions``. The poses go to ``caliscope.json``: camera to
``rotation`` (3 x 3) and ``translation``.
"""

import argparse
import contextlib
import io
import json
import logging
import time
from pathlib import Path

import numpy as np
import pandas as pd
from caliscope.api import (
    CameraArray,
    CameraData,
    CaptureVolume,
    Charuco,
    CharucoTracker,
    ConstraintSet,
    ImagePoints,
    calibrate_extrinsics,
    extract_image_points_multicam,
)


def without_poses(cameras: CameraArray) -> CameraArray:
    """Remove the poses, which are to be calibrated."""
    for camera in cameras.cameras.values():
        camera.rotation = camera.translation = None
    return cameras


def board(folder: Path) -> dict[str, float]:
    """Calibrate the videos of a board."""
    videos = folder / "calibration" / "extrinsic"
    charuco = Charuco.from_toml(folder / "charuco.toml")
    begun = time.process_time()
    points = extract_image_points_multicam(
        {int(path.stem.split("_")[1]): path for path in sorted(videos.glob("cam_*.mp4"))},
        CharucoTracker(charuco),
        timestamps=videos / "timestamps.csv",
        progress=None,
    )
    detected = time.process_time()
    lenses = without_poses(CameraArray.from_toml(folder / "camera_array.toml"))
    quick = CaptureVolume.bootstrap(points, lenses).optimize()
    solved = time.process_time()
    lenses = without_poses(CameraArray.from_toml(folder / "camera_array.toml"))
    constraints = ConstraintSet.from_charuco(charuco)
    full = calibrate_extrinsics(points, lenses, constraints, refine_intrinsics=False).capture_volume
    ended = time.process_time()
    figures = {"detect_s": detected - begun, "quick_s": solved - detected, "full_s": ended - solved}
    return figures | volume_figures("quick", quick) | volume_figures("full", full)


def volume_figures(name: str, volume: CaptureVolume) -> dict[str, float]:
    """Return reprojection errors, and distances on the board relative to the truth."""
    report = volume.reprojection_report
    image = volume.image_points.df
    known = image.drop_duplicates(["object_id", "keypoint_id"]).set_index("keypoint_id")[
        ["obj_loc_x", "obj_loc_y", "obj_loc_z"]
    ]
    known = known.fillna(0.0)
    ratios = []
    for _, frame in volume.world_points.df.groupby("sync_index"):
        ours = frame[["x_coord", "y_coord", "z_coord"]].to_numpy()
        true = known.loc[frame["keypoint_id"]].to_numpy()
        i, j = np.triu_indices(len(ours), 1)
        ratios.append(np.linalg.norm(ours[i] - ours[j], axis=1) / np.linalg.norm(true[i] - true[j], axis=1))
    every = np.concatenate(ratios)
    return {
        f"{name}_rmse_px": float(report.overall_rmse),
        f"{name}_corners": int(report.n_observations_matched),
        f"{name}_distance_error": float(np.median(every) - 1.0),
        f"{name}_distance_spread": float(np.median(np.abs(every - np.median(every)))),
    }


def people(folder: Path) -> dict[str, float]:
    """Calibrate by matched keypoints."""
    pixels = np.load(folder / "points.npy")
    lenses = json.loads((folder / "lenses.json").read_text("utf-8"))
    cameras = CameraArray(
        {
            v: CameraData(
                cam_id=v,
                size=tuple(lens["size"]),
                matrix=np.array(lens["matrix"]),
                distortions=np.array(lens["distortions"]),
            )
            for v, lens in enumerate(lenses)
        }
    )
    view, frame, keypoint = np.nonzero(np.isfinite(pixels).all(axis=-1))
    columns = {
        "sync_index": frame,
        "cam_id": view,
        "object_id": np.zeros(len(frame), dtype=int),
        "keypoint_id": keypoint,
        "img_loc_x": pixels[view, frame, keypoint, 0],
        "img_loc_y": pixels[view, frame, keypoint, 1],
    }
    begun = time.process_time()
    volume = calibrate_extrinsics(
        ImagePoints(pd.DataFrame(columns)), cameras, None, refine_intrinsics=False
    ).capture_volume
    spent = time.process_time() - begun
    poses = {
        v: {"rotation": camera.rotation.tolist(), "translation": camera.translation.tolist()}
        for v, camera in volume.camera_array.posed_cameras.items()
    }
    (folder / "caliscope.json").write_text(json.dumps(poses), "utf-8")
    return {"cpu_s": spent, "rmse_px": float(volume.reprojection_report.overall_rmse)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mode", choices=("board", "people"), required=True)
    given = parser.parse_args()
    logging.disable(logging.WARNING)
    with contextlib.redirect_stdout(io.StringIO()):
        figures = {"board": board, "people": people}[given.mode](given.folder)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
