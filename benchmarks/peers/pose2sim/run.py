"""Pose2Sim's triangulation of one person on a folder's files; prints its figures as JSON.

``run.py FOLDER [--frames N]``. Reads calibration.toml, points.npy and confidence.npy, shape (view, frame, keypoint).
The options are those of the configuration that Pose2Sim comes with. The points of the first N frames, in the unit of
the calibration, go to pose2sim.npy, shape (frame, keypoint, 3).
"""

import argparse
import json
import statistics
import time
from pathlib import Path

import cv2
import numpy as np
import rtoml
from Pose2Sim import triangulation

RUNS = 3


def confident(detections: np.ndarray, threshold: float) -> np.ndarray:
    """x, y and likelihood, NaN where one is missing or the likelihood is below the threshold."""
    missing = np.isnan(detections).any(axis=-1) | (detections[..., 2] < threshold)
    return np.where(missing[..., None], np.nan, detections)


def triangulate(config: dict, calibration: Path, detections: np.ndarray) -> np.ndarray:
    """Every frame and keypoint for itself, as the pipeline does, of (view, frame, keypoint, 3)."""
    projections = triangulation.computeP(calibration)
    parameters = triangulation.retrieve_calib_params(calibration)
    _, frames, keypoints, _ = detections.shape
    found = np.empty((frames, keypoints, 3))
    for frame in range(frames):
        for keypoint in range(keypoints):
            seen = np.array(detections[:, frame, keypoint].T)
            # The third argument has left and right exchanged; it is used by an option that is off.
            found[frame, keypoint] = triangulation.triangulation_from_best_cameras(
                config, seen, seen, projections, parameters
            )[0]
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    config = rtoml.load(Path(triangulation.__file__).parent / "Demo_SinglePerson" / "Config.toml")
    points = np.load(given.folder / "points.npy")[:, : given.frames]
    likelihood = np.load(given.folder / "confidence.npy")[:, : given.frames, :, None]
    threshold = config["triangulation"]["likelihood_threshold_triangulation"]
    detections = confident(np.concatenate([points, likelihood], axis=-1), threshold)
    frames = points.shape[1]
    calibration = given.folder / "calibration.toml"
    triangulate(config, calibration, detections[:, :1])
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        found = triangulate(config, calibration, detections)
        times.append(time.process_time() - start)
    np.save(given.folder / "pose2sim.npy", found)
    print(json.dumps({"ms_per_frame": 1000 * statistics.median(times) / frames, "frames": frames}))


if __name__ == "__main__":
    main()
