"""NumPy arrays of one subject: [camera, frame, keypoint, 2 or 3], in ``.npy`` or ``.npz``.

The file does not state the meaning of a third channel; ``third_channel`` must define it. An ``.npz`` contains the array
as ``keypoints`` (or as its only array), and optionally ``confidence`` [camera, frame, keypoint], ``names`` of the
cameras and ``rate_hz``. NaN is missing. An array [camera, frame, 2] or [camera, frame, 1, 2] contains one point per
frame without a skeleton.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import DetectionsError, FileError, choices
from posefuse.io.files import read_npy, read_npz
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.infer_skeleton import infer_skeleton, wrong_skeleton
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.model.options.options import ThirdChannel
from posefuse.skeleton.skeletons import Skeleton


def matches(path: Path) -> bool:
    """Return whether a file is a NumPy file."""
    return path.suffix in (".npy", ".npz")


def read(path: Path, request: Request) -> Detections:
    """Read the array.

    Raises:
        FileError: If the file is truncated, contains objects, or its array has another shape.
        DetectionsError: If the meaning of the third channel is not stated.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    content = _load(path)
    keypoints = content.pop("keypoints", None)
    if keypoints is None and len(content) == 1:
        keypoints = content.popitem()[1]
    if keypoints is None:
        raise FileError(
            f"{path} contains {choices(content)}; the keypoint array must be called 'keypoints' or be the only array."
        )
    n_cameras = keypoints.shape[0] if keypoints.ndim else 0
    names = [str(name) for name in content.get("names", range(n_cameras))]
    rate = request.rate_hz or _rate(path, content.get("rate_hz"))
    return from_array(path, keypoints, names, rate, request, content.get("confidence"))


def from_array(
    path: Path,
    keypoints: np.ndarray,
    view_names: list[str],
    rate_hz: float | None,
    request: Request,
    confidence: np.ndarray | None = None,
) -> Detections:
    """Return the detections of an array.

    Args:
        path: The file, for messages.
        keypoints: Shape (camera, frame, keypoint, 2 or 3), px, or (camera, frame, 2) of a single point.
        view_names: Names of the cameras.
        rate_hz: Frame rate, or None.
        request: Skeleton and meaning of the third channel.
        confidence: Shape (camera, frame, keypoint), or None.

    Raises:
        FileError: If the array has another shape.
        DetectionsError: If the meaning of the third channel is not stated, or the keypoints are invalid.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    if keypoints.ndim == 3 and keypoints.shape[-1] == 2:
        keypoints = keypoints[:, :, None]
        confidence = confidence if confidence is None or confidence.ndim != 2 else confidence[..., None]
    if keypoints.ndim == 4 and keypoints.shape[2] == 1 and request.skeleton is None:
        # One point per frame without a skeleton, such as that of a wand.
        request = replace(request, skeleton=Skeleton("point", ("point",)))
    if keypoints.ndim != 4 or keypoints.shape[-1] not in (2, 3) or keypoints.dtype.kind not in "fiu":
        raise FileError(
            f"{path}: expected numbers [camera, frame, keypoint, 2 or 3], got {keypoints.dtype} of shape "
            f"{keypoints.shape}."
        )
    if keypoints.shape[0] != len(view_names):
        raise FileError(f"{path}: the array has {keypoints.shape[0]} cameras, but there are {len(view_names)} names.")
    frame_first = np.moveaxis(keypoints, 0, 1).astype(np.float64)
    third = _third_channel(path, frame_first, request.third_channel)
    if confidence is not None:
        if confidence.shape != keypoints.shape[:3] or confidence.dtype.kind not in "fiu":
            raise FileError(
                f"{path}: expected confidence [camera, frame, keypoint] = {keypoints.shape[:3]}, got "
                f"{confidence.dtype} of shape {confidence.shape}."
            )
        third["confidence"] = np.moveaxis(confidence.astype(np.float64), 0, 1)
    pixels = frame_first[..., :2]
    # A keypoint with only one coordinate is missing.
    pixels = np.where(np.isnan(pixels).any(axis=-1, keepdims=True), np.nan, pixels)
    origin = (pixels == 0).all(axis=-1)
    pixels = np.where(origin[..., None], np.nan, pixels)
    skeleton, notes = request.skeleton, ()
    if skeleton is not None and len(skeleton) != pixels.shape[2]:
        raise wrong_skeleton(path, pixels.shape[2], skeleton)
    if skeleton is None:
        rows = pixels.reshape(-1, *pixels.shape[2:])
        skeleton, notes = infer_skeleton(pixels.shape[2], rows, str(path))
    try:
        if origin.any():
            notes = (*notes, f"{int(origin.sum())} keypoints at exactly (0, 0) px are read as missing.")
        detections = Detections.from_dense(skeleton, view_names, pixels, rate_hz=rate_hz, **third)
        return replace(detections, notes=notes)
    except DetectionsError as error:
        raise DetectionsError(f"{path}: {error}") from None


def _third_channel(path: Path, keypoints: np.ndarray, meaning: ThirdChannel | None) -> dict[str, np.ndarray]:
    if keypoints.shape[-1] == 2:
        return {}
    if meaning is None:
        raise DetectionsError(
            f"{path} has three numbers per keypoint but does not specify what the third one is. Add "
            "`third_channel='confidence'` or `third_channel='depth'` (depth for MediaPipe and FreeMoCap)."
        )
    return {meaning: keypoints[..., 2]}


def _rate(path: Path, value: np.ndarray | None) -> float | None:
    if value is None:
        return None
    if value.size != 1 or value.dtype.kind not in "fiu":
        raise FileError(f"{path}: expected one number for rate_hz, got {value.dtype} of shape {value.shape}.")
    return float(value.reshape(()))


def _load(path: Path) -> dict[str, Any]:
    if path.suffix == ".npy":
        return {"keypoints": read_npy(path)}
    return read_npz(path, read_npz(path, ()))


FORMAT = KeypointFormat(
    name="arrays",
    files="*.npy, *.npz",
    conventions=(
        "px; [camera, frame, keypoint, 2 or 3]: `third_channel`; no camera names: `camera_order`;"
        " no frame rate: `rate_hz`"
    ),
    recognized_by="NumPy array with axes camera, frame, keypoint",
    matches=matches,
    read=read,
)
