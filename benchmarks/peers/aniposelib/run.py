"""aniposelib's triangulation on a folder's calibration.toml and points.npy; prints its figures as JSON.

``run.py FOLDER [--mode simple|ransac|optim] [--min-cams N] [--frames N]``. ``--min-cams`` is for ransac. The points of
the first N frames, in the unit of the calibration, go to aniposelib.npy, shape (frame, keypoint, 3).

``optim`` is the whole trajectory as the command line of anipose solves it: triangulated, then ``optim_points`` with
its default values, chunks of 1000 frames whose first 15 are held at what the chunk before found. limbs.npy, shape
(limb, 2), are the bones whose lengths are constant.
"""

import argparse
import json
import statistics
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from aniposelib.cameras import CameraGroup

RUNS = 3
CHUNK_FRAMES = 1000
FIXED_FRAMES = 15
COMMAND_LINE = {
    "scale_smooth": 2,
    "scale_length": 2,
    "scale_length_weak": 1,
    "reproj_error_threshold": 5,
    "n_deriv_smooth": 3,
}


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


def optim(group: CameraGroup, points: np.ndarray, limbs: list[list[int]]) -> np.ndarray:
    """Shape (frame, keypoint, 3) of points (camera, frame, keypoint, 2): solved chunk after chunk."""
    cameras, frames, keypoints, _ = points.shape
    start = group.triangulate(points.reshape(cameras, -1, 2)).reshape(frames, keypoints, 3)
    found = start.copy()
    for first in range(0, frames, CHUNK_FRAMES):
        fixed = min(first, FIXED_FRAMES)
        span = slice(first - fixed, min(first + CHUNK_FRAMES, frames))
        given = np.concatenate([found[first - fixed : first], start[first : span.stop]])
        found[span] = group.optim_points(points[:, span], given, constraints=limbs, n_fixed=fixed, **COMMAND_LINE)
    return found


def method(given: argparse.Namespace, group: CameraGroup, points: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """What is asked for, of points (camera, frame, keypoint, 2)."""
    cameras = len(points)
    if given.mode == "optim":
        limbs = np.load(given.folder / "limbs.npy").tolist()
        return lambda some: optim(group, some, limbs)
    if given.mode == "ransac":
        return lambda some: ransac(group, some.reshape(cameras, -1, 2), given.min_cams)
    return lambda some: group.triangulate(some.reshape(cameras, -1, 2))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mode", choices=("simple", "ransac", "optim"), default="simple")
    parser.add_argument("--min-cams", type=int, default=3)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--runs", type=int, default=RUNS)
    given = parser.parse_args()
    points = np.load(given.folder / "points.npy")[:, : given.frames]
    _, frames, keypoints, _ = points.shape
    group = camera_group(given.folder / "calibration.toml")
    work = method(given, group, points)
    # Compiles; of what takes a second a frame or long to build, a few frames do.
    work(points if given.mode == "simple" else points[:, : 1 if given.mode == "ransac" else 40])
    times = []
    for _ in range(given.runs):
        start = time.process_time()
        found = work(points)
        times.append(time.process_time() - start)
    np.save(given.folder / "aniposelib.npy", np.asarray(found).reshape(frames, keypoints, 3))
    print(json.dumps({"ms_per_frame": 1000 * statistics.median(times) / frames, "frames": frames}))


if __name__ == "__main__":
    main()
