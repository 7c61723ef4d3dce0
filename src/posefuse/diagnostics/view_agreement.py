"""Do the views agree at all? If not, calibration and keypoints do not belong together."""

from collections.abc import Sequence

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus

# Detectors err by half a per cent of the image's longer side, with poor calibrations a per cent; this is beyond.
_NOISE_SHARE = 0.015
_REJECTED_SHARE = 0.4
_SAME_PLACE = 1e-3
_CAMERA_SHARE = 0.6
_CAMERA_DETECTIONS = 100


def agreement_finding(layers: Sequence[Layer], rig: CameraRig, noise: NoiseModel) -> str | None:
    """A sentence if views disagree more than wrong detections explain, else None.

    Args:
        layers: a sample of the recording, wrong views rejected.
        rig: the cameras.
        noise: of the detections, as the views agree.
    """
    said = np.concatenate([np.asarray(layer.view_status).ravel() for layer in layers])
    status = np.concatenate([np.asarray(layer.status).ravel() for layer in layers])
    seen = np.isin(status, (PointStatus.NOT_SEEN, PointStatus.TOO_FEW_VIEWS, PointStatus.ABSENT), invert=True)
    used = int((said == ViewStatus.USED).sum())
    rejected = int(np.isin(said, (ViewStatus.OUTLIER, ViewStatus.NOT_USED)).sum())
    if not seen.any() or used + rejected == 0:
        return None
    share = rejected / (used + rejected)
    error_px = noise.scale_px * noise.spread
    sides = np.array([max(camera.size_px) for camera in rig.cameras])
    noisy = noise.origin == "estimated" and bool(np.median(error_px / sides) > _NOISE_SHARE)
    if not noisy and share < _REJECTED_SHARE:
        return None
    what = (
        f"detections lie {float(np.median(error_px)):.0f} px from where their points project"
        if noisy
        else f"{100 * share:.0f} % of the detections contradict the other views"
    )
    return (
        f"The views do not agree: {what}. Either views have been given other cameras' calibrations (see the matching "
        "above, --camera-order), or a camera has moved since, or the calibration is of another recording."
    )


def camera_finding(layers: Sequence[Layer], rig: CameraRig) -> str | None:
    """A sentence if most of what single cameras see contradicts the others, else None.

    Args:
        layers: a sample of the recording, wrong views rejected.
        rig: the cameras.
    """
    said = np.concatenate([np.asarray(layer.view_status).reshape(-1, len(rig)) for layer in layers])
    rejected = (said == ViewStatus.OUTLIER).sum(axis=0)
    seen = rejected + (said == ViewStatus.USED).sum(axis=0)
    share = rejected / np.maximum(seen, 1)
    wrong = np.flatnonzero((share > _CAMERA_SHARE) & (seen >= _CAMERA_DETECTIONS))
    # Where two cameras contradict each other there is no telling which of them is wrong.
    if not len(wrong) or len(rig) - len(wrong) < 2 or np.median(share) > 0.5 * _CAMERA_SHARE:
        return None
    worst = ", ".join(f"{rig.names[v]!r} ({100 * share[v]:.0f} %)" for v in wrong)
    many = len(wrong) > 1
    return (
        f"Most of what camera{'s' * many} {worst} see{'' if many else 's'} contradicts the other cameras. "
        f"{'Their' if many else 'Its'} calibration is wrong, or of another camera, or the camera has moved, or shows "
        "something else. --exclude-camera leaves a camera out."
    )


def coincidence_finding(rig: CameraRig) -> str | None:
    """A sentence if two cameras stand in one place, else None."""
    centres = np.array([camera.centre_m for camera in rig.cameras])
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    spread = np.max(np.where(np.isfinite(apart), apart, 0.0), initial=0.0)
    if len(rig) < 2 or apart.min() > _SAME_PLACE * spread:
        return None
    a, b = np.unravel_index(int(apart.argmin()), apart.shape)
    return (
        f"Cameras {rig.names[a]!r} and {rig.names[b]!r} stand in the same place; one of their calibrations is probably "
        "a copy of the other's. --exclude-camera leaves one out."
    )
