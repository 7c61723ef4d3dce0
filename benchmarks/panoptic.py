"""CMU Panoptic's known motion before its real cameras: points and a rig for the simulated detector."""

import json
import re
from pathlib import Path

import numpy as np

from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.skeletons import Skeleton, find_skeleton

RATE_HZ = 29.97
FIVE_HD = ("00_03", "00_06", "00_12", "00_13", "00_23")
"""The five HD cameras that papers on this data use."""


def read_rig(path: Path, names: tuple[str, ...] = FIVE_HD) -> CameraRig:
    """The named cameras of a Panoptic calibration; centimetres, y down."""
    stored = {camera["name"]: camera for camera in json.loads(path.read_text())["cameras"]}
    cameras = []
    for name in names:
        camera = stored[name]
        pose = np.eye(4)
        pose[:3, :3] = _nearest_rotation(np.array(camera["R"]))
        pose[:3, 3] = np.ravel(camera["t"]) / 100.0
        size = (int(camera["resolution"][0]), int(camera["resolution"][1]))
        lens = tuple(float(k) for k in camera["distCoef"])
        cameras.append(Camera(name, size, np.array(camera["K"]), pose, LensModel.BROWN, lens))
    return CameraRig(tuple(cameras), up_axis="-y", source=path.name, metres_per_unit=0.01)


def read_one_person(folder: Path) -> np.ndarray:
    """Shape (frame, 1, keypoint, 3), metres: the recorded motion of ``panoptic_motion``."""
    with np.load(folder / "Panoptic_GT_171026_pose3.npz") as stored:
        return stored["poses"][:, None] / 100.0


def read_people(folder: Path) -> np.ndarray:
    """Shape (frame, person, keypoint, 3), metres: of a sequence of ``panoptic_three_people``; NaN where unknown."""
    files = sorted(folder.glob("hdPose3d*/body3DScene_*.json"), key=lambda path: int(re.findall(r"\d+", path.stem)[-1]))
    frames = [json.loads(path.read_text())["bodies"] for path in files]
    ids = sorted({body["id"] for bodies in frames for body in bodies})
    points = np.full((len(frames), len(ids), 19, 3), np.nan)
    for f, bodies in enumerate(frames):
        for body in bodies:
            joints = np.array(body["joints19"]).reshape(19, 4)
            points[f, ids.index(body["id"])] = np.where(joints[:, 3:] > 0, joints[:, :3] / 100.0, np.nan)
    return points


def skeleton() -> Skeleton:
    """Of these points."""
    return find_skeleton("panoptic_19")


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    u, _, vt = np.linalg.svd(matrix)
    return u @ vt
