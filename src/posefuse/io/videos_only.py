"""The answer to a folder that has videos, but no 2D keypoints: the command that detects people, and what to install."""

import importlib.util
import shlex
from pathlib import Path

from posefuse.detection.open import default_detector
from posefuse.errors import DetectorError
from posefuse.io.videos.find import find_videos


def videos_only(folder: Path) -> str | None:
    """Return what to do with a folder of videos without keypoints, or None if it has no videos.

    Args:
        folder: folder of a recording without 2D keypoints.
    """
    videos = find_videos(folder)
    if not videos:
        return None
    what = "a video" if len(videos) == 1 else f"{len(videos)} videos"
    missing = _missing()
    install = f", after {' and '.join(missing)}" if missing else ""
    return (
        f"{folder} has {what}, but no 2D keypoints. Detect people and reconstruct them in one step: posefuse run "
        f"{shlex.quote(str(folder))} `output='OUT'`{install}."
    )


def _missing() -> list[str]:
    """Return the commands that install what a run needs and lacks."""
    commands = [] if importlib.util.find_spec("av") else ["pip install 'posefuse[video]'"]
    try:
        default_detector()
    except DetectorError:
        commands.append("posefuse detector install mediapipe")
    return commands
