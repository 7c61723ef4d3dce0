"""``posefuse replay``."""

import sys
import time
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars
from posefuse.cli.types import CalibrationPath, KeypointsPath, OptionFlags, Recording
from posefuse.model.options.options import Options


def replay(
    recording: Recording,
    *,
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    pace: Annotated[float, Parameter(help="Speed relative to real time; 0 writes as fast as the reader reads.")] = 0.0,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Write a recording's 2D keypoints as the lines that posefuse stream reads.

    Cameras have the names of the calibration.
    """
    from posefuse.errors import OptionsError
    from posefuse.io.open_recording import RecordingInputs, open_recording
    from posefuse.io.stream import lines_of
    from posefuse.pipeline.defaults import cut_time
    from posefuse.preprocess.match_cameras import match_views

    if not 0.0 <= pace < float("inf"):
        raise OptionsError(f"--pace must be 0 or more, got {pace}.")
    inputs = open_recording(recording, RecordingInputs(calibration, keypoints), options, Bars(), timed=True)
    rig, detections, _ = match_views(inputs.rig, inputs.detections, options)
    start_s = first_s = None
    for time_s, line in lines_of(cut_time(detections, options), rig.names):
        if pace and start_s is None:
            start_s, first_s = time.monotonic(), time_s
        if start_s is not None and first_s is not None:
            time.sleep(max(0.0, start_s + (time_s - first_s) / pace - time.monotonic()))
        try:
            sys.stdout.buffer.write(line)
            if pace:
                sys.stdout.buffer.flush()
        except BrokenPipeError:
            return
