"""Summaries of simulated calibrations."""

from dataclasses import replace
from functools import cache

import numpy as np

from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.calibration.boards.summary import summarize_board
from posefuse.calibration.scene.calibration import calibrate_by_scene
from posefuse.calibration.scene.summary import summarize_scene
from posefuse.calibration.scene.view import KnownLens
from posefuse.model.calibration_summary import CalibrationSummary
from posefuse.model.scene_points import ScenePoints
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig, unplaced


@cache
def board_summary() -> CalibrationSummary:
    """Three cameras with known lenses that saw a simulated board."""
    rig = board_rig()
    detections = board_detections(rig)
    return summarize_board(
        calibrate_board(detections, BOARD, dict.fromkeys(rig.names, SIZE_PX), intrinsics=unplaced(rig))
    )


def with_camera(summary: CalibrationSummary, v: int, **changes: object) -> CalibrationSummary:
    """The summary with other values of one camera."""
    cameras = list(summary.cameras)
    cameras[v] = replace(cameras[v], **changes)
    return replace(summary, cameras=tuple(cameras))


def people_summary(*, n_people: int = 2, n_frames: int = 20) -> CalibrationSummary:
    """The same cameras, as if they had been calibrated by people whose keypoints are a chain of four points."""
    base = board_summary()
    rng = np.random.default_rng(3)
    start = rng.normal(0.0, 0.3, (1, n_people, 1, 3))
    steps = np.cumsum(rng.normal(0.0, 0.02, (n_frames, n_people, 1, 3)), axis=0)
    chain = np.linspace(0.0, 0.6, 4)[:, None] * np.array([0.0, 0.0, 1.0])
    points = start + steps + chain
    points[3, 1] = np.nan
    return replace(
        base,
        target="people",
        source="two people",
        frames=np.arange(n_frames),
        points_m=points,
        edges=np.array([[0, 1], [1, 2], [2, 3]]),
        lengths=(),
        scale_sd=0.05,
        left_out=(("cam_9", "it sees nobody whom another camera sees."),),
    )


def scene_summary(*, wrong: int | None = None, views: tuple[int, ...] = (1,), n_points: int = 9) -> CalibrationSummary:
    """Three cameras that were calibrated by points of known position.

    Args:
        wrong: index of a point whose place is 25 px off in some views.
        views: these views.
        n_points: number of points.
    """
    rig, rng = board_rig(), np.random.default_rng(5)
    points_m = np.array([[x, y, z] for x in (-0.4, 0.0, 0.4) for y, z in ((-0.3, 0.2), (0.0, -0.2), (0.3, 0.1))])
    points_m = points_m[:n_points]
    pixels = {c.name: c.project(points_m)[0] + rng.normal(0.0, 0.5, (len(points_m), 2)) for c in rig.cameras}
    for v in () if wrong is None else views:
        pixels[rig.names[v]][wrong] += (15.0, 20.0)
    lenses = tuple(KnownLens(replace(camera, camera_from_world=np.eye(4))) for camera in rig.cameras)
    return summarize_scene(calibrate_by_scene(lenses, ScenePoints(points_m, pixels, "z")))
