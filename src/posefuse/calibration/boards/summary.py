"""Summary of a calibration by a board, for its report."""

import numpy as np

from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.volume import volume_accuracy
from posefuse.model.calibration_summary import CalibrationSummary, CameraSummary, LengthCheck

_OUTLINE = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])


def summarize_board(result: BoardCalibration) -> CalibrationSummary:
    """Return what the report of a calibration by a board shows."""
    model = result.solution.model
    seen = model.observations
    residuals = model.residuals_px()
    cameras = []
    for v, report in enumerate(result.cameras):
        own = seen.view == v
        cameras.append(
            CameraSummary(
                pixels=seen.pixels[own],
                residual_px=residuals[own],
                image=seen.point[own],
                rotation_sd_deg=report.rotation_sd_deg,
                center_sd_m=report.center_sd_m,
                focal_sd_px=report.focal_sd_px,
                lens_given=report.lens_given,
                offset_s=report.offset_s,
                offset_sd_s=report.offset_sd_s,
                held_out_px=report.held_out_px,
            )
        )
    places = model.corner_places()
    accuracy = volume_accuracy(model.rig, result.joint_covariance, places)
    # The covariance is that of the world of the reference camera; the accuracy of points does not depend on the world.
    world_from_reference = (
        np.linalg.inv(result.rig.cameras[0].camera_from_world) @ model.rig.cameras[0].camera_from_world
    )
    distances = result.distances
    return CalibrationSummary(
        rig=result.rig,
        target="board",
        source=f"the board {result.board}",
        cameras=tuple(cameras),
        shared=result.shared,
        frames=result.frame_numbers,
        points_m=_moved(world_from_reference, _outline(result))[:, None],
        edges=_OUTLINE,
        volume=accuracy.moved(world_from_reference),
        lengths=(LengthCheck("distances on the board", distances.error, distances.spread, distances.n_pairs),),
    )


def _outline(result: BoardCalibration) -> np.ndarray:
    """Return the corners of the printed pattern at all poses, shape (pose, 4, 3), in the world of the solution."""
    model, (width, height) = result.solution.model, result.board.size_m
    # A pattern of inner corners starts one square before its first corner.
    edge = result.board.square_m if result.board.kind == "checkerboard" else 0.0
    flat = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]]) - [edge, edge, 0]
    return flat @ model.rotations.transpose(0, 2, 1) + model.origins_m[:, None]


def _moved(world_from_other: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ world_from_other[:3, :3].T + world_from_other[:3, 3]
