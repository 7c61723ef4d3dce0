"""aniposelib's triangulation on a folder's calibration.toml and points.npy; prints its figures as JSON.

``run.py FOLDER [--mode simple|ransac] [--min-cams N] [--frames N]``. ``--min-cams`` is for ransac. The points of the
first N frames, in the unit of the calibration, go to aniposelib.npy, shape (frame, keypoint, 3).
"""

import argparse
import json
import statistics
import time
import tomllib
from pathlib import Path

import numpy as np
from aniposelib.cameras import CameraGroup

RUNS = 3


def camera_group(calibration: Path) -> CameraGroup:
    """The cameras in the file's order: loading sorts them by the text of their keys, cam_10 before cam_2."""
    tables = tomllib.loads(calibration.read_text("utf-8"))
    names = [table["name"] for key, table in tables.items() if key != "metadata"]
    return CameraGroup.load(str(calibration)).subset_cameras_names(names)


def ransac(group: CameraGroup, points: np.ndarray, min_cams: int) -> np.ndarray:
    """triangulate_ransac of the points that a camera sees: it raises an error on others."""
    seen = ~np.isnan(points[..., 0]).all(axis=0)
    found = np.full((points.shape[1], 3), np.nan)
    found[seen] = group.triangulate_ransac(points[:, seen], min_cams=min_cams)[0]
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mode", choices=("simple", "ransac"), default="simple")
    parser.add_argument("--min-cams", type=int, default=3)
    parser.add_argument("--frames", type=int)
    given = parser.parse_args()
    points = np.load(given.folder / "points.npy")[:, : given.frames]
    cameras, frames, keypoints, _ = points.shape
    flat = points.reshape(cameras, frames * keypoints, 2)
    group = camera_group(given.folder / "calibration.toml")
    if given.mode == "simple":
        group.triangulate(flat)
    else:
        ransac(group, flat[:, :keypoints], given.min_cams)
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        found = group.triangulate(flat) if given.mode == "simple" else ransac(group, flat, given.min_cams)
        times.append(time.process_time() - start)
    np.save(given.folder / "aniposelib.npy", np.asarray(found).reshape(frames, keypoints, 3))
    print(json.dumps({"ms_per_frame": 1000 * statistics.median(times) / frames, "frames": frames}))


if __name__ == "__main__":
    main()
