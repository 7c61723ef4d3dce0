"""A FreeMoCap recording folder: ``output_data/raw_data/*2dData*.npy``, [camera, frame, keypoint, 3].

The third channel is the tracker's depth (the file's name says pixelXY). Cameras are in the order of the videos' lower-
cased names in ``synchronized_videos``; without those, views are called ``camera_0`` ... and need ``--camera-order``.
"""

from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.files import read_npy
from posefuse.io.keypoints.arrays import from_array
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections

_VIDEOS = (".mp4", ".avi", ".mov", ".mkv")


def matches(path: Path) -> bool:
    """Whether the folder is one."""
    return path.is_dir() and bool(arrays_in(path))


def arrays_in(path: Path) -> list[Path]:
    """The 2D arrays of a recording folder."""
    return sorted((path / "output_data" / "raw_data").glob("*2dData*.npy"))


def read(path: Path, request: Request) -> Detections:
    """Read the recording's 2D array.

    Raises:
        FileError: if there are several arrays, or videos do not fit the array.
    """
    arrays = arrays_in(path)
    if len(arrays) != 1:
        raise FileError(
            f"{path} has {len(arrays)} 2D arrays ({choices(a.name for a in arrays)}). Give one: --keypoints FILE."
        )
    keypoints = read_npy(arrays[0])
    names = view_names(path)
    if names and len(names) != len(keypoints):
        raise FileError(f"{path}: {len(names)} videos, but {len(keypoints)} cameras in {arrays[0].name}.")
    names = names or [f"camera_{i}" for i in range(len(keypoints))]
    asked = Request(request.skeleton, request.rate_hz, request.third_channel or "depth", request.progress)
    return from_array(arrays[0], keypoints, names, request.rate_hz, asked)


def view_names(path: Path) -> list[str]:
    """Stems of the synchronised videos, in FreeMoCap's order."""
    folder = path / "synchronized_videos"
    videos = [entry for entry in folder.iterdir() if entry.suffix.lower() in _VIDEOS] if folder.is_dir() else []
    return [video.stem for video in sorted(videos, key=lambda video: video.name.lower())]
