"""FreeMoCap's triangulation on a folder's calibration.toml and points.npy; prints its figures as JSON.

``run.py FOLDER [--mode rejection|simple] [--frames N] [--runs N]``. The mode is that of the option
``use_triangulate_outlier_rejection``; the other options are the pipeline's defaults unless given. The points of the
first N frames, in the unit of the calibration, go to freemocap.npy, shape (frame, keypoint, 3).
"""

import argparse
import json
import os
import statistics
import tempfile
import time
import tomllib
from pathlib import Path

import cv2
import numpy as np

RUNS = 3
# Enough frames for every path of the compiled functions.
WARM_UP_FRAMES = 20


def triangulation(calibration: Path, given: argparse.Namespace):
    """A function from (view, frame, keypoint, 2) px to (frame, keypoint, 3)."""
    from freemocap.core_processes.capture_volume_calibration.anipose_camera_calibration.freemocap_anipose import (
        CameraGroup,
    )
    from freemocap.core_processes.capture_volume_calibration.triangulate_3d_data import triangulate_3d_data

    tables = tomllib.loads(calibration.read_text("utf-8"))
    names = [table["name"] for key, table in tables.items() if key != "metadata"]
    # Loading sorts the cameras by the text of their keys: cam_10 before cam_2.
    group = CameraGroup.load(str(calibration)).subset_cameras_names(names)
    return lambda points: triangulate_3d_data(
        group,
        points,
        use_triangulate_outlier_rejection=given.mode == "rejection",
        minimum_cameras_for_triangulation=given.min_cameras,
        maximum_cameras_to_drop=given.drop,
        target_reprojection_error=given.target,
    )[0]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mode", choices=("rejection", "simple"), default="rejection")
    parser.add_argument("--min-cameras", type=int, default=3)
    parser.add_argument("--drop", type=int, default=1)
    parser.add_argument("--target", type=float, default=0.01)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--runs", type=int, default=RUNS)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    points = np.load(given.folder / "points.npy")[:, : given.frames]
    frames = points.shape[1]
    work = triangulation(given.folder / "calibration.toml", given)
    if given.runs > 1:
        work(points[:, :WARM_UP_FRAMES])
    times = []
    for _ in range(given.runs):
        start = time.process_time()
        found = work(points)
        times.append(time.process_time() - start)
    np.save(given.folder / "freemocap.npy", found)
    print(json.dumps({"ms_per_frame": 1000 * statistics.median(times) / frames, "frames": frames}))


if __name__ == "__main__":
    # FreeMoCap writes its logs into the home folder.
    with tempfile.TemporaryDirectory() as home:
        os.environ["HOME"] = home
        main()
