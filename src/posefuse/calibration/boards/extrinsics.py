"""Poses and clocks of cameras from images of a board: a graph of relative poses, then one bundle adjustment."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.adjust import descend, estimate, noise_factors
from posefuse.calibration.boards.choose_frames import choose_poses
from posefuse.calibration.boards.intrinsics import fitted_poses
from posefuse.calibration.boards.model import BoardModel
from posefuse.calibration.boards.observations import CornerObservations
from posefuse.calibration.boards.parameters import N_PARAMETERS, OFFSET, POSE, LensPrior, free_lens
from posefuse.calibration.boards.pose_graph import CameraGraph, ViewPoses, connect
from posefuse.calibration.boards.shaped_model import ShapedModel, with_free_shape
from posefuse.calibration.boards.start_times import TimedPoses
from posefuse.errors import CalibrationError, choices
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig

_MAX_POSES = 400
_START_ERROR = 50.0
_MOTION_ITERATIONS = 40
_MAX_PNP_ERROR_PX = 20.0
_CONVERGED_S = 1e-5


@dataclass(frozen=True, eq=False)
class BoardSolution:
    """Cameras and poses of a board after the bundle adjustment.

    Attributes:
        model: cameras and poses.
        scale: shape (view,): noise factor of each view.
        free: shape (view, 19), bool: free parameters.
        graph: how the cameras are connected.
    """

    model: BoardModel
    scale: np.ndarray
    free: np.ndarray
    graph: CameraGraph


def solve_extrinsics(
    cameras: tuple[Camera, ...],
    board: Board,
    corners: CornerObservations,
    *,
    free_lenses: tuple[bool, ...],
    has_rate: bool,
) -> BoardSolution:
    """Estimate the poses of cameras, and their time offsets if the times of frames are known.

    The world is the first connected camera.

    Args:
        cameras: the cameras; their poses are ignored.
        board: the board.
        corners: its corners.
        free_lenses: whether the lens of each camera is adjusted, too.
        has_rate: whether times are known; otherwise views are assumed to be synchronized.

    Raises:
        CalibrationError: if the cameras are not connected.
    """
    views = [_view_poses(camera, board, corners, v) for v, camera in enumerate(cameras)]
    graph = connect(views)
    _require_connected(graph, [camera.name for camera in cameras])
    rig = CameraRig(tuple(_placed(c, graph.rotations[v], graph.translations_m[v]) for v, c in enumerate(cameras)))
    corners = corners.select_poses(choose_poses(corners, [camera.size_px for camera in cameras], _MAX_POSES))
    rotations, origins, known = _board_poses(rig, views, board, corners)
    corners = corners.select_poses(known)
    priors = tuple(LensPrior.of(camera) for camera in cameras)
    model = BoardModel.at_rest(rig, rotations[known], origins[known], board, corners, priors)
    free = np.zeros((len(cameras), N_PARAMETERS), dtype=bool)
    free[1:, POSE] = True
    model, scale, _ = estimate(model, free, _START_ERROR)
    for v, is_free in enumerate(free_lenses):
        free[v] |= free_lens(cameras[v]) & is_free
    free[1:, OFFSET] = has_rate & _moves(model)[1:]
    shaped, all_free = ShapedModel(model), with_free_shape(free)
    if has_rate:
        shaped, scale = _with_motion(shaped, all_free, scale)
    else:
        shaped, scale, _ = estimate(shaped, all_free, float(np.nanmax(scale)))
    return BoardSolution(shaped.board, scale, free, graph)


def _moves(model: BoardModel) -> np.ndarray:
    """Return which views show the motion of the board, without which a time offset changes nothing."""
    moving = model.moving()
    motion, seen = moving.motion, moving.observations
    moved = np.any((motion.spin != 0.0) | (motion.velocity != 0.0), axis=1)[seen.point]
    return np.bincount(seen.view, weights=moved, minlength=model.n_views) > 0.0


def _with_motion(model: ShapedModel, free: np.ndarray, scale: np.ndarray) -> tuple[ShapedModel, np.ndarray]:
    """Estimate time offsets, too; velocities follow from the poses and are repeated until the offsets converge."""
    damping = 1e-3
    for _ in range(_MOTION_ITERATIONS):
        before = model.board.offset_s
        model = ShapedModel(model.board.moving())
        model, rows, damping = descend(model, free, scale, 1e-3, 1e-4)
        scale = noise_factors(rows, scale, model.observations)
        if np.abs(model.board.offset_s - before).max() < _CONVERGED_S:
            break
    return descend(model, free, scale, damping, 1e-7)[0], scale


def timed_poses(cameras: tuple[Camera, ...], board: Board, corners: CornerObservations) -> list[TimedPoses]:
    """Return the poses of the board in each camera, at the times of its images."""
    views = []
    for v, camera in enumerate(cameras):
        poses = _view_poses(camera, board, corners, v)
        of_view = corners.view == v
        frames, first = np.unique(corners.frame[corners.point[of_view]], return_index=True)
        times = (corners.time_s[corners.point] + corners.delay_s)[of_view][first]
        views.append(TimedPoses(times[np.searchsorted(frames, poses.frames)], poses))
    return views


def _view_poses(camera: Camera, board: Board, corners: CornerObservations, view: int) -> ViewPoses:
    """Return the poses of the board in one camera, without images that its lens does not explain."""
    own = corners.of_view(view)
    model = fitted_poses(camera, board, own) if own.n_points else None
    if model is None:
        return ViewPoses(np.empty(0, dtype=np.int64), np.empty((0, 3, 3)), np.empty((0, 3)))
    errors, seen = model.errors_px(), model.observations
    typical = np.array([np.median(errors[seen.point == k]) for k in range(seen.n_points)])
    good = typical < _MAX_PNP_ERROR_PX
    return ViewPoses(seen.frame[good], model.rotations[good], model.origins_m[good])


def _require_connected(graph: CameraGraph, names: list[str]) -> None:
    """Raise an error that names the groups if the cameras are not connected."""
    if len(graph.groups) == 1:
        return
    if all(len(group) == 1 for group in graph.groups):
        raise CalibrationError(
            "No two cameras see the board in the same frames. Carry the board where at least two cameras see it at "
            "the same time; if the videos start at different times, add their timestamps."
        )
    groups = " and ".join(choices([names[v] for v in group]) for group in graph.groups)
    raise CalibrationError(
        f"The cameras form {len(graph.groups)} groups that never see the board together: {groups}. Film the board "
        "where cameras of both groups see it."
    )


def _placed(camera: Camera, rotation: np.ndarray, translation: np.ndarray) -> Camera:
    """Return a camera at a pose, camera from world."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return replace(camera, camera_from_world=pose)


