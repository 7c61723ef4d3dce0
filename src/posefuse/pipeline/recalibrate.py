"""Calibrate again after cameras were moved, with an earlier calibration as a prior."""

from dataclasses import replace
from pathlib import Path

from posefuse.arguments import checked
from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.boards.earlier import compare_with_earlier
from posefuse.io.board_images import find_images
from posefuse.io.calibration.read import read_cameras
from posefuse.model.board import Board
from posefuse.model.cameras import CameraRig
from posefuse.model.options.calibration import CalibrateOptions
from posefuse.model.view_names import matching_name
from posefuse.pipeline.calibrate_board import calibrate_by_board
from posefuse.progress import Progress


@checked
def recalibrate(
    images: str | Path,
    board: Board | str | Path,
    earlier: CameraRig | str | Path,
    *,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
    progress: Progress | None = None,
) -> BoardCalibration:
    """Calibrate cameras by a board after some of them were moved.

    The lenses are those of the earlier calibration. Cameras that did not move define the world, which is the earlier
    one, and their earlier poses are a prior; the notes name the cameras that moved, and by how much.

    Args:
        images: folder with one video, or one folder of pictures, per camera.
        board: the board, its description such as ``charuco:7x5,square=30mm``, or a file that describes it.
        earlier: the earlier calibration, or its file.
        timestamps: file or folder of the times of the images; by default those beside the videos.
        options: further options.
        progress: receives the progress.

    Returns:
        The cameras in the earlier world, unless no two of them kept their relative pose.

    Raises:
        CalibrationError: if the images do not determine the cameras, or the earlier calibration has none of them.
        FileError: if a file cannot be read.
        RecordingError: if the folder has no images, or several sets of them.
    """
    known = earlier if isinstance(earlier, CameraRig) else read_cameras(earlier)
    result = calibrate_by_board(
        images, board, intrinsics=known, timestamps=timestamps, options=options, progress=progress
    )
    compared = compare_with_earlier(result.rig, _renamed(known, [view.name for view in find_images(Path(images))]))
    if not compared.kept:
        note = "No two cameras kept their pose relative to each other; the world is that of the new calibration."
    elif compared.moved:
        note = f"Moved since the earlier calibration: {', '.join(map(str, compared.moved))}."
    else:
        note = "No camera moved since the earlier calibration."
    rig = replace(compared.rig, notes=(*result.rig.notes, note))
    return replace(result, rig=rig, notes=(*result.notes, note))


def _renamed(rig: CameraRig, views: list[str]) -> CameraRig:
    """Return the cameras of views, with the names of the views."""
    names = {view: matching_name(view, rig.names) for view in views}
    cameras = tuple(replace(rig[own], name=view) for view, own in names.items() if own is not None)
    covariances = tuple(
        replace(known, camera=view)
        for view, own in names.items()
        if own is not None and (known := rig.covariance(own)) is not None
    )
    return replace(rig, cameras=cameras, covariances=covariances)
