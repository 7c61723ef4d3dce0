"""Parameters that several commands share."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from posefuse.cli.help import OPTIONS_GROUP
from posefuse.model.options.options import LengthUnit, Options

if TYPE_CHECKING:
    from posefuse.io.open_recording import RecordingInputs

OptionFlags = Annotated[Options, Parameter(name="*", group=Group(OPTIONS_GROUP, sort_key=2))]
Recording = Annotated[Path, Parameter(help="Folder of the recording.")]
Result = Annotated[Path, Parameter(help="Folder of a result or of a run, or reconstruction.nc.")]
Output = Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the results.")]
CalibrationPath = Annotated[Path | None, Parameter(help="Calibration file; by default the one in the recording.")]
KeypointsPath = Annotated[Path | None, Parameter(help="2D keypoints; by default those in the recording.")]
TimestampsPath = Annotated[
    Path | None,
    Parameter(help="Frame times; by default those in the recording."),
]
BoardSpec = Annotated[str | None, Parameter(help="Board that calibrates, with the people.")]
EditsPath = Annotated[Path | None, Parameter(help="TOML file of edits to apply; see posefuse edit.")]
Also = Annotated[
    tuple[str, ...],
    Parameter(help="Further formats to write; see posefuse formats."),
]
PointsUnit = Annotated[
    LengthUnit | None, Parameter(help="Length unit of files of 3D points that do not state it: m, cm or mm.")
]
JobsFlag = Annotated[
    int | Literal["auto"], Parameter(help="Number of processes; auto uses the physical cores where it pays.")
]
Overwrite = Annotated[bool, Parameter(negative="", help="Replace an earlier output.")]
SyncPath = Annotated[Path | None, Parameter(help="TOML file of time offsets that posefuse sync wrote.")]


def with_sync(options: Options, path: Path | None) -> Options:
    """Return the options with the time offsets of a file, if given."""
    if path is None:
        return options
    from posefuse.io.options import read_sync

    return replace(options, sync=read_sync(path))


@dataclass(frozen=True)
class InputFlags:
    """Flags that name the inputs of a recording."""

    calibration: CalibrationPath = None
    keypoints: KeypointsPath = None
    timestamps: TimestampsPath = None

    def paths(self, edits: Path | None = None) -> "RecordingInputs":
        """Return the paths of the inputs."""
        from posefuse.io.open_recording import RecordingInputs

        return RecordingInputs(self.calibration, self.keypoints, self.timestamps, edits)


@dataclass(frozen=True)
class SyncedInputFlags:
    """Flags that name the inputs of a recording without frame times, and earlier time offsets."""

    calibration: CalibrationPath = None
    keypoints: KeypointsPath = None
    sync: SyncPath = None

    def paths(self) -> "RecordingInputs":
        """Return the paths of the inputs."""
        from posefuse.io.open_recording import RecordingInputs

        return RecordingInputs(self.calibration, self.keypoints)


SyncedInputs = Annotated[SyncedInputFlags, Parameter(name="*")]
Inputs = Annotated[InputFlags, Parameter(name="*")]
