"""Find the frame rate of keypoints without times, in settings files and videos beside them.

Sources, in this order: Pose2Sim's ``Config.toml`` (``project.frame_rate``), videos, OpenCap's ``sessionMetadata.yaml``
(``framerate``), and FreeMoCap's ``recording_parameters.json`` (``framerate`` of the postprocessing).
"""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from posefuse.errors import PosefuseError
from posefuse.io.keypoints.pose2sim_config import find_settings
from posefuse.io.videos.library import import_pyav

_LEVELS = 3
_SETTINGS_LEVELS = 5
"""OpenCap's settings lie up to four folders above a file of keypoints."""
_VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".mkv")
_VIDEO_FOLDERS = ("videos", "Videos", "synchronized_videos", "InputMedia")
_MAX_VIDEOS = 32
_MAX_BYTES = 1 << 20
# Cameras of one recording state rates such as 29.97 and 30 for the same clock.
_TOLERANCE = 5e-3


@dataclass(frozen=True)
class FrameRate:
    """A frame rate and the name of the file that states it."""

    rate_hz: float
    source: str


def find_frame_rate(keypoints: Path) -> FrameRate | None:
    """Return the frame rate that files beside keypoints state, or None if there is none.

    Args:
        keypoints: File or folder of keypoints. Its folder and the two levels above are searched for videos, and two
            further levels for settings.
    """
    start = keypoints if keypoints.is_dir() else keypoints.parent
    folders = [start, *list(start.resolve().parents)[: _SETTINGS_LEVELS - 1]]
    try:
        rate_hz = find_settings(start).rate_hz
    except PosefuseError:
        rate_hz = None
    if rate_hz is not None:
        return FrameRate(rate_hz, "Config.toml")
    return _rate_of_videos(folders[:_LEVELS]) or _rate_of_settings(folders)


def _rate_of_settings(folders: list[Path]) -> FrameRate | None:
    for folder in folders:
        for path in (folder / "sessionMetadata.yaml", folder / "recording_parameters.json"):
            if path.is_file() and path.stat().st_size <= _MAX_BYTES:
                rate_hz = _stated_rate_hz(path)
                if rate_hz is not None:
                    return FrameRate(rate_hz, path.name)
    return None


def _stated_rate_hz(path: Path) -> float | None:
    try:
        text = path.read_text("utf-8")
        if path.suffix == ".json":
            return _valid_rate(_find_key(json.loads(text), "framerate"))
    except (OSError, ValueError, RecursionError):
        return None
    match = re.search(r"(?mi)^\s*frame_?rate:\s*([0-9.]+)\s*$", text)
    return _valid_rate(match.group(1)) if match else None


def _find_key(value: Any, key: str) -> Any:
    """Return the first value of a key in nested tables, or None."""
    if not isinstance(value, dict):
        return None
    if key in value:
        return value[key]
    return next((found for inner in value.values() if (found := _find_key(inner, key)) is not None), None)


def _valid_rate(value: Any) -> float | None:
    try:
        rate_hz = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        return None
    return rate_hz if 0.0 < rate_hz < math.inf else None


def _rate_of_videos(folders: list[Path]) -> FrameRate | None:
    """Return the frame rate of the nearest videos, if PyAV is installed and all of them agree."""
    for folder in folders:
        videos = [path for place in (folder, *(folder / name for name in _VIDEO_FOLDERS)) for path in _videos_in(place)]
        if videos:
            rates = [_rate_of_video(path) for path in videos[:_MAX_VIDEOS]]
            known = [rate for rate in rates if rate is not None]
            agree = len(known) == len(rates) and max(known) - min(known) <= _TOLERANCE * max(known)
            return FrameRate(known[0], videos[0].name) if agree else None
    return None


def _videos_in(folder: Path) -> Iterator[Path]:
    if folder.is_dir():
        yield from sorted(path for path in folder.iterdir() if path.suffix.lower() in _VIDEO_SUFFIXES)


def _rate_of_video(path: Path) -> float | None:
    """Return the mean frame rate that the header of a video states, or None."""
    try:
        av = import_pyav()
        with av.open(str(path)) as container:
            rate = container.streams.video[0].average_rate if container.streams.video else None
    except Exception:  # a broken header raises whatever its bytes lead to, and PyAV may be missing
        return None
    return _valid_rate(rate)
