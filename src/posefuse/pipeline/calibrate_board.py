"""Calibrate cameras from images of a board: find images, detect corners, align times, calibrate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.calibration.boards.calibration import BoardCalibration, Clocks, calibrate_board
from posefuse.errors import CalibrationError, choices
from posefuse.io.board_images import ViewImages, find_images
from posefuse.io.board_specs import read_board_spec
from posefuse.io.calibration.read import read_cameras
from posefuse.io.timestamps import Timestamps, find, read_timestamps
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import CalibrateOptions
from posefuse.model.view_names import matching_name
from posefuse.pipeline.detect_board import ViewCorners, detect_board
from posefuse.preprocess.timeline import align_views, fill_missing_times
from posefuse.progress import Progress, Silent


@checked
def calibrate_by_board(
    images: str | Path | Sequence[ViewImages],
    board: Board | str | Path,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
    progress: Progress | None = None,
) -> BoardCalibration:
    """Calibrate cameras from videos or pictures of a board.

    Args:
        images: folder with one video, or one folder of pictures, per camera; or the images of each camera.
        board: the board, its description such as ``charuco:7x5,square=30mm``, or a file that describes it.
        intrinsics: cameras with known lenses, or a calibration file; cameras that it does not name are estimated.
        timestamps: file or folder of the times of the images; by default those beside the videos.
        options: further options.
        progress: receives the progress.

    Returns:
        The cameras with their uncertainty. Their world is the first camera, or the board of ``origin_frame``.

    Raises:
        CalibrationError: if the images do not determine the cameras; the message states what to film.
        FileError: if a file cannot be read.
        RecordingError: if the folder has no images, or several sets of them.
    """
    options = options or CalibrateOptions()
    corners = read_corners(images, board, intrinsics, timestamps, options, progress or Silent())
    return with_notes(calibrate_corners(corners, corners.detections.view_names, options), corners.notes)


@dataclass(frozen=True, eq=False)
class BoardCorners:
    """Corners of a board in the images of all cameras.

    Attributes:
        board: the board.
        detections: the corners, on a common timeline.
        sizes_px: width and height of the images, by view.
        lenses: cameras with known lenses, by view.
        one_clock: whether times are those of one clock.
        notes: sentences on the images.
    """

    board: Board
    detections: Detections
    sizes_px: dict[str, tuple[int, int]]
    lenses: dict[str, Camera]
    one_clock: bool
    notes: tuple[str, ...]


def read_corners(
    images: str | Path | Sequence[ViewImages],
    board: Board | str | Path,
    intrinsics: CameraRig | str | Path | None,
    timestamps: str | Path | None,
    options: CalibrateOptions,
    progress: Progress,
) -> BoardCorners:
    """Find the images of all cameras, and the corners of the board in them.

    Raises:
        CalibrationError: if the images are those of one camera, or the lenses of other cameras.
        FileError: if a file cannot be read.
        RecordingError: if the folder has no images, or several sets of them.
    """
    board = board if isinstance(board, Board) else read_board_spec(board)
    views = find_images(Path(images)) if isinstance(images, str | Path) else tuple(images)
    if len(views) < 2:
        given = images if isinstance(images, str | Path) else choices([view.name for view in views])
        raise CalibrationError(f"{given} has the images of one camera; poses need at least two cameras.")
    place = views[0].files[0].parent
    found = detect_board(views, board, every=options.every, jobs=options.jobs, progress=progress)
    stamps = _timestamps(Path(images) if isinstance(images, str | Path) else place, place, timestamps)
    known = intrinsics if isinstance(intrinsics, CameraRig) or intrinsics is None else read_cameras(intrinsics)
    return BoardCorners(
        board,
        as_detections(found, board, stamps),
        {view.name: view.size_px for view in found},
        known_lenses(known, found),
        stamps is not None or not views[0].is_video,
        tuple(note for view in found for note in view.notes),
    )


def calibrate_corners(corners: BoardCorners, names: Sequence[str], options: CalibrateOptions) -> BoardCalibration:
    """Calibrate some of the cameras that see a board together.

    Raises:
        CalibrationError: if the images do not determine the cameras; the message states what to film.
    """
    return calibrate_board(
        corners.detections.views(names),
        corners.board,
        corners.sizes_px,
        intrinsics={name: camera for name, camera in corners.lenses.items() if name in names},
        refine_intrinsics=options.refine_intrinsics,
        lens=None if options.lens is None else LensModel(options.lens),
        origin_frame=options.origin_frame,
        clocks=_clocks(options, one_clock=corners.one_clock),
    )


def _clocks(options: CalibrateOptions, *, one_clock: bool) -> Clocks:
    """Return what is known about the times of the views."""
    if not options.time_offsets:
        return "synchronized"
    return "offset" if one_clock else "independent"


def _timestamps(folder: Path, beside: Path, given: str | Path | None) -> Timestamps | None:
    """Return the times of the images, given or found beside them."""
    if given is not None:
        return read_timestamps(Path(given))
    paths = find((folder, beside) if folder.is_dir() else (beside,))
    return read_timestamps(paths[0]) if len(paths) == 1 else None


def as_detections(views: Sequence[ViewCorners], board: Board, stamps: Timestamps | None = None) -> Detections:
    """Return corners as keypoints on a common timeline.

    Videos are aligned by timestamps, if any, else they are assumed to start together. Pictures belong together if they
    have the same name in the folders of all cameras.

    Args:
        views: corners of each camera.
        board: the board.
        stamps: times of the images.
    """
    numbers, times = _timeline(views, stamps)
    frames = np.unique(np.concatenate(numbers))
    pixels = np.full((len(frames), len(views), len(board.points_m), 2), np.nan)
    time_s = np.full((len(frames), len(views)), np.nan)
    for v, view in enumerate(views):
        at = np.searchsorted(frames, numbers[v])
        pixels[at, v] = view.corners_px
        time_s[at, v] = times[v]
        # Videos may have different lengths, or break off: the frames that they lack show no board.
        time_s[:, v] = fill_missing_times(time_s[:, v], frames)
    names = tuple(view.name for view in views)
    known = bool(np.isfinite(time_s).any())
    detections = Detections.from_dense(
        board.skeleton, names, pixels, time_s=time_s if known else None, frame_numbers=frames
    )
    return align_views(detections) if known else detections


def _timeline(views: Sequence[ViewCorners], stamps: Timestamps | None) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return frame numbers and times of the images of each view."""
    if not views[0].labels:
        times = [_times(view, stamps) for view in views]
        start = min(float(np.nanmin(t)) for t in times)
        return [view.numbers for view in views], [t - start for t in times]
    labels = [set(view.labels) for view in views]
    unknown = [np.full(len(view.labels), np.nan) for view in views]
    if all(each == labels[0] for each in labels):
        order = {name: k for k, name in enumerate(views[0].labels)}
        return [np.array([order[name] for name in view.labels]) for view in views], unknown
    starts = np.cumsum([0, *(len(view.labels) for view in views)])
    return [start + view.numbers for start, view in zip(starts, views, strict=False)], unknown