def _board_poses(
    rig: CameraRig, views: list[ViewPoses], board: Board, corners: CornerObservations
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rotations, origins and whether they are known, of all poses in the world.

    Every view suggests a pose; the one that fits the corners of all views best is taken, because a single view may
    confuse a pose with its mirror image.
    """
    n = corners.n_points
    candidates = []
    frames = corners.frame
    for view, camera in zip(views, rig.cameras, strict=True):
        rotations, origins = np.full((n, 3, 3), np.nan), np.full((n, 3), np.nan)
        at = np.searchsorted(frames, view.frames)
        inside = (at < n) & (frames[np.minimum(at, n - 1)] == view.frames)
        rotations[at[inside]] = camera.rotation.T @ view.rotations[inside]
        shifted = view.translations_m[inside] - camera.translation_m
        origins[at[inside]] = shifted @ camera.rotation
        candidates.append((rotations, origins))
    costs = np.full((len(candidates), n), np.inf)
    for c, (rotations, origins) in enumerate(candidates):
        known = np.isfinite(origins[:, 0])
        if not known.any():
            continue
        subset = corners.select_poses(known)
        model = BoardModel.at_rest(rig, rotations[known], origins[known], board, subset)
        error = np.log1p(model.errors_px())
        costs[c, known] = np.bincount(subset.point, weights=error, minlength=subset.n_points)
    best = np.argmin(costs, axis=0)
    rotations = np.array([candidates[c][0][k] for k, c in enumerate(best)])
    origins = np.array([candidates[c][1][k] for k, c in enumerate(best)])
    return rotations, origins, np.isfinite(costs.min(axis=0))
