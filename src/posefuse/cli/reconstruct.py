"""``posefuse reconstruct``."""

import sys
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, warn, wrote
from posefuse.cli.describe_result import describe_gait, describe_remarks, describe_result, layer_remark
from posefuse.cli.findings import AcceptFindings, exit_on_certain_faults
from posefuse.cli.types import (
    Also,
    BoardSpec,
    EditsPath,
    InputFlags,
    JobsFlag,
    OptionFlags,
    Output,
    Overwrite,
    Recording,
    SyncPath,
    with_sync,
)
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import Smoother


@dataclass(frozen=True)
class Shortcuts:
    """Short flags for frequently used options."""

    smoother: Annotated[Smoother | None, Parameter(help="Short for --tracker.smoother.")] = None
    max_people: Annotated[int | None, Parameter(help="Short for --tracker.max-people.")] = None
    static: Annotated[str | None, Parameter(help="Static trial: frames START:STOP, or a result.")] = None
    align: Annotated[Literal["floor"] | None, Parameter(help="Short for --align.floor feet.")] = None

    def applied_to(self, options: Options) -> Options:
        """Return the options with the values of the short flags."""
        values = {"smoother": self.smoother, "max_people": self.max_people}
        given = {name: value for name, value in values.items() if value is not None}
        options = replace(options, tracker=replace(options.tracker, **given))
        if self.static is not None:
            options = replace(options, subject=replace(options.subject, static=self.static))
        return options if self.align is None else replace(options, align=replace(options.align, floor="feet"))


@dataclass(frozen=True)
class ReconstructionInputs(InputFlags):
    """Flags that name the inputs of a reconstruction."""

    board: BoardSpec = None
    edits: EditsPath = None
    sync: SyncPath = None


@dataclass(frozen=True)
class Outputs:
    """Flags of what is written, and of the exit code."""

    also: Also = ()
    overwrite: Overwrite = False
    accept_findings: AcceptFindings = False


def reconstruct(
    recording: Recording,
    *,
    output: Output,
    inputs: Annotated[ReconstructionInputs, Parameter(name="*")] = ReconstructionInputs(),
    shortcuts: Annotated[Shortcuts, Parameter(name="*")] = Shortcuts(),
    outputs: Annotated[Outputs, Parameter(name="*")] = Outputs(),
    jobs: JobsFlag = "auto",
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Reconstruct people in 3D from a recording's calibration and 2D keypoints.

    Writes reconstruction.nc (everything), keypoints.csv (measured points), report.html, one .trc and .c3d per person;
    angles.csv and one .mot per human; solved.csv where points are solved over time; and model.csv, events.csv and one
    .bvh and .glb per person where bodies are fitted.

    A recording of more than --chunk-frames frames is reconstructed chunk by chunk. Finished chunks are stored in
    OUTPUT/.parts until the result is complete: after an interruption of any kind, the same command resumes from the
    last finished chunk. Ctrl-C writes a partial result of the finished chunks. If OUTPUT already contains the result of
    the same inputs and options, nothing is done; any other result in it is replaced only with --overwrite.

    The exit code is 3 if the recording check is certain that the result is wrong; --accept-findings makes it 0.
    """
    from posefuse.pipeline.reconstruct_recording import reconstruct_recording

    options = with_sync(shortcuts.applied_to(options), inputs.sync)
    outcome = reconstruct_recording(
        recording,
        output,
        options,
        inputs=replace(inputs.paths(inputs.edits), board=inputs.board),
        also=outputs.also,
        overwrite=outputs.overwrite,
        progress=Bars(),
        jobs=jobs,
    )
    if outcome.kept:
        note(f"{output} already contains the result of these inputs and options; nothing was done.")
        exit_on_certain_faults(outcome.findings, outputs.accept_findings, "the result is")
        return
    result = outcome.open()
    describe_result(result)
    describe_gait(outcome.gait)
    describe_remarks(outcome.remarks)
    wrote(outcome.files, output, layer_remark(outcome.files, outcome.layer, outputs.also))
    if outcome.partial:
        warn(outcome.partial)
        sys.exit(130)
    exit_on_certain_faults(outcome.findings, outputs.accept_findings, "the result is")
