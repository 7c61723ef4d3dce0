"""NumPy arrays of one subject: [camera, frame, keypoint, 2 or 3], in ``.npy`` or ``.npz``.

What the third channel is, the file does not say: ``third_channel`` must. An ``.npz`` holds the array as
``keypoints`` (or alone), and may hold ``confidence`` [camera, frame, keypoint], ``names`` (of the cameras) and
``rate_hz``. NaN is missing. [camera, frame, 2] is one point a frame, of no body.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import DetectionsError, FileError, choices
from posefuse.io.files import read_npy, read_npz
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.infer_skeleton import guess_skeleton
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.model.options.options import ThirdChannel
from posefuse.skeleton.skeletons import Skeleton


def matches(path: Path) -> bool:
    """Whether the file is one."""
    return path.suffix in (".npy", ".npz")


def read(path: Path, request: Request) -> Detections:
    """Read the array.

    Raises:
        FileError: if the file is cut short, holds objects, or an array of another shape.
        DetectionsError: if there is a third channel and nobody said what it is.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    content = _load(path)
    keypoints = content.pop("keypoints", None)
    if keypoints is None and len(content) == 1:
        keypoints = content.popitem()[1]
    if keypoints is None:
        raise FileError(f"{path} holds {choices(content)}; the keypoint array must be called 'keypoints' or be alone.")
    if keypoints.ndim == 3 and keypoints.shape[2] == 2:
        # One point a frame, [camera, frame, 2]: a wand's, or a subject's that nobody told apart.
        keypoints = keypoints[:, :, None]
        request = replace(request, skeleton=request.skeleton or Skeleton("point", ("point",)))
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
    """Detections of a [camera, frame, keypoint, 2 or 3] array.

    Raises:
        FileError: if the shape is another.
        DetectionsError: if there is a third channel and nobody said what it is.
    """
    if keypoints.ndim == 3 and keypoints.shape[-1] == 2:
        # Points that are of no body, each seen by some of the cameras.
        keypoints = keypoints[:, :, None]
        request = replace(request, skeleton=request.skeleton or Skeleton("point", ("point",)))
    if keypoints.ndim != 4 or keypoints.shape[-1] not in (2, 3) or keypoints.dtype.kind not in "fiu":
        raise FileError(
            f"{path}: expected numbers [camera, frame, keypoint, 2 or 3], got {keypoints.dtype} of shape "
            f"{keypoints.shape}."
        )
    if keypoints.shape[0] != len(view_names):
        raise FileError(f"{path}: {keypoints.shape[0]} cameras in the array, {len(view_names)} names.")
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
    # A keypoint without both numbers is not one.
    pixels = np.where(np.isnan(pixels).any(axis=-1, keepdims=True), np.nan, pixels)
    origin = (pixels == 0).all(axis=-1)
    pixels = np.where(origin[..., None], np.nan, pixels)
    skeleton, notes = request.skeleton, ()
    if skeleton is not None and len(skeleton) != pixels.shape[2]:
        raise FileError(
            f"{path} has {pixels.shape[2]} keypoints, skeleton {skeleton.name} has {len(skeleton)}. Choose another "
            "with --skeleton, or leave it out to have it told from the file."
        )
    if skeleton is None:
        rows = pixels.reshape(-1, *pixels.shape[2:])
        skeleton, notes = guess_skeleton(pixels.shape[2], rows, str(path))
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
            f"{path} has three numbers a keypoint, and nothing says what the third is. Add --third-channel confidence "
            "or --third-channel depth (MediaPipe's and FreeMoCap's is depth)."
        )
    return {meaning: keypoints[..., 2]}


def _rate(path: Path, value: np.ndarray | None) -> float | None:
    if value is None:
        return None
    if value.size != 1 or value.dtype.kind not in "fiu":
        raise FileError(f"{path}: rate_hz should be one number, got {value.dtype} of shape {value.shape}.")
    return float(value.reshape(()))


def _load(path: Path) -> dict[str, Any]:
    if path.suffix == ".npy":
        return {"keypoints": read_npy(path)}
    return read_npz(path, read_npz(path, ()))


FORMAT = KeypointFormat(
    name="arrays",
    files="*.npy, *.npz",
    conventions=(
        "px; [camera, frame, keypoint, 2 or 3]: --third-channel; no camera names: --camera-order;"
        " no frame rate: --rate-hz"
    ),
    recognized_by="NumPy array with axes camera, frame, keypoint",
    matches=matches,
    read=read,
)
