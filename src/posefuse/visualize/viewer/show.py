"""A result into a file of rerun's, or into its window."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from posefuse.errors import ResultError
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress
from posefuse.visualize.viewer.layout import layout
from posefuse.visualize.viewer.library import rerun
from posefuse.visualize.viewer.scene import Footage, log_scene

APPLICATION = "posefuse"


def save_scene(
    result: Reconstruction,
    path: Path,
    detections: Detections | None = None,
    footage: Mapping[str, Footage] | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a result as a ``.rrd``, which ``rerun FILE`` opens; arguments as of :func:`log_scene`.

    Its content is the same for the same result; rerun numbers the file's rows by the clock.
    """
    rr = rerun()
    recording = rr.RecordingStream(APPLICATION, recording_id=APPLICATION, send_properties=False)
    recording.save(path, default_blueprint=layout(result))
    try:
        log_scene(recording, result, detections, footage, progress)
    finally:
        recording.disconnect()


def open_scene(
    result: Reconstruction,
    detections: Detections | None = None,
    footage: Mapping[str, Footage] | None = None,
    progress: Progress | None = None,
) -> None:
    """Open rerun's window and show a result in it; arguments as of :func:`log_scene`.

    Raises:
        ResultError: if this machine has no display, or the window does not open.
    """
    must_have_display()
    rr = rerun()
    recording = rr.RecordingStream(APPLICATION, recording_id=APPLICATION, send_properties=False)
    try:
        recording.spawn(default_blueprint=layout(result))
    except (RuntimeError, OSError) as error:
        raise ResultError(f"rerun's window did not open: {error}. Save the scene instead: --save scene.rrd.") from None
    try:
        log_scene(recording, result, detections, footage, progress)
    finally:
        recording.disconnect()


def must_have_display() -> None:
    """Refuse before any work is done where no window can open.

    Raises:
        ResultError: on a machine without display.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ResultError(
            "This machine has no display to open rerun's window on. Write the scene with --save scene.rrd, and open it "
            "where there is one: rerun scene.rrd. Or look at the result's report.html."
        )
