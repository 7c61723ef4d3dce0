"""Summary of a calibration by points of known position, for its report."""

import numpy as np

from posefuse.calibration.scene.calibration import SceneCalibration
from posefuse.calibration.volume import volume_accuracy
from posefuse.model.calibration_summary import CalibrationSummary, CameraSummary, KnownPoints


def summarize_scene(result: SceneCalibration) -> CalibrationSummary:
    """Return what the report of a calibration by points of known position shows."""
    points = result.points_m
    projected = np.moveaxis(result.rig.project(points), 0, 1)
    residual = projected - result.places_px
    shown: np.ndarray = np.asarray(np.isfinite(result.places_px).all(axis=2))
    return CalibrationSummary(
        rig=result.rig,
        target="points",
        source=f"{len(points)} points of known position",
        cameras=tuple(_camera(result, v, residual[v], shown[v]) for v in range(len(result.rig))),
        shared=shown.astype(np.int64) @ shown.T,
        frames=np.zeros(1, dtype=np.int64),
        points_m=points[None, None],
        edges=np.zeros((0, 2), dtype=np.int64),
        volume=volume_accuracy(result.rig, result.joint_covariance, points),
        point_names=tuple(f"point {k + 1}" for k in range(len(points))),
        known_points=KnownPoints(
            points, np.linalg.norm(residual, axis=2), result.held_out.error_px, result.held_out.sds
        ),
        left_out=tuple((name, f"it {reason}.") for name, reason in result.left_out),
    )


def _camera(result: SceneCalibration, v: int, residual: np.ndarray, shown: np.ndarray) -> CameraSummary:
    report, predicted = result.cameras[v], result.held_out.error_px[v]
    known = np.isfinite(predicted)
    return CameraSummary(
        pixels=result.places_px[v, shown],
        residual_px=residual[shown],
        image=np.zeros(int(shown.sum()), dtype=np.int64),
        rotation_sd_deg=report.rotation_sd_deg,
        center_sd_m=report.center_sd_m,
        focal_sd_px=float(np.sqrt(result.joint_covariance[v, 6, v, 6])),
        lens_given=report.lens_given,
        held_out_px=float(np.sqrt(np.mean(predicted[known] ** 2))) if known.any() else float("nan"),
    )
