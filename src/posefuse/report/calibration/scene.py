"""Data of the 3D scene of a calibration: cameras with their fields of view, the target, the filmed volume."""

import base64
from typing import Any

import numpy as np

from posefuse.model.calibration_summary import CalibrationSummary, VolumeAccuracy
from posefuse.model.cameras import CameraRig
from posefuse.report.packing import fit_grid, pack_points
from posefuse.report.scene import frusta, side_of

SHOWN_POSES = 300
"""Largest number of poses of the target that are drawn."""
_LABELED_POINTS = 60
"""Largest number of points of known position whose names are drawn."""
_DEPTH_SHARE = 0.45
"""Depth of a field of view, as a share of the distance to the middle of the volume."""
_POSES_PER_SECOND = 6.0


def calibration_scene(summary: CalibrationSummary) -> dict[str, Any]:
    """Return the data of the scene in the form of the report of a result, with the poses of the target as frames."""
    stride = max(1, -(-len(summary.points_m) // SHOWN_POSES))
    shown = summary.points_m[::stride]
    grid = fit_grid(shown)
    middle = summary.volume.middle_m
    depths = [_DEPTH_SHARE * float(np.linalg.norm(camera.center_m - middle)) for camera in summary.rig.cameras]
    n_points = shown.shape[2]
    names = summary.point_names or tuple(f"corner {k + 1}" for k in range(n_points))
    is_target = summary.target != "people"
    return {
        "filmed": summary.target,
        "people": [summary.target] if is_target else [f"person_{p + 1}" for p in range(shown.shape[1])],
        "keypoints": list(names),
        "edges": summary.edges.tolist(),
        "sides": ["target" if is_target else side_of(name) for name in names],
        "frames": summary.frames[::stride].tolist(),
        "time": None,
        "stride": 1,
        "rate": _POSES_PER_SECOND,
        "up": summary.rig.up_axis or "",
        "shownUp": shown_up(summary.rig),
        "unit": "m",
        "origin": list(grid.origin),
        "step": grid.step,
        "cameras": frusta(summary.rig, depths),
        "layers": [{"name": summary.target, "points": [pack_points(p, grid)[0] for p in shown.swapaxes(0, 1)]}],
        "covariances": [],
        "marks": [base64.b64encode(bytes(len(shown) * n_points)).decode()] * shown.shape[1],
        "markedViews": False,
        "labeled": summary.target == "points" and n_points <= _LABELED_POINTS,
        "truth": None,
        "volume": _volume(summary.volume),
    }


def shown_up(rig: CameraRig) -> str:
    """Return the axis of the world that is closest to the upper side of the images."""
    up = -np.sum([camera.rotation[1] for camera in rig.cameras], axis=0)
    axis = int(np.argmax(np.abs(up)))
    return ("" if up[axis] > 0 else "-") + "xyz"[axis]


def sd_range_m(volume: VolumeAccuracy) -> tuple[float, float]:
    """Return the standard deviations that the ends of the color scale stand for."""
    if not len(volume.sd_m):
        return 0.0, 0.0
    low, high = np.quantile(volume.sd_m, (0.02, 0.98))
    return float(low), float(high)


def _volume(volume: VolumeAccuracy) -> dict[str, Any]:
    return {
        "points": volume.points_m.round(4).tolist(),
        "sd": [float(f"{value:.4g}") for value in volume.sd_m],
        "range": [float(f"{value:.4g}") for value in sd_range_m(volume)],
    }
