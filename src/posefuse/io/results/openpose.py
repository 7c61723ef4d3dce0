"""OpenPose JSON of a result's points projected into each camera, for overlays on its video.

One folder per camera, ``<camera>_json``, and one file per frame, as OpenPose and Pose2Sim name them. Points are
projected with lens distortion; they are not detections. The third number is 1 for a point; 0 0 0 means that there is
no point or it is outside the image. Hands and faces of openpose_137 are in separate lists. OpenPose's ``person_id`` is
the index of the person, and ``posefuse`` has fields that readers of OpenPose ignore: name, layer, and status and source
of each point, in the skeleton's order.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.io.files import checked_file_name, replacing_folder
from posefuse.io.keypoints.openpose_parts import lists_of
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.model.cameras import Camera
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source
from posefuse.progress import Progress, Silent, report_ranges

_VERSION = 1.3
_DECIMALS = 3
_EMPTY = (
    "face_keypoints_2d", "hand_left_keypoints_2d", "hand_right_keypoints_2d", "pose_keypoints_3d",
    "face_keypoints_3d", "hand_left_keypoints_3d", "hand_right_keypoints_3d",
)  # fmt: skip


def write(result: Reconstruction, folder: Path, layer: LayerName, progress: Progress | None = None) -> list[str]:
    """Write the projections of all people into all cameras.

    Returns:
        Notes on what the files do not contain, in sentences.

    Raises:
        ResultError: if the points are not in world coordinates.
        FileError: if a camera's name is not a valid folder name, or the folder holds other files.
    """
    require(ResultFacts.of(result))
    folders = [f"{checked_file_name(name)}_json" for name in result.rig.names]
    with replacing_folder(folder, folders[0], tuple(f"{each}/*_keypoints.json" for each in folders)) as staging:
        for each in folders:
            (staging / each).mkdir()
        parts = report_ranges(result.chunks(), result.n_frames, f"writing {folder.name}", progress or Silent())
        for part in parts:
            for camera, each in zip(result.rig.cameras, folders, strict=True):
                _write_view(part, camera, layer, staging / each)
    return [f"OpenPose JSON has no frame rate. Its points are projections of the layer {layer}, not detections."]


def require(facts: ResultFacts) -> None:
    """Refuse results that cannot be projected.

    Raises:
        ResultError: if the points are not in meters.
        FileError: if a camera's name is not a valid folder name.
    """
    facts.require_meters("openpose")
    for name in facts.cameras:
        checked_file_name(name)


def _write_view(part: Reconstruction, camera: Camera, layer: LayerName, folder: Path) -> None:
    points = part.layers[layer]
    pixels = _project_visible(camera, np.asarray(points.points_m))
    for f, number in enumerate(part.frame_numbers.tolist()):
        people = [_person(part, layer, f, p, pixels[f, p]) for p in range(len(part.person_ids))]
        content = {"version": _VERSION, "people": [person for person in people if person is not None]}
        text = json.dumps(content, separators=(",", ":"), ensure_ascii=False)
        (folder / f"{camera.name}_{number:012d}_keypoints.json").write_text(text, "utf-8")


def _project_visible(camera: Camera, points_m: np.ndarray) -> np.ndarray:
    """Return the projections of points, shape (..., 2); NaN outside the image."""
    pixels, _ = camera.project(points_m)
    width, height = camera.size_px
    largest = np.array([width, height]) - 0.5
    inside = np.all((pixels >= -0.5) & (pixels <= largest), axis=-1, keepdims=True)
    return np.where(inside, pixels, np.nan)


def _person(part: Reconstruction, layer: LayerName, f: int, p: int, pixels: np.ndarray) -> dict[str, Any] | None:
    """Return one person as in OpenPose's files, or None if no point is in the image."""
    visible = np.all(np.isfinite(pixels), axis=-1, keepdims=True)
    if not np.any(visible):
        return None
    numbers = np.concatenate([np.where(visible, pixels, 0.0), visible], axis=1)
    points = part.layers[layer]
    status, source = (np.asarray(each)[f, p].tolist() for each in (points.status, points.source))
    return {
        "person_id": [p],
        **{name: [] for name in _EMPTY},
        **lists_of(part.skeleton, np.round(numbers, _DECIMALS)),
        "posefuse": {
            "person": part.person_ids[p],
            "layer": layer,
            "status": [PointStatus(code).label for code in status],
            "source": [Source(code).label for code in source],
        },
    }


def _write_result(result: Reconstruction, people: Sequence[str], path: Path, layer: LayerName) -> list[str]:
    return write(result, path, layer)


FORMAT = ResultFormat(
    name="openpose",
    files="a folder: <camera>_json/<camera>_<frame>_keypoints.json",
    conventions="px of each camera; points projected through its lens; 0 0 0 is missing; for overlays",
    require=require,
    additional_name="openpose",
    is_folder=True,
    write_result=_write_result,
)
