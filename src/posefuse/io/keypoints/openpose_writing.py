"""Writing OpenPose's JSON: a folder a camera, a file a frame; what :mod:`posefuse.io.keypoints.openpose` reads."""

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
    """Write a folder a view, a file for each frame that it recorded, range by range.

    Raises:
        FileError: if the folder holds other files, a view's name cannot be a folder's, or a frame number is negative.
    """
    if len(detections.frame_numbers) and detections.frame_numbers[0] < 0:
        raise FileError(f"OpenPose's files are numbered from 0; the recording begins at {detections.frame_numbers[0]}.")
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
    trust = np.asarray(detections.confidence)[start:stop]
    missing = np.asarray(np.isnan(pixels).any(axis=-1))
    # A detection without a confidence is one all the same.
    trust = np.where(np.isnan(trust), 1.0, trust)
    values = np.where(missing[..., None], 0.0, np.concatenate([pixels, trust[..., None]], axis=-1))
    tracks = np.asarray(detections.track_ids)[start:stop].tolist()
    skeleton = detections.skeleton
    people = [{"person_id": [track], **lists_of(skeleton, rows)} for track, rows in zip(tracks, values, strict=True)]
    return {"version": 1.3, "people": people}


def lost(detections: Detections) -> tuple[str, ...]:
    """What of these detections the files cannot hold."""
    told = ["times and the frame rate", *_unnamed(detections.skeleton)]
    for name, what in (("depth", "depths"), ("sigma_px", "standard deviations")):
        if getattr(detections, name) is not None:
            told.append(what)
    unsaid, zero = _odd_confidences(detections)
    if unsaid:
        told.append("that detections have no confidence: it is written as 1")
    if zero:
        told.append("detections with a confidence of 0, which is how OpenPose says missing")
    return tuple(told)


def _unnamed(skeleton: Skeleton) -> tuple[str, ...]:
    """What is said of a skeleton that the number of its keypoints does not tell."""
    alike = [name for name in shipped_skeletons() if len(shipped_skeleton(name)) == len(skeleton)]
    if alike == [skeleton.name] and shipped_skeleton(skeleton.name) == skeleton:
        return ()
    given = skeleton.name if skeleton.name in alike else "its TOML file"
    return (f"what the keypoints are called: to read them again, --skeleton {given}",)


def _odd_confidences(detections: Detections) -> tuple[bool, bool]:
    """Whether there are detections without a confidence, and with one of 0."""
    unsaid = zero = False
    for chunk in detections.chunks():
        seen = np.isfinite(np.asarray(chunk.keypoints_px)[..., 0])
        trust = np.asarray(chunk.confidence)
        unsaid |= bool(np.any(np.isnan(trust) & seen))
        zero |= bool(np.any((trust == 0.0) & seen))
    return unsaid, zero
