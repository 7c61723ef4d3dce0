"""FreeMoCap recording folders: ``output_data/raw_data/*2dData*.npy``, [camera, frame, keypoint, 3].

The third channel is MediaPipe's depth, OpenPose's confidence, or empty; for other trackers ``--third-channel`` defines
it. Cameras are in the order of the lower-case names of the videos in ``synchronized_videos``; without videos, views are
called ``camera_0``, ... and need ``--camera-order``.
"""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import read_npy
from posefuse.io.keypoints.arrays import from_array
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.model.options.options import ThirdChannel

_THIRD: tuple[tuple[str, ThirdChannel], ...] = (("mediapipe", "depth"), ("openpose", "confidence"))
"""Meaning of the third channel, by the start of the name of the array."""
_VIDEOS = (".mp4", ".avi", ".mov", ".mkv")


def matches(path: Path) -> bool:
    """Return whether a folder is a FreeMoCap recording."""
    return path.is_dir() and bool(arrays_in(path))


def arrays_in(path: Path) -> list[Path]:
    """Return the 2D arrays of a recording folder."""
    return sorted((path / "output_data" / "raw_data").glob("*2dData*.npy"))


def read(path: Path, request: Request) -> Detections:
    """Read the 2D array of a recording.

    Raises:
        FileError: If there is not exactly one array, or the number of videos does not match it.
        DetectionsError: If the meaning of the third channel is unknown.
    """
    arrays = arrays_in(path)
    if len(arrays) != 1:
        raise FileError(
            f"{path} has {len(arrays)} 2D arrays ({choices(a.name for a in arrays)}). Choose one with `keypoints`."
        )
    keypoints = read_npy(arrays[0])
    names = view_names(path)
    if names and len(names) != len(keypoints):
        raise FileError(f"{path} has {len(names)} videos, but {arrays[0].name} has {len(keypoints)} cameras.")
    names = names or [f"camera_{i}" for i in range(len(keypoints))]
    by_name: list[ThirdChannel] = [kind for name, kind in _THIRD if arrays[0].name.lower().startswith(name)]
    if keypoints.ndim == 4 and keypoints.shape[-1] == 3 and not np.isfinite(keypoints[..., 2]).any():
        keypoints = keypoints[..., :2]
    third = request.third_channel or (by_name[0] if by_name else None)
    array_request = Request(request.skeleton, request.rate_hz, third, request.progress)
    return from_array(arrays[0], keypoints, names, request.rate_hz, array_request)


def view_names(path: Path) -> list[str]:
    """Return the stems of the synchronized videos in FreeMoCap's order."""
    folder = path / "synchronized_videos"
    videos = [entry for entry in folder.iterdir() if entry.suffix.lower() in _VIDEOS] if folder.is_dir() else []
    return [video.stem for video in sorted(videos, key=lambda video: video.name.lower())]


FORMAT = KeypointFormat(
    name="freemocap",
    files="a recording folder with output_data/raw_data/*2dData*.npy",
    conventions=(
        "px; [camera, frame, keypoint, 3], the third channel is depth; cameras in the order of the video names"
    ),
    recognized_by="output_data/raw_data/*2dData*.npy",
    matches=matches,
    read=read,
    input_files=arrays_in,
)
