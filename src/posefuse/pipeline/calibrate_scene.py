"""Calibrate cameras from points of known position: lenses from a board or a file, poses from the points."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.calibration.boards.covariance import lens_covariance
from posefuse.calibration.boards.intrinsics import LENSES, estimate_intrinsics
from posefuse.calibration.boards.observations import corner_observations
from posefuse.calibration.scene.calibration import SceneCalibration, calibrate_by_scene
from posefuse.calibration.scene.view import KnownLens
from posefuse.errors import CalibrationError, choices
from posefuse.io.board_images import find_images
from posefuse.io.board_specs import read_board_spec
from posefuse.io.calibration.read import read_cameras
from posefuse.io.scene_points import read_scene_points
from posefuse.model.board import Board
from posefuse.model.cameras import CameraRig, LensModel
from posefuse.model.options.calibration import CalibrateOptions
from posefuse.model.scene_points import ScenePoints
from posefuse.model.view_names import matching_name
from posefuse.pipeline.calibrate_board import as_detections, known_lenses
from posefuse.pipeline.detect_board import detect_board
from posefuse.progress import Progress, Silent


@checked
def calibrate_scene(
    scene_points: ScenePoints | str | Path,
    images: str | Path | None = None,
    board: Board | str | Path | None = None,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    options: CalibrateOptions | None = None,
    progress: Progress | None = None,
) -> SceneCalibration:
    """Calibrate cameras from points of known position.

    Args:
        scene_points: the points and their places in the images of the cameras, or a file of them.
        images: folder with one video, or one folder of pictures, of a board per camera, for the lenses.
        board: the board.
        intrinsics: cameras with known lenses, or a calibration file.
        options: further options.
        progress: receives the progress.

    Returns:
        The cameras in the world of the points, with their uncertainty.

    Raises:
        CalibrationError: if the points or images do not determine the cameras; the message states what to add.
        FileError: if a file cannot be read.
        RecordingError: if the folder has no images, or several sets of them.
    """
    options = options or CalibrateOptions()
    scene = scene_points if isinstance(scene_points, ScenePoints) else read_scene_points(scene_points)
    known = intrinsics if isinstance(intrinsics, CameraRig) or intrinsics is None else read_cameras(intrinsics)
    if images is not None and board is not None:
        lenses = _estimated(Path(images), board, known, options, progress or Silent())
    elif known is not None:
        lenses = tuple(KnownLens(camera) for camera in known.cameras)
    else:
        raise CalibrationError(
            "Scene points give the poses of cameras with known lenses. Give the lenses with `intrinsics`, or a folder "
            "of pictures of a board and its `board`."
        )
    lenses, scene = _matched(lenses, scene)
    _require_inside(lenses, scene)
    result = calibrate_by_scene(lenses, scene)
    return replace(result, rig=replace(result.rig, notes=_notes(result)))


def _estimated(
    images: Path, board: Board | str | Path, known: CameraRig | None, options: CalibrateOptions, progress: Progress
) -> tuple[KnownLens, ...]:
    """Return the lenses of the cameras that filmed a board, with their covariance; known ones are fixed."""
    board = board if isinstance(board, Board) else read_board_spec(board)
    found = detect_board(find_images(images), board, every=options.every, jobs=options.jobs, progress=progress)
    corners = corner_observations(as_detections(found, board), board)
    given = known_lenses(known, found)
    models = LENSES if options.lens is None else (LensModel(options.lens),)
    lenses = []
    for v, view in enumerate(found):
        if view.name in given and not options.refine_intrinsics:
            lenses.append(KnownLens(given[view.name]))
            continue
        own = corners.of_view(v)
        camera = estimate_intrinsics(view.name, view.size_px, board, own, models).camera
        lenses.append(KnownLens(camera, lens_covariance(camera, board, own)))
    return tuple(lenses)


def _matched(lenses: Sequence[KnownLens], scene: ScenePoints) -> tuple[tuple[KnownLens, ...], ScenePoints]:
    """Return the lenses of the cameras in the file of points, with the names in it, and the points in their images."""
    names = {lens.camera.name: matching_name(lens.camera.name, scene.pixels) for lens in lenses}
    used = [own for own in names.values() if own is not None]
    if not used:
        raise CalibrationError(
            f"The scene points are in images of {choices(scene.pixels)}, but the cameras are {choices(names)}. Use the "
            "same names."
        )
    unknown = [name for name in scene.pixels if name not in used]
    if unknown:
        raise CalibrationError(
            f"Camera {unknown[0]!r} of the scene points has no lens; known are {choices(names)}. Add its lens, or "
            "remove it from the scene points."
        )
    return (
        tuple(
            KnownLens(replace(lens.camera, name=own, camera_from_world=np.eye(4)), lens.covariance)
            for lens in lenses
            if (own := names[lens.camera.name]) is not None
        ),
        scene,
    )


def _require_inside(lenses: Sequence[KnownLens], scene: ScenePoints) -> None:
    """Raise an error if a point is outside of its image, which has another size than that of the lens."""
    for lens in lenses:
        places, (width, height) = scene.pixels[lens.camera.name], lens.camera.size_px
        outside = np.flatnonzero(np.any((places < -0.5) | (places > (width - 0.5, height - 0.5)), axis=1))
        if len(outside):
            raise CalibrationError(
                f"Scene point {outside[0] + 1} is at {places[outside[0]].tolist()} px in camera {lens.camera.name!r}, "
                f"but its images have {width} x {height} px. Measure the points in images of that size."
            )


def _notes(result: SceneCalibration) -> tuple[str, ...]:
    """Return notes on how the rig was made, without clock or path."""
    counts = [report.n_points for report in result.cameras]
    notes = [
        f"Calibrated by posefuse {version('posefuse')} from {sum(counts)} places of points of known position.",
        f"Root mean square error {result.error_px:.3f} px.",
    ]
    if result.left_out:
        notes.append(f"Without pose: {choices(name for name, _ in result.left_out)}.")
    return tuple(notes)
