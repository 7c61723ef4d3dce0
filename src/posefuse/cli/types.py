"""Parameters that commands share."""

from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

from posefuse.model.options.options import Options

OptionFlags = Annotated[Options, Parameter(name="*", group=Group("Options", sort_key=2))]
Recording = Annotated[Path, Parameter(help="The recording's folder.")]
Output = Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the results; made if absent.")]
CalibrationPath = Annotated[Path | None, Parameter(help="Calibration file; by default the one in the recording.")]
KeypointsPath = Annotated[
    Path | None, Parameter(help="File or folder of 2D keypoints; by default those in the recording.")
]
TimestampsPath = Annotated[
    Path | None,
    Parameter(help="Table (camera, frame, time_s) or folder of when frames were taken; by default in the recording."),
]
EditsPath = Annotated[
    Path | None, Parameter(help="TOML file of edits to do to the result, as posefuse edit takes them.")
]
Also = Annotated[
    tuple[str, ...],
    Parameter(
        help="Formats to write as well: parquet, anipose, deeplabcut, sleap, movement, nwb, npz, freemocap, "
        "opensim, openpose (posefuse formats)."
    ),
]
SyncPath = Annotated[Path | None, Parameter(help="TOML file of how late views are, as posefuse sync writes it.")]