def _times(view: ViewCorners, stamps: Timestamps | None) -> np.ndarray:
    """Return the times of the images of a video, from timestamps if there are any for all of its images."""
    name = matching_name(view.name, stamps.by_view) if stamps else None
    own = stamps.by_view[name] if stamps and name is not None else None
    if own is None:
        return view.time_s
    if len(own.time_s) > view.numbers.max(initial=0):
        return own.time_s[view.numbers]
    return view.time_s


def known_lenses(known: CameraRig | None, views: Sequence[ViewCorners]) -> dict[str, Camera]:
    """Return the cameras with known lenses by view.

    Raises:
        CalibrationError: if a lens was calibrated at another resolution, or none is that of a view.
    """
    if known is None:
        return {}
    out: dict[str, Camera] = {}
    for view in views:
        name = matching_name(view.name, known.names)
        if name is None:
            continue
        camera = known[name]
        if camera.size_px != view.size_px:
            raise CalibrationError(
                f"The lens of camera {camera.name!r} was calibrated at {camera.size_px[0]} x {camera.size_px[1]} px, "
                f"but its images have {view.size_px[0]} x {view.size_px[1]} px. Use images of the same resolution."
            )
        out[view.name] = replace(camera, name=view.name)
    if not out:
        raise CalibrationError(
            f"`intrinsics` names none of the cameras {choices([view.name for view in views])}; it has "
            f"{choices(known.names)}."
        )
    return out


def with_notes(result: BoardCalibration, more: tuple[str, ...]) -> BoardCalibration:
    """Return a calibration with further notes, and in its rig those on how it was made, without clock or path."""
    all_notes = (*more, *result.notes)
    notes = (
        f"Calibrated by posefuse {version('posefuse')} from {result.n_corners} corners of the board {result.board} in "
        f"{result.n_frames} frames.",
        f"Root mean square error {result.error_px:.3f} px; distances on the board {100 * result.distances.error:+.3f} "
        f"% (spread {100 * result.distances.spread:.3f} %).",
    )
    if result.held_out.n_frames:
        notes = (
            *notes,
            f"Root mean square error in {result.held_out.n_frames} frames held out: {result.held_out.rms_px:.3f} px.",
        )
    return replace(result, rig=replace(result.rig, notes=(*notes, *all_notes)), notes=all_notes)
