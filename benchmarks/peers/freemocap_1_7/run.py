"""FreeMoCap 1.7's triangulation and its reprojection error filtering, as 1.7.4, the last version with it, does them.

``run.py FOLDER [--mode filter|simple] [--percentile P] [--min-cameras N]`` reads calibration.toml and points.npy,
shape (view, frame, keypoint, 2) px. The points, in the unit of the calibration, go to freemocap_1_7.npy, shape
(frame, keypoint, 3). Every keypoint counts as one of the body, which is what the program filters.
"""

import argparse
import json
import os
import sys
import tempfile
import tomllib
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np

PARAMETERS = "freemocap.data_layer.recording_models.post_processing_parameter_models"


def points_of(given: argparse.Namespace) -> np.ndarray:
    """Shape (frame, keypoint, 3), NaN where missing."""
    # The filter needs this module for an annotation; importing it would need MediaPipe.
    sys.modules[PARAMETERS] = SimpleNamespace(ProcessingParameterModel=object)  # type: ignore[assignment]
    from freemocap.core_processes.capture_volume_calibration.anipose_camera_calibration.freemocap_anipose import (
        CameraGroup,
    )
    from freemocap.core_processes.capture_volume_calibration.by_camera_reprojection_filtering import (
        filter_by_reprojection_error,
    )
    from freemocap.core_processes.capture_volume_calibration.triangulate_3d_data import triangulate_3d_data

    calibration = given.folder / "calibration.toml"
    tables = tomllib.loads(calibration.read_text("utf-8"))
    names = [table["name"] for key, table in tables.items() if key != "metadata"]
    # Loading sorts the cameras by the text of their keys: cam_10 before cam_2.
    group = CameraGroup.load(str(calibration)).subset_cameras_names(names)
    pixels = np.load(given.folder / "points.npy")
    points, mean_errors, errors = triangulate_3d_data(group, pixels)
    if given.mode == "simple":
        return points
    return filter_by_reprojection_error(
        errors,
        mean_errors,
        given.percentile,
        pixels,
        points,
        group,
        pixels.shape[2],
        minimum_cameras_to_reproject=given.min_cameras,
    )[0]


def main() -> None:
    """Triangulate and write the points."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mode", choices=("filter", "simple"), default="filter")
    parser.add_argument("--percentile", type=float, default=90.0)
    parser.add_argument("--min-cameras", type=int, default=3)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    points = points_of(given)
    np.save(given.folder / "freemocap_1_7.npy", points)
    print(json.dumps({"frames": len(points)}))


if __name__ == "__main__":
    # FreeMoCap writes its logs into the home folder.
    with tempfile.TemporaryDirectory() as home:
        os.environ["HOME"] = home
        main()
