"""``posefuse refine-calibration``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from posefuse.calibration.outcome import CameraOutcome, Refinement
from posefuse.cli.console import Bars, count, note, percent, say, table
from posefuse.cli.types import JobsFlag, OptionFlags, Overwrite, Recording, SyncedInputFlags, SyncedInputs, with_sync
from posefuse.model.options.options import Options
from posefuse.model.options.refinement import Refine, RefineOptions

Names = tuple[str, ...]


@dataclass(frozen=True)
class RefineFlags:
    """Flags that choose what is refined."""

    refine: Annotated[
        Refine,
        Parameter(help="Parameters to refine: extrinsics; focal (also focal lengths); lens (also k1 and k2)."),
    ] = "extrinsics"
    fix: Annotated[Names, Parameter(help="Cameras that are not refined and define the world.")] = ()
    relocate: Annotated[Names, Parameter(help="Cameras to locate without their initial poses.")] = ()
    seed: Annotated[int, Parameter(help="Random seed for locating cameras.")] = 0
    jobs: JobsFlag = "auto"


def refine_calibration(
    recording: Recording,
    *,
    output: Annotated[
        Path,
        Parameter(
            name=["--output", "-o"],
            help="Calibration file to write: name.qca.txt if the input is Qualisys', else name.toml.",
        ),
    ],
    inputs: SyncedInputs = SyncedInputFlags(),  # noqa: B008
    source: Annotated[
        Literal["keypoints", "board"],
        Parameter(name="--from", help="Refine by the keypoints of a moving subject, or by the corners of a board."),
    ] = "keypoints",
    refining: Annotated[RefineFlags, Parameter(name="*")] = RefineFlags(),
    overwrite: Overwrite = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Refine the poses of cameras, and optionally their lenses, from a recording; print the changes and uncertainties.

    The input calibration is not changed. Cameras that cannot be refined are left out by name.
    """
    from posefuse.cli.verdict import say_verdict
    from posefuse.pipeline.refine_recording import refine_recording

    jobs = None if refining.jobs == "auto" else refining.jobs
    chosen = RefineOptions(refining.refine, refining.fix, refining.relocate, seed=refining.seed, jobs=jobs)
    result, form = refine_recording(
        recording,
        output,
        with_sync(options, inputs.sync),
        chosen,
        source=source,
        inputs=inputs.paths(),
        overwrite=overwrite,
        progress=Bars(),
    )
    describe(result)
    note(f"Wrote {output} {form}")
    if result.findings is not None:
        say_verdict(result.findings)
    if result.is_better:
        say(f"Use it: posefuse reconstruct RECORDING --calibration {output}")
        return
    say(f"Keep the original calibration: {NOT_SHOWN}")


NOT_SHOWN = (
    "the recording does not show that the refined one is better. Systematic errors of the detector lower the held-out "
    "error as well. To determine the poses better, film a person who walks through the whole volume."
)
"""Why a refined calibration is not recommended."""


def describe(result: Refinement) -> None:
    """Print the changes of all cameras."""
    say(
        f"{count(len(result.rig), 'camera')}, {result.refine}, by {count(result.n_points, 'point')} of "
        f"{count(result.n_frames, 'frame')}"
    )
    say(
        f"median error in {count(result.n_held_out, 'frame')} held out: {result.before_px:.2f} px before, "
        f"{result.after_px:.2f} px after"
    )
    refined = [camera for camera in result.cameras if camera.role != "left out"]
    columns = ["camera", "", "px before", "px after", "agree", "turned deg", "moved cm"]
    table(None, columns, [_row(camera) for camera in refined])
    lenses = [camera for camera in refined if camera.focal_sd > 0]
    if lenses:
        rows = [[each.name, f"{100 * each.focal_share:.2f} +-{100 * each.focal_sd:.2f}"] for each in lenses]
        table(None, ["camera", "focal length %"], rows)
    note("+- is a standard deviation, in the direction of largest uncertainty.")
    for camera in result.cameras:
        if camera.role == "left out":
            note(f"left out: camera {camera.name!r}: {camera.why}")


def _row(camera: CameraOutcome) -> list[str]:
    role = "" if camera.role == "refined" else camera.role
    fixed = camera.role == "fixed"
    turned = "-" if fixed else f"{camera.turn_deg:.2f} +-{camera.turn_sd_deg:.2f}"
    moved = "-" if fixed else f"{100 * camera.shift_m:.2f} +-{100 * camera.shift_sd_m:.2f}"
    errors = [f"{value:.2f}" for value in (camera.before_px, camera.after_px)]
    return [camera.name, role, *errors, percent(camera.used_after), turned, moved]
