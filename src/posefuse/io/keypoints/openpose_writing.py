"""Writer of OpenPose JSON: one folder per camera, one file per frame."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import checked_file_name, replacing_folder
from posefuse.io.keypoints.openpose_parts import lists_of
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton, shipped_skeletons

_MARKER = "posefuse_openpose.txt"
_ABOUT = "2D keypoints in OpenPose's layout, written by posefuse convert.\n"


def write(detections: Detections, path: Path) -> None:
    """Write one folder per view with one file per recorded frame.

    Raises:
        FileError: If the folder contains other files, the name of a view is not a valid folder name, or a frame number
            is negative.
    """
    if len(detections.frame_numbers) and detections.frame_numbers[0] < 0:
        raise FileError(f"OpenPose files are numbered from 0; the recording starts at {detections.frame_numbers[0]}.")
    names = [checked_file_name(name) for name in detections.view_names]
    with replacing_folder(path, marker=_MARKER, owned=(_MARKER, "*/*_keypoints.json")) as staging:
        (staging / _MARKER).write_text(_ABOUT, "utf-8")
        for name in names:
            (staging / name).mkdir()
        for chunk in detections.chunks():
            for f, number in enumerate(chunk.frame_numbers.tolist()):
                for v in np.flatnonzero(np.asarray(chunk.recorded)[f]).tolist():
                    file = staging / names[v] / f"{names[v]}_{number:012d}_keypoints.json"
                    file.write_bytes(msgspec.json.encode(_frame(chunk, f, v)))


def _frame(detections: Detections, frame: int, view: int) -> dict[str, Any]:
    start, stop = detections.offsets[frame * detections.n_views + view :][:2]
    pixels = np.asarray(detections.keypoints_px)[start:stop]
    confidence = np.asarray(detections.confidence)[start:stop]
    missing = np.asarray(np.isnan(pixels).any(axis=-1))
    # A confidence of 0 would mark a detection without a confidence as missing.
    confidence = np.where(np.isnan(confidence), 1.0, confidence)
    values = np.where(missing[..., None], 0.0, np.concatenate([pixels, confidence[..., None]], axis=-1))
    tracks = np.asarray(detections.track_ids)[start:stop].tolist()
    skeleton = detections.skeleton
    people = [{"person_id": [track], **lists_of(skeleton, rows)} for track, rows in zip(tracks, values, strict=True)]
    return {"version": 1.3, "people": people}


def lost(detections: Detections) -> tuple[str, ...]:
    """Return what of the detections is lost in the files."""
    losses = ["times and the frame rate", *_lost_names(detections.skeleton)]
    for name, what in (("depth", "depths"), ("sigma_px", "standard deviations")):
        if getattr(detections, name) is not None:
            losses.append(what)
    missing, zero = _special_confidences(detections)
    if missing:
        losses.append("missing confidences, which are written as 1")
    if zero:
        losses.append("detections with confidence 0, which OpenPose uses for missing keypoints")
    return tuple(losses)


def _lost_names(skeleton: Skeleton) -> tuple[str, ...]:
    """Return what is lost of a skeleton that its number of keypoints does not identify."""
    same_length = [name for name in shipped_skeletons() if len(shipped_skeleton(name)) == len(skeleton)]
    if same_length == [skeleton.name] and shipped_skeleton(skeleton.name) == skeleton:
        return ()
    option = skeleton.name if skeleton.name in same_length else "and its TOML file"
    return (f"the names of the keypoints; read the files with `skeleton={option!r}`",)


def _special_confidences(detections: Detections) -> tuple[bool, bool]:
    """Return whether there are detections without a confidence, and with confidence 0."""
    missing = zero = False
    for chunk in detections.chunks():
        detected = np.isfinite(np.asarray(chunk.keypoints_px)[..., 0])
        confidence = np.asarray(chunk.confidence)
        missing |= bool(np.any(np.isnan(confidence) & detected))
        zero |= bool(np.any((confidence == 0.0) & detected))
    return missing, zero
