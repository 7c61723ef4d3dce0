"""Writers of files in formats of other programs, to test readers."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from posefuse.model.cameras import CameraRig, vector_from_rotation
from posefuse.model.detections import Detections


def write_openpose(folder: Path, detections: Detections, suffix: str = "_json") -> Path:
    """Write one folder per view with one OpenPose file per frame. Names of views get ``suffix``."""
    for v, name in enumerate(detections.view_names):
        camera = folder / f"{name}{suffix}"
        camera.mkdir(parents=True)
        for f, number in enumerate(detections.frame_numbers):
            start, stop = detections.offsets[f * detections.n_views + v :][:2]
            people = [openpose_person(detections, row) for row in range(start, stop)]
            write_openpose_frame(camera / f"{name}_{number:012d}_keypoints.json", people)
    return folder


def openpose_person(detections: Detections, row: int) -> dict:
    pixels = np.asarray(detections.keypoints_px)[row]
    confidence = np.nan_to_num(np.asarray(detections.confidence)[row], nan=0.9)
    flat = np.concatenate([np.nan_to_num(pixels), np.where(np.isnan(pixels[:, :1]), 0, confidence[:, None])], axis=1)
    return {"person_id": [int(np.asarray(detections.track_ids)[row])], "pose_keypoints_2d": flat.ravel().tolist()}


def write_openpose_frame(path: Path, people: Sequence[dict]) -> None:
    path.write_text(json.dumps({"version": 1.3, "people": list(people)}))


def pose2sim_toml(rig: CameraRig) -> str:
    """Return a calibration like Pose2Sim writes it. Lenses must have four coefficients."""
    tables = []
    for camera in rig.cameras:
        distortion = [*camera.distortion, 0.0, 0.0, 0.0, 0.0][:4]
        tables.append(
            f"[{camera.name}]\n"
            f'name = "{camera.name}"\n'
            f"size = {[float(s) for s in camera.size_px]}\n"
            f"matrix = {camera.matrix.tolist()}\n"
            f"distortions = {distortion}\n"
            f"rotation = {vector_from_rotation(camera.rotation).tolist()}\n"
            f"translation = {camera.translation_m.tolist()}\n"
            "fisheye = false\n"
        )
    return "\n".join([*tables, "[metadata]", "adjusted = false", "error = 0.0", ""])


def anipose_toml(rig: CameraRig, unit_per_m: float = 1000.0) -> str:
    """Return a calibration like Anipose writes it, without a unit."""
    tables = []
    for i, camera in enumerate(rig.cameras):
        fisheye = camera.lens.value == "fisheye"
        distortion = list(camera.distortion) if fisheye else [*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0][:5]
        tables.append(
            f"[cam_{i}]\n"
            f'name = "{camera.name}"\n'
            f"size = {list(camera.size_px)}\n"
            f"matrix = {camera.matrix.tolist()}\n"
            f"distortions = {distortion}\n"
            f"rotation = {vector_from_rotation(camera.rotation).tolist()}\n"
            f"translation = {(camera.translation_m * unit_per_m).tolist()}\n" + ("fisheye = true\n" if fisheye else "")
        )
    return "\n".join([*tables, "[metadata]", "adjusted = false", ""])


def qualisys_xml(rig: CameraRig) -> str:
    """Return a calibration like Qualisys Track Manager writes it."""
    cameras = []
    for camera in rig.cameras:
        axes = np.diag([1.0, -1.0, -1.0]) @ camera.rotation
        center = 1000.0 * camera.center_m
        k1, k2, p1, p2, k3 = (camera.distortion + (0.0,) * 5)[:5]
        k = camera.matrix * 64
        turn = " ".join(f'r{i + 1}{j + 1}="{axes[i, j]!r}"' for i in range(3) for j in range(3))
        place = " ".join(f'{axis}="{value!r}"' for axis, value in zip("xyz", center.tolist(), strict=True))
        width, height = camera.size_px
        cameras.append(
            f'<camera serial="{camera.name}" model="none" viewrotation="0">'
            f'<fov_video left="0" top="0" right="{width - 1}" bottom="{height - 1}"/>'
            f"<transform {turn} {place}/>".replace("np.float64(", "").replace(')"', '"')
            + f'<intrinsic focalLengthU="{k[0, 0]}" focalLengthV="{k[1, 1]}" centerPointU="{k[0, 2]}" '
            f'centerPointV="{k[1, 2]}" skew="0" radialDistortion1="{k1}" radialDistortion2="{k2}" '
            f'radialDistortion3="{k3}" tangentalDistortion1="{p1}" tangentalDistortion2="{p2}"/></camera>'
        )
    return f'<?xml version="1.0"?><calibration><cameras>{"".join(cameras)}</cameras></calibration>'
