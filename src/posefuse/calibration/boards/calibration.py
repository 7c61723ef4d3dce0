"""Calibrate cameras by the corners of a board: lenses, then poses and clocks."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from posefuse.calibration.boards.accuracy import Distances, board_distances
from posefuse.calibration.boards.covariance import joint_covariance
from posefuse.calibration.boards.extrinsics import BoardSolution, solve_extrinsics, timed_poses
from posefuse.calibration.boards.held_out import HeldOutErrors, held_out_errors
from posefuse.calibration.boards.intrinsics import LENSES, Intrinsics, coverage, estimate_intrinsics
from posefuse.calibration.boards.observations import corner_observations
from posefuse.calibration.boards.parameters import OFFSET
from posefuse.calibration.boards.start_times import start_offsets_s
from posefuse.calibration.stated_covariance import largest_sd, with_covariances
from posefuse.errors import CalibrationError, choices
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.detections import Detections
from posefuse.preprocess.timeline import align_views

Clocks = Literal["synchronized", "offset", "independent"]


@dataclass(frozen=True, eq=False)
class CameraReport:
    """How well one camera is calibrated.

    Attributes:
        name: name of the camera.
        n_images: number of images that show the board in the adjustment.
        error_px: root mean square distance between projected and detected corners.
        held_out_px: the same in frames that were held out, see :attr:`BoardCalibration.held_out`.
        covered: shape (rows, columns) of the image grid, bool: cells that contained corners.
        rotation_sd_deg: standard deviation of the rotation relative to the reference camera, in the worst direction.
        center_sd_m: standard deviation of the position, in the worst direction.
        focal_sd_px: standard deviation of the focal length; 0 if it is fixed.
        offset_s: time offset: its images show the board that much later than those of the reference camera.
        offset_sd_s: standard deviation of the time offset; 0 for the reference camera, NaN without times.
        lens_given: whether the lens was given and not estimated.
    """

    name: str
    n_images: int
    error_px: float
    held_out_px: float
    covered: np.ndarray
    rotation_sd_deg: float
    center_sd_m: float
    focal_sd_px: float
    offset_s: float
    offset_sd_s: float
    lens_given: bool


@dataclass(frozen=True, eq=False)
class BoardCalibration:
    """Result of a calibration by a board.

    Attributes:
        rig: the cameras. The world is the reference camera, or the board of one frame.
        board: the board.
        cameras: one report per camera, in the order of the rig.
        joint_covariance: covariance of the 19 parameters of all cameras, by view and parameter twice, see
            :func:`posefuse.calibration.boards.covariance.joint_covariance`.
        distances: accuracy of distances on the board.
        error_px: root mean square distance between projected and detected corners of all views.
        held_out: errors in frames that the cameras were not calibrated with.
        n_corners: number of corners.
        n_frames: number of frames with the board.
        frame_numbers: shape (pose,), int64: number of the frame of each pose of the board.
        shared: shape (view, other): number of frames that two cameras share, for every pair of views.
        solution: cameras in the world of the reference camera, and poses of the board.
        notes: sentences on the images, such as that a video breaks off.
    """

    rig: CameraRig
    board: Board
    cameras: tuple[CameraReport, ...]
    joint_covariance: np.ndarray
    distances: Distances
    error_px: float
    held_out: HeldOutErrors
    n_corners: int
    n_frames: int
    frame_numbers: np.ndarray
    shared: np.ndarray
    solution: BoardSolution
    notes: tuple[str, ...] = ()

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the parameters of each camera, shape (view, 19, 19)."""
        views = np.arange(len(self.cameras))
        return self.joint_covariance[views, :, views]


def calibrate_board(
    detections: Detections,
    board: Board,
    sizes_px: dict[str, tuple[int, int]],
    *,
    intrinsics: dict[str, Camera] | None = None,
    refine_intrinsics: bool = False,
    lens: LensModel | None = None,
    origin_frame: int | None = None,
    clocks: Clocks = "offset",
) -> BoardCalibration:
    """Calibrate cameras by a board that they see together.

    Args:
        detections: corners of the board as keypoints of one subject; those of one frame were seen at the same time.
        board: the board.
        sizes_px: width and height of the images of each view.
        intrinsics: cameras with known lenses, by view; others are estimated.
        refine_intrinsics: whether known lenses are adjusted, too.
        lens: lens model of estimated lenses; None to choose the one that predicts held-out images best.
        origin_frame: number of the frame whose board defines the world, z up for a board that lies on the floor; None
            for the world of the first connected camera.
        clocks: ``synchronized`` for views without time offsets, ``offset`` to estimate small ones if times are known,
            ``independent`` for views that may have started up to some seconds apart.

    Raises:
        CalibrationError: if the images do not determine the cameras; the message states what to film.
    """
    corners = corner_observations(detections, board)
    given = intrinsics or {}
    _require_views(detections, corners.view)
    known = []
    for v, name in enumerate(detections.view_names):
        own = corners.of_view(v)
        if name in given:
            known.append(Intrinsics(given[name], coverage(own, sizes_px[name]), own.n_points, float("nan"), given=True))
        else:
            lenses = LENSES if lens is None else (lens,)
            known.append(estimate_intrinsics(name, sizes_px[name], board, own, lenses))
    starts_s = np.zeros(detections.n_views)
    if clocks == "independent":
        starts_s = start_offsets_s(timed_poses(tuple(each.camera for each in known), board, corners))
        starts_s = starts_s - starts_s[0]
        if starts_s.any():
            detections = align_views(replace(detections, time_s=detections.time_s + starts_s))
            corners = corner_observations(detections, board)
    free = tuple(refine_intrinsics or not each.given for each in known)
    has_rate = bool(np.isfinite(detections.time_s).any()) or detections.rate_hz is not None
    has_rate = has_rate and clocks != "synchronized"
    solution = solve_extrinsics(
        tuple(each.camera for each in known), board, corners, free_lenses=free, has_rate=has_rate
    )
    rig = _world(solution, detections, origin_frame)
    result = _summarize(solution, known, rig, detections.frame_numbers, has_rate=has_rate)
    return _with_starts(result, starts_s) if starts_s.any() else result


