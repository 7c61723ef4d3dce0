"""Summary of a calibration by people, for its report."""

import numpy as np

from posefuse.calibration.people.result import PeopleCalibration
from posefuse.calibration.volume import volume_accuracy
from posefuse.model.calibration_summary import CalibrationSummary, CameraSummary

_OUTLIER = 6.0
"""Residuals above this multiple of the median of their camera are outliers of the detector, and not shown."""


def summarize_people(result: PeopleCalibration) -> CalibrationSummary:
    """Return what the report of a calibration by people shows."""
    names = result.skeleton.keypoints
    edges = [(names.index(a), names.index(b)) for a, b in result.skeleton.edges]
    n_people = result.points_m.shape[1]
    who = "animals" if not result.skeleton.plausible_m else "people"
    source = f"{n_people} {who}" if n_people != 1 else who.removesuffix("s").replace("people", "one person")
    return CalibrationSummary(
        rig=result.rig,
        target="people",
        source=source if result.board is None else f"{source} and the board {result.board}",
        cameras=tuple(_camera(result, v) for v in range(len(result.rig))),
        shared=_shared(result.keypoints_px),
        frames=np.arange(len(result.time_s)),
        points_m=result.points_m,
        edges=np.array(edges, dtype=np.int64).reshape(-1, 2),
        volume=volume_accuracy(result.rig, result.lens_covariance, result.points_m),
        scale_sd=0.0 if np.isnan(result.scale_sd) else result.scale_sd,
        left_out=tuple(result.left_out.items()),
    )


def _camera(result: PeopleCalibration, v: int) -> CameraSummary:
    report = result.cameras[v]
    pixels = result.keypoints_px[:, v]
    projected = result.rig.cameras[v].project(result.points_m)[0]
    known = np.isfinite(pixels).all(axis=-1) & np.isfinite(projected).all(axis=-1)
    length = np.linalg.norm(projected - pixels, axis=-1)
    known &= length <= _OUTLIER * np.median(length[known]) if known.any() else False
    image = np.broadcast_to(np.arange(len(pixels))[:, None, None], known.shape)
    return CameraSummary(
        pixels=pixels[known],
        residual_px=(projected - pixels)[known],
        image=image[known],
        rotation_sd_deg=report.rotation_sd_deg,
        center_sd_m=report.center_sd_m,
        focal_sd_px=report.focal_sd_px,
        lens_given=report.lens_given,
        offset_s=report.offset_s,
        offset_sd_s=report.offset_sd_s,
    )


def _shared(keypoints_px: np.ndarray) -> np.ndarray:
    """Return the number of moments in which two cameras see a keypoint of the same person, shape (view, view)."""
    seen: np.ndarray = np.asarray(np.isfinite(keypoints_px).all(axis=-1))
    n_views = seen.shape[1]
    out = np.zeros((n_views, n_views), dtype=np.int64)
    for v in range(n_views):
        for u in range(n_views):
            out[v, u] = (seen[:, v] & seen[:, u]).any(axis=(1, 2)).sum()
    return out
