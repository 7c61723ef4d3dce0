"""Calibrate again after cameras were moved, with an earlier calibration as a prior."""

from dataclasses import replace
from pathlib import Path
from typing import overload

import numpy as np

from posefuse.arguments import checked
from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.boards.earlier import MovedCamera, compare_with_earlier
from posefuse.calibration.people.known_cameras import KnownGroup, pose_difference
from posefuse.calibration.people.known_estimate import KnownEstimate, estimate_with_known
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.errors import CalibrationError, OptionsError, choices
from posefuse.io.board_images import find_images
from posefuse.io.calibration.read import read_cameras
from posefuse.model.board import Board
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
from posefuse.model.view_names import matching_name
from posefuse.pipeline.calibrate_board import calibrate_by_board
from posefuse.pipeline.calibrate_people import PeopleSource, match_people, world_of_people
from posefuse.pipeline.people_result import people_result
from posefuse.pipeline.people_world import earlier_world
from posefuse.pipeline.refuse_options import refuse_options
from posefuse.progress import Progress, Silent

_LEAST_SD = np.radians(0.02), 0.0003
_ASSUMED_SD = np.radians(0.2), 0.005
"""Standard deviations of poses that did not change, at least, and of those without a stated covariance: rotation
(rad), and center as a share of the distance to the other cameras."""
_NONE_KEPT = "No two cameras kept their pose relative to each other; the world is that of the new calibration."


@overload
def recalibrate(
    recording: str | Path,
    board: Board | str | Path,
    earlier: CameraRig | str | Path,
    *,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
    progress: Progress | None = None,
) -> BoardCalibration: ...


@overload
def recalibrate(
    recording: Detections | str | Path,
    board: None,
    earlier: CameraRig | str | Path,
    *,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    people: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> PeopleCalibration: ...


@overload
def recalibrate(
    recording: Detections | str | Path,
    board: Board | str | Path | None,
    earlier: CameraRig | str | Path,
    *,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
    people: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> BoardCalibration | PeopleCalibration: ...


@checked
def recalibrate(
    recording: Detections | str | Path,
    board: Board | str | Path | None,
    earlier: CameraRig | str | Path,
    *,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
    people: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> BoardCalibration | PeopleCalibration:
    """Calibrate cameras by a board or by people after some of them were moved.

    The lenses are those of the earlier calibration. Cameras that did not move define the world, which is the earlier
    one, and their earlier poses are a prior; the notes name the cameras that moved, and by how much.

    Args:
        recording: with a board: folder with one video, or one folder of pictures, per camera; without one: folder of a
            recording with 2D keypoints of people, or keypoints in memory.
        board: the board, its description such as ``charuco:7x5,square=30mm``, or a file that describes it; None to
            calibrate by people.
        earlier: the earlier calibration, or its file.
        keypoints: file or folder of keypoints of people; by default those in the recording.
        timestamps: file or folder of the times of the images; by default those beside the videos or keypoints.
        options: further options with a board.
        people: further options without a board.
        progress: receives the progress.

    Returns:
        The cameras in the earlier world, unless no two of them kept their relative pose.

    Raises:
        CalibrationError: if the recording does not determine the cameras, or the earlier calibration has none of them.
        FileError: if a file cannot be read.
        OptionsError: if options of the other kind of calibration are given.
        RecordingError: if the folder has no images or keypoints, or several sets of them.
    """
    known = earlier if isinstance(earlier, CameraRig) else read_cameras(earlier)
    if board is None:
        refuse_options("board", options=options)
        if people is not None and (people.stature_m is not None or people.length_m is not None):
            raise OptionsError("The scale is that of the earlier calibration: remove `stature_m` and `length_m`.")
        source = PeopleSource(recording, keypoints, timestamps)
        return _by_people(source, known, people or PeopleOptions(), progress or Silent())
    refuse_options(None, keypoints=keypoints, people=people)
    if isinstance(recording, Detections):
        raise OptionsError("A calibration by a board reads images: `recording` must be their folder.")
    return _by_board(recording, board, known, timestamps, options, progress)


def _by_board(
    images: str | Path,
    board: Board | str | Path,
    known: CameraRig,
    timestamps: str | Path | None,
    options: CalibrateOptions | None,
    progress: Progress | None,
) -> BoardCalibration:
    result = calibrate_by_board(
        images, board, intrinsics=known, timestamps=timestamps, options=options, progress=progress
    )
    compared = compare_with_earlier(result.rig, _renamed(known, [view.name for view in find_images(Path(images))]))
    note = _note(compared.moved, is_any_kept=bool(compared.kept))
    rig = replace(compared.rig, notes=(*result.rig.notes, note))
    return replace(result, rig=rig, notes=(*result.notes, note))


def _by_people(source: PeopleSource, known: CameraRig, options: PeopleOptions, progress: Progress) -> PeopleCalibration:
    matched = match_people(source, known, options, progress)
    names = [view.camera.name for view in matched.views if view.camera.name in known.names]
    if not names:
        raise CalibrationError(
            f"The earlier calibration names none of the cameras {choices([v.camera.name for v in matched.views])}; it "
            f"has {choices(known.names)}."
        )
    group = _group(known.select(names))
    found = estimate_with_known(matched, (group,))
    if found.placement is None:
        world = world_of_people(matched, found.estimate, options)
        return people_result(matched, found.estimate, replace(world, notes=(*world.notes, _NONE_KEPT)))
    world = earlier_world(found, known)
    result = people_result(found.matched, found.estimate, world)
    note = _note(_moved_cameras(result.rig, known, found), is_any_kept=True)
    rig = replace(result.rig, notes=(*result.rig.notes, note))
    return replace(result, rig=rig, notes=(*result.notes, note))


def _group(rig: CameraRig) -> KnownGroup:
    """Return the earlier cameras, with the standard deviations that their poses have at least."""
    turn, share = _LEAST_SD if rig.covariances else _ASSUMED_SD
    group = KnownGroup(rig, (turn, share))
    return replace(group, least_sd=(turn, share * group.reach_m))


def _moved_cameras(rig: CameraRig, earlier: CameraRig, found: KnownEstimate) -> tuple[MovedCamera, ...]:
    amounts = {name: pose_difference(rig[name], earlier[name]) for name in found.moved}
    return tuple(MovedCamera(name, float(np.degrees(turn)), moved_m) for name, (turn, moved_m) in amounts.items())


def _note(moved: tuple[MovedCamera, ...], *, is_any_kept: bool) -> str:
    """Return which cameras moved."""
    if not is_any_kept:
        return _NONE_KEPT
    if not moved:
        return "No camera moved since the earlier calibration."
    return f"Moved since the earlier calibration: {', '.join(map(str, moved))}."


def _renamed(rig: CameraRig, views: list[str]) -> CameraRig:
    """Return the cameras of views, with the names of the views."""
    names = {view: matching_name(view, rig.names) for view in views}
    cameras = tuple(replace(rig[own], name=view) for view, own in names.items() if own is not None)
    covariances = tuple(
        replace(known, camera=view)
        for view, own in names.items()
        if own is not None and (known := rig.covariance(own)) is not None
    )
    return replace(rig, cameras=cameras, covariances=covariances, correlation=None)
