"""Show a result in rerun's viewer, or save it to a .rrd file."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from posefuse.errors import ResultError
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress
from posefuse.visualize.viewer.layout import build_layout
from posefuse.visualize.viewer.library import import_rerun
from posefuse.visualize.viewer.scene import ViewerVideo, log_scene

APPLICATION = "posefuse"


def save_scene(
    result: Reconstruction,
    path: Path,
    detections: Detections | None = None,
    videos: Mapping[str, ViewerVideo] | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a result to a ``.rrd`` file, which ``rerun FILE`` opens. For the arguments, see :func:`log_scene`.

    The same result gives the same content, but rerun derives the row ids of the file from the current time.
    """
    rr = import_rerun()
    recording = rr.RecordingStream(APPLICATION, recording_id=APPLICATION, send_properties=False)
    recording.save(path, default_blueprint=build_layout(result))
    try:
        log_scene(recording, result, detections, videos, progress)
    finally:
        recording.disconnect()


def open_scene(
    result: Reconstruction,
    detections: Detections | None = None,
    videos: Mapping[str, ViewerVideo] | None = None,
    progress: Progress | None = None,
) -> None:
    """Open rerun's window and show a result. For the arguments, see :func:`log_scene`.

    Raises:
        ResultError: if this machine has no display, or the window does not open.
    """
    require_display()
    rr = import_rerun()
    recording = rr.RecordingStream(APPLICATION, recording_id=APPLICATION, send_properties=False)
    try:
        recording.spawn(default_blueprint=build_layout(result))
    except (RuntimeError, OSError) as error:
        raise ResultError(f"Cannot open rerun's window: {error}. Save the scene with `save='scene.rrd'`.") from None
    try:
        log_scene(recording, result, detections, videos, progress)
    finally:
        recording.disconnect()


def require_display() -> None:
    """Check that a window can be opened, before any work is done.

    Raises:
        ResultError: if this machine has no display.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ResultError(
            "This machine has no display for rerun's window. Write the scene with `save='scene.rrd'` and open it on a "
            "machine with a display: rerun scene.rrd. Or open the result's report.html."
        )
