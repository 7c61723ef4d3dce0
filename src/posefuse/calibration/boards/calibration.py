"""Calibrate cameras by the corners of a board: lenses, then poses and clocks."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.boards.accuracy import Distances, board_distances
from posefuse.calibration.boards.covariance import camera_covariance
from posefuse.calibration.boards.extrinsics import BoardSolution, solve_extrinsics
from posefuse.calibration.boards.intrinsics import LENSES, Intrinsics, coverage, estimate_intrinsics
from posefuse.calibration.boards.observations import corner_observations
from posefuse.errors import CalibrationError
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.detections import Detections


@dataclass(frozen=True, eq=False)
class CameraReport:
    """How well one camera is calibrated.

    Attributes:
        name: name of the camera.
        n_images: number of images that show the board in the adjustment.
        error_px: root mean square distance between projected and detected corners.
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
        covariance: shape (view, 19, 19), see :func:`posefuse.calibration.boards.covariance.camera_covariance`.
        distances: accuracy of distances on the board.
        error_px: root mean square distance between projected and detected corners of all views.
        n_corners: number of corners.
        n_frames: number of frames with the board.
        shared: shape (view, other): number of frames that two cameras share, for every pair of views.
        solution: cameras in the world of the reference camera, and poses of the board.
    """

    rig: CameraRig
    board: Board
    cameras: tuple[CameraReport, ...]
    covariance: np.ndarray
    distances: Distances
    error_px: float
    n_corners: int
    n_frames: int
    shared: np.ndarray
    solution: BoardSolution


def calibrate_board(
    detections: Detections,
    board: Board,
    sizes_px: dict[str, tuple[int, int]],
    *,
    intrinsics: dict[str, Camera] | None = None,
    refine_intrinsics: bool = False,
    lens: LensModel | None = None,
    origin_frame: int | None = None,
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
    free = tuple(refine_intrinsics or not each.given for each in known)
    has_rate = bool(np.isfinite(detections.time_s).any()) or detections.rate_hz is not None
    solution = solve_extrinsics(
        tuple(each.camera for each in known), board, corners, free_lenses=free, has_rate=has_rate
    )
    return _summarize(solution, known, _world(solution, detections, origin_frame), has_rate=has_rate)


def _require_views(detections: Detections, view: np.ndarray) -> None:
    """Raise an error that names cameras that never see the board."""
    blind = [name for v, name in enumerate(detections.view_names) if not np.any(view == v)]
    if len(blind) == detections.n_views:
        raise CalibrationError(
            "No image shows the board. Check its description, and that it is flat, sharp and well lit."
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


def _summarize(solution: BoardSolution, known: list[Intrinsics], rig: CameraRig, *, has_rate: bool) -> BoardCalibration:
    """Return the calibration with its accuracy."""
    model, seen = solution.model, solution.model.observations
    errors, covariance = model.errors_px(), camera_covariance(solution)
    reports = []
    for v, (camera, each) in enumerate(zip(rig.cameras, known, strict=True)):
        own, block = seen.view == v, covariance[v]
        reports.append(
            CameraReport(
                name=camera.name,
                n_images=len(np.unique(seen.point[own])),
                error_px=float(np.sqrt(np.mean(errors[own] ** 2))),
                covered=each.covered,
                rotation_sd_deg=float(np.degrees(np.sqrt(np.linalg.eigvalsh(block[:3, :3])[-1]))),
                center_sd_m=float(np.sqrt(np.linalg.eigvalsh(block[3:6, 3:6])[-1])),
                focal_sd_px=float(np.sqrt(block[6, 6])),
                offset_s=float(model.offset_s[v]),
                offset_sd_s=float(np.sqrt(block[18, 18])) if has_rate else float("nan"),
                lens_given=each.given,
            )
        )
    return BoardCalibration(
        rig=rig,
        board=model.board,
        cameras=tuple(reports),
        covariance=covariance,
        distances=board_distances(solution),
        error_px=float(np.sqrt(np.mean(errors**2))),
        n_corners=len(errors),
        n_frames=seen.n_points,
        shared=solution.graph.shared,
        solution=solution,
    )
