"""Check that calibration and keypoints belong together."""

from collections.abc import Sequence

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus

DISAGREEMENT = "The views do not agree: "
"""Beginning of the sentence on all views."""

# Detectors err by 0.5 % of the image's longer side, and by 1 % with a poor calibration.
_MAX_NOISE_SHARE = 0.015
_MAX_REJECTED_SHARE = 0.4
_SAME_POSITION = 1e-3
_MAX_CAMERA_REJECTED_SHARE = 0.6
_MIN_CAMERA_DETECTIONS = 100


def agreement_finding(layers: Sequence[Layer], rig: CameraRig, noise: NoiseModel) -> str | None:
    """Return a sentence if views disagree more than outliers explain, else None.

    Args:
        layers: sample of the recording, with outliers rejected.
        rig: the cameras.
        noise: estimated error model of the detections.
    """
    view_status = np.concatenate([np.asarray(layer.view_status).ravel() for layer in layers])
    status = np.concatenate([np.asarray(layer.status).ravel() for layer in layers])
    seen = np.isin(status, (PointStatus.NOT_SEEN, PointStatus.TOO_FEW_VIEWS, PointStatus.ABSENT), invert=True)
    used = int((view_status == ViewStatus.USED).sum())
    rejected = int(np.isin(view_status, (ViewStatus.OUTLIER, ViewStatus.NOT_USED)).sum())
    if not seen.any() or used + rejected == 0:
        return None
    share = rejected / (used + rejected)
    error_px = noise.scale_px * noise.spread
    longer_sides_px = np.array([max(camera.size_px) for camera in rig.cameras])
    noisy = noise.origin == "estimated" and bool(np.median(error_px / longer_sides_px) > _MAX_NOISE_SHARE)
    if not noisy and share < _MAX_REJECTED_SHARE:
        return None
    symptom = (
        f"the typical reprojection error is {float(np.median(error_px)):.0f} px"
        if noisy
        else f"{100 * share:.0f} % of the detections contradict the other views"
    )
    return (
        f"{DISAGREEMENT}{symptom}. Either views are assigned to the wrong cameras (see the matching above, "
        "`camera_order`), or a camera was moved after the calibration, or the calibration belongs to another recording."
    )


def camera_finding(layers: Sequence[Layer], rig: CameraRig, noise: NoiseModel) -> str | None:
    """Return a sentence if most detections of single cameras contradict the others, else None.

    Args:
        layers: sample of the recording, with outliers rejected.
        rig: the cameras.
        noise: estimated error model of the detections.
    """
    view_status = np.concatenate([np.asarray(layer.view_status).reshape(-1, len(rig)) for layer in layers])
    rejected = (view_status == ViewStatus.OUTLIER).sum(axis=0)
    seen = rejected + (view_status == ViewStatus.USED).sum(axis=0)
    share = rejected / np.maximum(seen, 1)
    wrong = np.flatnonzero((share > _MAX_CAMERA_REJECTED_SHARE) & (seen >= _MIN_CAMERA_DETECTIONS))
    # Two cameras that contradict each other do not show which of them is wrong.
    if not len(wrong) or len(rig) - len(wrong) < 2 or np.median(share) > 0.5 * _MAX_CAMERA_REJECTED_SHARE:
        return None
    shares = ", ".join(f"{rig.names[v]!r} ({100 * share[v]:.0f} %)" for v in wrong)
    several = len(wrong) > 1
    consequence = " Its detections are not used." if not several else " Their detections are not used."
    return (
        f"Most detections of camera{'s' * several} {shares} contradict the other cameras. "
        f"{'Their' if several else 'Its'} calibration is wrong or belongs to another camera, the camera was moved, or "
        f"it shows another scene.{'' if noise.is_used[wrong].any() else consequence} Use `exclude_camera` to exclude a "
        "camera."
    )


def coincidence_finding(rig: CameraRig) -> str | None:
    """Return a sentence if two cameras have the same position, else None."""
    centers = np.array([camera.center_m for camera in rig.cameras])
    distances = np.linalg.norm(centers[:, None] - centers[None], axis=-1)
    np.fill_diagonal(distances, np.inf)
    extent = np.max(np.where(np.isfinite(distances), distances, 0.0), initial=0.0)
    if len(rig) < 2 or distances.min() > _SAME_POSITION * extent:
        return None
    a, b = np.unravel_index(int(distances.argmin()), distances.shape)
    return (
        f"Cameras {rig.names[a]!r} and {rig.names[b]!r} have the same position; one calibration is probably a copy of "
        "the other. Use `exclude_camera` to exclude one of them."
    )