def _with_starts(result: BoardCalibration, starts_s: np.ndarray) -> BoardCalibration:
    """Return the calibration with time offsets relative to the given clocks."""
    cameras = tuple(
        replace(report, offset_s=report.offset_s + float(start))
        for report, start in zip(result.cameras, starts_s, strict=True)
    )
    note = "The videos did not start together; they were aligned by the motion of the board."
    return replace(result, cameras=cameras, notes=(*result.notes, note))


def _require_views(detections: Detections, view: np.ndarray) -> None:
    """Raise an error that names cameras that never see the board."""
    blind = [name for v, name in enumerate(detections.view_names) if not np.any(view == v)]
    if len(blind) == detections.n_views:
        raise CalibrationError(
            "No image shows the board. Check its description, and that it is flat, sharp and well lit."
        )
    if len(blind) == detections.n_views - 1:
        name = next(each for each in detections.view_names if each not in blind)
        raise CalibrationError(
            f"Only camera {name!r} shows the board. Film it where at least two cameras see it at the same time, or "
            "check that all videos are of the board."
        )
    if blind:
        raise CalibrationError(
            f"Camera {blind[0]!r} never shows the board. Film the board in front of it, or leave out its video."
        )


def _world(solution: BoardSolution, detections: Detections, origin_frame: int | None) -> CameraRig:
    """Return the cameras in the world of one frame's board, or in that of the reference camera."""
    rig = solution.model.rig
    if origin_frame is None:
        return rig
    numbers = detections.frame_numbers[solution.model.observations.frame]
    at = np.flatnonzero(numbers == origin_frame)
    if not len(at):
        closest = int(numbers[np.argmin(np.abs(numbers - origin_frame))])
        raise CalibrationError(
            f"Frame {origin_frame} does not show the board in a view that was used. The closest frame is {closest}."
        )
    # A board that lies on the floor has its z axis down: the world has x along its columns and z up.
    world_from_board = np.eye(4)
    world_from_board[:3, :3] = solution.model.rotations[at[0]] @ np.diag([1.0, -1.0, -1.0])
    world_from_board[:3, 3] = solution.model.origins_m[at[0]]
    cameras = tuple(replace(c, camera_from_world=c.camera_from_world @ world_from_board) for c in rig.cameras)
    return replace(rig, cameras=cameras, up_axis="z")


def _summarize(
    solution: BoardSolution, known: list[Intrinsics], rig: CameraRig, frame_numbers: np.ndarray, *, has_rate: bool
) -> BoardCalibration:
    """Return the calibration with its accuracy."""
    model, seen = solution.model, solution.model.observations
    errors, covariance = model.errors_px(), joint_covariance(solution)
    held_out = held_out_errors(solution)
    still = [v for v in range(1, len(known)) if not solution.free[v, OFFSET]]
    reports = []
    for v, (camera, each) in enumerate(zip(rig.cameras, known, strict=True)):
        own, block = seen.view == v, covariance[v, :, v]
        reports.append(
            CameraReport(
                name=camera.name,
                n_images=len(np.unique(seen.point[own])),
                error_px=float(np.sqrt(np.mean(errors[own] ** 2))),
                held_out_px=float(held_out.by_view_px[v]),
                covered=each.covered,
                rotation_sd_deg=float(np.degrees(largest_sd(block[:3, :3]))),
                center_sd_m=largest_sd(block[3:6, 3:6]),
                focal_sd_px=float(np.sqrt(block[6, 6])),
                offset_s=float(model.offset_s[v]),
                offset_sd_s=float(np.sqrt(block[18, 18])) if has_rate and v not in still else float("nan"),
                lens_given=each.given,
            )
        )
    return BoardCalibration(
        rig=with_covariances(rig, model.rig, covariance, solution.free),
        board=model.board,
        cameras=tuple(reports),
        joint_covariance=covariance,
        distances=board_distances(solution),
        error_px=float(np.sqrt(np.mean(errors**2))),
        held_out=held_out,
        n_corners=len(errors),
        n_frames=seen.n_points,
        frame_numbers=frame_numbers[seen.frame],
        shared=solution.graph.shared,
        notes=_offset_notes([repr(rig.names[v]) for v in still]) if has_rate else (),
        solution=solution,
    )


def _offset_notes(names: list[str]) -> tuple[str, ...]:
    """Return a note about cameras whose time offsets their images do not show."""
    if not names:
        return ()
    return (
        f"The images of the board by {choices(names)} are too far apart in time to show its motion, so time offsets "
        "of these cameras are not estimated. Examine more images per second.",
    )
