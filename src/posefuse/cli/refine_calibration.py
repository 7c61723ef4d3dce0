"""``posefuse refine-calibration``."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from posefuse.calibration.outcome import CameraOutcome, Refinement
from posefuse.cli.console import Bars, count, note, percent, say, table
from posefuse.cli.reading import digest
from posefuse.cli.types import CalibrationPath, KeypointsPath, OptionFlags, Recording
from posefuse.errors import FileError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.refinement import Refine, RefineOptions
from posefuse.progress import Progress

Source = Literal["keypoints", "board"]
Names = tuple[str, ...]


def refine_calibration(
    recording: Recording,
    *,
    output: Annotated[
        Path,
        Parameter(
            name=["--output", "-o"],
            help="Calibration to write: in the format of the one that is read if that is Pose2Sim's or Qualisys' "
            "(name.qca.txt), else in Anipose's (name.toml).",
        ),
    ],
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    source: Annotated[
        Source, Parameter(name="--from", help="Refine by a moving subject's keypoints, or by a board's corners.")
    ] = "keypoints",
    refine: Annotated[
        Refine, Parameter(help="What may change: extrinsics; focal, these and focal lengths; lens, also k1 and k2.")
    ] = "extrinsics",
    fix: Annotated[Names, Parameter(help="Cameras that stay as they are, and hold the world.")] = (),
    relocate: Annotated[Names, Parameter(help="Cameras to locate from scratch, their given pose ignored.")] = (),
    seed: Annotated[int, Parameter(help="Of the samples by which cameras are located.")] = 0,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Refine where cameras stand, and their lenses, by what they saw; say what changed and how well it is known.

    The calibration that is read stays as it is. Cameras that cannot be helped are left out by name.
    """
    from posefuse.io.calibration.write import check_name, write_like
    from posefuse.pipeline.refine_calibration import refine_calibration as refined

    progress = Bars()
    chosen = RefineOptions(refine, fix, relocate, seed=seed, rigid=source == "board")
    place, rig, detections = _read(recording, calibration, keypoints, source, options, progress)
    if output.exists() and output.resolve() == place.resolve():
        raise FileError(f"--output {output} is the calibration that is refined, which stays as it is. Name another.")
    check_name(output, place)
    if source == "board":
        options = replace(options, people="one")
    result = refined(rig, detections, options, chosen, progress=progress)
    describe(result)
    form = write_like(_with_provenance(result, place, source), output, place)
    note(f"Wrote {output} {form}")
    say(f"Use it: posefuse reconstruct RECORDING --calibration {output}")


def _read(
    recording: Path,
    calibration: Path | None,
    keypoints: Path | None,
    source: Source,
    options: Options,
    progress: Progress,
) -> tuple[Path, CameraRig, Detections]:
    """The calibration's file, the calibration, and what its cameras saw."""
    from posefuse.io.boards import find_board, read_board
    from posefuse.io.calibration.read import read_cameras
    from posefuse.io.keypoints.read import read_keypoints
    from posefuse.io.keypoints.request import Request
    from posefuse.io.recording import choose_calibration, choose_keypoints, find_recording

    found = find_recording(recording) if calibration is None or (keypoints is None and source == "keypoints") else None
    if found is not None:
        calibration = calibration or choose_calibration(found)
    assert calibration is not None
    rig = read_cameras(calibration, length_unit=options.length_unit, up=options.up)
    if source == "board":
        return calibration, rig, read_board(keypoints or find_board(recording), rig.names)
    if found is not None:
        keypoints = keypoints or choose_keypoints(found)
    assert keypoints is not None
    return calibration, rig, read_keypoints(keypoints, Request.of(options, progress))


def _with_provenance(result: Refinement, calibration: Path, source: Source) -> CameraRig:
    """The refined rig, its notes saying how it came about; no clock, no path."""
    from posefuse import __version__

    said = [
        f"Refined by posefuse {__version__} refine-calibration --refine {result.refine} --from {source} from "
        f"{calibration.name} (SHA-256 {digest(calibration)}).",
        f"Median error in {count(result.n_held_out, 'frame')} that were kept back: {result.before_px:.2f} px before, "
        f"{result.after_px:.2f} px after.",
    ]
    for camera in result.cameras:
        if camera.role == "left out":
            said.append(f"Camera {camera.name!r} was left out: {camera.why}")
        elif camera.role == "located":
            said.append(f"Camera {camera.name!r} was located from scratch.")
        elif camera.role == "fixed":
            said.append(f"Camera {camera.name!r} was kept as it was.")
    return replace(result.rig, notes=tuple(said), left_out=result.left_out)


def describe(result: Refinement) -> None:
    """Say what changed."""
    say(
        f"{count(len(result.rig), 'camera')}, {result.refine}, by {count(result.n_points, 'point')} of "
        f"{count(result.n_frames, 'frame')}"
    )
    say(
        f"median error in {count(result.n_held_out, 'frame')} kept back: {result.before_px:.2f} px before, "
        f"{result.after_px:.2f} px after"
    )
    kept = [camera for camera in result.cameras if camera.role != "left out"]
    columns = ["camera", "", "px before", "px after", "agree", "turned deg", "moved cm"]
    table(None, columns, [_row(camera) for camera in kept])
    lenses = [camera for camera in kept if camera.focal_sd > 0]
    if lenses:
        rows = [[each.name, f"{100 * each.focal_share:.2f} +-{100 * each.focal_sd:.2f}"] for each in lenses]
        table(None, ["camera", "focal length %"], rows)
    note("+- is a standard deviation, in the direction known worst.")
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
