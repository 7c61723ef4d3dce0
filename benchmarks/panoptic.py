"""Read real motion from the CMU Panoptic dome, which is used to simulate detections.

It has no 2D detections. Positions are in meters, in the axes of the dome: y points down, so up is -y.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.model.cameras import Camera, CameraRig
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

RATE_HZ = 29.97
"""Frame rate of the HD cameras."""

METRES_PER_UNIT = 0.01
HD_CAMERAS = ("00_03", "00_06", "00_12", "00_13", "00_23")
"""The five cameras that are commonly used for evaluation."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of people, with cameras.

    Attributes:
        rig: chosen cameras, in meters, -y up.
        skeleton: panoptic_19.
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        person_ids: names in the dome's tracking.
        frame_numbers: shape (frame,).
        rate_hz: nominal frame rate.
    """

    rig: CameraRig
    skeleton: Skeleton
    points_m: np.ndarray
    person_ids: tuple[str, ...]
    frame_numbers: np.ndarray
    rate_hz: float = RATE_HZ


def one_person(folder: Path, cameras: Sequence[str] = HD_CAMERAS) -> Motion:
    """Read ``panoptic_motion``: 7181 consecutive frames of one person.

    Args:
        folder: folder of the recordings.
        cameras: names of cameras in the calibration.
    """
    place = folder / "panoptic_motion"
    with np.load(place / "Panoptic_GT_171026_pose3.npz") as held:
        frames, poses = held["frames"], held["poses"]
    points = METRES_PER_UNIT * np.asarray(poses, dtype=np.float64)[:, None]
    rig = read_rig(place / "calibration_171026_pose3.json", cameras)
    return Motion(rig, find_skeleton("panoptic_19"), points, ("person_0",), np.asarray(frames, dtype=np.int64))


def three_people(folder: Path, sequence: str = "160906_band1", cameras: Sequence[str] = HD_CAMERAS) -> Motion:
    """Read a sequence of ``panoptic_three_people``: 20 consecutive frames of people who hardly move.

    Args:
        folder: folder of the recordings.
        sequence: ``160906_band1`` or ``160906_band2``.
        cameras: names of cameras in the calibration.
    """
    place = folder / "panoptic_three_people" / sequence
    files = sorted((place / "hdPose3d_stage1_coco19").glob("body3DScene_*.json"))
    frames = [{body["id"]: _joints(body) for body in json.loads(file.read_text("utf-8"))["bodies"]} for file in files]
    ids = sorted({person for frame in frames for person in frame})
    skeleton = find_skeleton("panoptic_19")
    points = np.full((len(frames), len(ids), len(skeleton), 3), np.nan)
    for f, frame in enumerate(frames):
        for person, joints in frame.items():
            points[f, ids.index(person)] = joints
    numbers = np.array([int(file.stem.removeprefix("body3DScene_")) for file in files])
    names = tuple(f"person_{person}" for person in ids)
    return Motion(read_rig(place / f"calibration_{sequence}.json", cameras), skeleton, points, names, numbers)


def _joints(body: dict[str, Any]) -> np.ndarray:
    """Return joints in meters, shape (19, 3); joints that were not detected have a negative confidence."""
    rows = np.array(body["joints19"], dtype=np.float64).reshape(-1, 4)
    return np.where(rows[:, 3:] >= 0, METRES_PER_UNIT * rows[:, :3], np.nan)


def read_rig(file: Path, cameras: Sequence[str]) -> CameraRig:
    """Return the chosen cameras of a dome's calibration, with lens distortion."""
    known = {each["name"]: each for each in json.loads(file.read_text("utf-8"))["cameras"]}
    chosen = [_camera(name, known[name]) for name in cameras]
    return CameraRig(tuple(chosen), "-y", file.name, METRES_PER_UNIT)


def _camera(name: str, numbers: dict[str, Any]) -> Camera:
    shift = METRES_PER_UNIT * np.array(numbers["t"], dtype=np.float64).ravel()
    rotation = np.array(numbers["R"], dtype=np.float64)
    # Stored with few digits: orthonormalize, which moves pixels by less than 0.01.
    u, _, v = np.linalg.svd(rotation)
    return Camera.from_opencv(name, numbers["resolution"], numbers["K"], numbers["distCoef"], u @ v, shift)
