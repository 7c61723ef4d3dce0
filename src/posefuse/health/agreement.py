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
