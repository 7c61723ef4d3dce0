"""Calibrate cameras by a board and by people in one estimate.

The board gives the scale, lenses, and the poses of the cameras that see it together; its calibration, with its whole
covariance, is the prior of the estimate from people. People connect cameras that never see the board together, and fill
the volume.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.boards.covariance import lens_covariance
from posefuse.calibration.boards.intrinsics import LENSES, estimate_intrinsics
from posefuse.calibration.boards.observations import corner_observations
from posefuse.calibration.boards.pose_graph import MIN_SHARED
from posefuse.calibration.people.known_cameras import KnownGroup, pose_difference
from posefuse.calibration.people.known_estimate import KnownEstimate, estimate_with_known
from posefuse.calibration.people.result import BoardShare, PeopleCalibration
from posefuse.calibration.stated_covariance import POSE_AND_LENS, with_covariances
from posefuse.errors import CalibrationError, OptionsError
from posefuse.io.calibration.read import read_cameras
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
from posefuse.pipeline.calibrate_board import BoardCorners, calibrate_corners, read_corners, with_notes
from posefuse.pipeline.calibrate_people import PeopleSource, match_people, world_of_people
from posefuse.pipeline.people_result import people_result
from posefuse.pipeline.people_world import PeopleWorld, board_world
from posefuse.progress import Progress

_LEAST_SD = 1e-5, 1e-5
"""Standard deviations that are added to those by the board, in rad and m: without them, some would be 0."""


@dataclass(frozen=True, eq=False)
class _ByBoard:
    """What a board tells.

    Attributes:
        groups: cameras that see the board together, the largest group first, and single ones, with their covariance.
        calibrations: of the groups of several cameras.
    """

    groups: tuple[CameraRig, ...]
    calibrations: tuple[BoardCalibration, ...]


def calibrate_combined(
    images: Path,
    board: Board | str | Path,
    source: PeopleSource,
    *,
    intrinsics: CameraRig | str | Path | None,
    options: CalibrateOptions,
    people: PeopleOptions,
    progress: Progress,
) -> BoardCalibration | PeopleCalibration:
    """Calibrate cameras by a board and by people; by the board alone if it suffices and the people do not.

    Args:
        images: folder with the images of the board.
        board: the board.
        source: 2D keypoints of people.
        intrinsics: cameras with known lenses, or a calibration file.
        options: options of the board.
        people: options of the people.
        progress: receives the progress.

    Raises:
        CalibrationError: if they do not determine the cameras, or contradict each other.
        OptionsError: if the scale is given, which is that of the board.
        PosefuseError: if a file cannot be read.
    """
    if people.stature_m is not None or people.length_m is not None:
        raise OptionsError("The scale is that of the board: remove `stature_m` and `length_m`.")
    known = intrinsics if isinstance(intrinsics, CameraRig) or intrinsics is None else read_cameras(intrinsics)
    corners = read_corners(images, board, known, None, options, progress)
    by_board = _calibrated(corners, options)
    try:
        matched = match_people(source, _lenses(by_board, known), people, progress)
    except CalibrationError as error:
        if len(by_board.groups) > 1:
            raise
        note = f"By the board alone, because the people do not relate the cameras: {error}"
        return with_notes(by_board.calibrations[0], (*corners.notes, note))
    groups = tuple(KnownGroup(rig, _LEAST_SD) for rig in by_board.groups)
    found = estimate_with_known(matched, groups, add_unseen=True)
    if found.placement is None:
        raise CalibrationError(
            "The board and the people agree on the relative pose of no two cameras. Check that both show the same "
            "cameras in the same places, or calibrate by one of them."
        )
    result = people_result(found.matched, found.estimate, _world(found, by_board, options, people))
    shares = _shares(by_board)
    notes = (*corners.notes, *_moved_notes(result.rig, found), *_connected(result.rig, by_board), *result.notes)
    rig = replace(result.rig, notes=(*result.rig.notes[:1], *notes))
    ordered = tuple(shares.get(name) or BoardShare(name) for name in rig.names)
    return replace(result, rig=rig, board=corners.board, board_shares=ordered, notes=notes)


def _calibrated(corners: BoardCorners, options: CalibrateOptions) -> _ByBoard:
    """Return the cameras that see the board: calibrated together where they do so together."""
    rigs: list[CameraRig] = []
    calibrations: list[BoardCalibration] = []
    for names in _groups(corners):
        alone, *others = names
        if others:
            # The chosen frame is one of the largest group, which comes first.
            own = options if not calibrations else replace(options, origin_frame=None)
            calibrations.append(calibrate_corners(corners, names, own))
            rigs.append(calibrations[-1].rig)
        else:
            lens = _lens(corners, alone, options)
            rigs += [] if lens is None else [lens]
    if not calibrations:
        raise CalibrationError(
            "No two cameras see the board in the same frames, so it does not give the scale. Carry the board where at "
            "least two cameras see it at the same time, or calibrate by people alone: remove `board`."
        )
    return _ByBoard(tuple(rigs), tuple(calibrations))


def _groups(corners: BoardCorners) -> list[tuple[str, ...]]:
    """Return the names of cameras that are connected by frames in which they see the board, the largest group first."""
    names = corners.detections.view_names
    seen = corner_observations(corners.detections, corners.board)
    shows = np.zeros((seen.n_points, len(names)), dtype=int)
    shows[seen.point, seen.view] = 1
    linked = shows.T @ shows >= MIN_SHARED
    left = [v for v in range(len(names)) if shows[:, v].any()]
    groups = []
    while left:
        group = {left[0]}
        while more := {v for v in left if v not in group and linked[v, list(group)].any()}:
            group |= more
        groups.append(tuple(names[v] for v in sorted(group)))
        left = [v for v in left if v not in group]
    return sorted(groups, key=lambda group: -len(group))


def _lens(corners: BoardCorners, name: str, options: CalibrateOptions) -> CameraRig | None:
    """Return a camera that alone sees the board with the lens that follows from it; None if it does not."""
    if name in corners.lenses and not options.refine_intrinsics:
        return CameraRig((replace(corners.lenses[name], camera_from_world=np.eye(4)),))
    own = corner_observations(corners.detections.views((name,)), corners.board)
    models = LENSES if options.lens is None else (LensModel(options.lens),)
    try:
        camera = estimate_intrinsics(name, corners.sizes_px[name], corners.board, own, models).camera
    except CalibrationError:
        return None
    covariance = np.zeros((1, POSE_AND_LENS, 1, POSE_AND_LENS))
    covariance[0, 6:, 0, 6:] = lens_covariance(camera, corners.board, own)
    rig = CameraRig((replace(camera, camera_from_world=np.eye(4)),))
    return with_covariances(rig, rig, covariance, np.einsum("vivi->vi", covariance) > 0.0)


def _lenses(by_board: _ByBoard, known: CameraRig | None) -> CameraRig:
    """Return the known lenses, those by the board first."""
    cameras = {camera.name: camera for rig in by_board.groups for camera in rig.cameras}
    for camera in () if known is None else known.cameras:
        cameras.setdefault(camera.name, camera)
    return CameraRig(tuple(cameras.values()))


def _world(found: KnownEstimate, by_board: _ByBoard, options: CalibrateOptions, people: PeopleOptions) -> PeopleWorld:
    """Return the world of the chosen frame of the board, or else that of the people's floor, in the board's scale."""
    if options.origin_frame is None:
        return world_of_people(found.matched, found.estimate, people, known_scale="The scale is that of the board.")
    return board_world(found, by_board.groups[0])


def _shares(by_board: _ByBoard) -> Mapping[str, BoardShare]:
    """Return what the board alone tells about each camera."""
    out = {rig.names[0]: BoardShare(rig.names[0], lens=True) for rig in by_board.groups if len(rig) == 1}
    for each in by_board.calibrations:
        for report in each.cameras:
            sds = report.rotation_sd_deg, report.center_sd_m
            out[report.name] = BoardShare(
                report.name, report.n_images, report.error_px, *sds, each.cameras[0].name, lens=not report.lens_given
            )
    return out


def _moved_notes(rig: CameraRig, found: KnownEstimate) -> Sequence[str]:
    """Return how far cameras were moved between the board and the people."""
    assert found.placement is not None
    now: Mapping[str, Camera] = {camera.name: camera for camera in found.estimate.cameras}
    out = []
    for name in found.moved:
        turn, moved_m = pose_difference(now[name], found.placement.poses[name])
        out.append(
            f"Camera {name!r} was moved between the board and the people (turned by {np.degrees(turn):.2f} degrees, "
            f"moved by {1000 * moved_m:.0f} mm): its pose is that of the people."
        )
    return out


def _connected(rig: CameraRig, by_board: _ByBoard) -> Sequence[str]:
    """Return which cameras only people connect to the first ones."""
    first = by_board.calibrations[0].rig.names if by_board.calibrations else rig.names[:1]
    others = [repr(name) for name in rig.names if name not in first]
    if not others:
        return ()
    return (f"Only people connect {', '.join(others)} to {', '.join(map(repr, first))}.",)
