"""What became of each detection, in the words that a picture can show."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus


class Fate(IntEnum):
    """What became of a detected keypoint."""

    NOBODY = 0
    """The detection belongs to none of the people."""
    USED = 1
    SWAPPED = 2
    """Used for the other side: the detector took left for right."""
    REJECTED = 3
    """It contradicts the other views."""
    NOT_USED = 4
    """Too low a confidence, beyond what the lens can show, or its point was not solved."""


_FATES = {
    ViewStatus.USED: Fate.USED,
    ViewStatus.USED_SWAPPED: Fate.SWAPPED,
    ViewStatus.OUTLIER: Fate.REJECTED,
    ViewStatus.BEHIND_CAMERA: Fate.REJECTED,
}


@dataclass(frozen=True, eq=False)
class Sightings:
    """The detected keypoints of one view in one frame.

    Attributes:
        pixels: shape (point, 2).
        fate: shape (point,), int8: :class:`Fate`.
        person: shape (point,), int64: place of whose it is, -1 for nobody.
        keypoint: shape (point,), int64: what the detector takes it for.
    """

    pixels: np.ndarray
    fate: np.ndarray
    person: np.ndarray
    keypoint: np.ndarray


def sightings(
    part: Reconstruction, frame: int, view: int, view_status: np.ndarray, detections: Detections, place: int
) -> Sightings:
    """What a view shows in a frame, and what became of it.

    Args:
        part: a range of frames of the result.
        frame: place in it.
        view: place of the camera.
        view_status: shape (person, keypoint), of that frame and view.
        detections: of the same skeleton, views in the order of the cameras.
        place: of the frame in the detections.
    """
    cell = place * detections.n_views + view
    first, last = int(detections.offsets[cell]), int(detections.offsets[cell + 1])
    pixels = np.asarray(detections.keypoints_px[first:last])
    fate = np.full(pixels.shape[:2], Fate.NOBODY, dtype=np.int8)
    person = np.full(pixels.shape[:2], -1)
    whose = np.full(0, -1) if part.tracks is None else np.asarray(part.tracks.detection)[frame, :, view]
    for p, row in enumerate(whose.tolist()):
        if 0 <= row < len(pixels):
            fate[row], person[row] = _fates(view_status[p], part.skeleton.mirror), p
    seen = np.isfinite(pixels).all(axis=-1)
    keypoint = np.broadcast_to(np.arange(pixels.shape[1]), seen.shape)
    return Sightings(pixels[seen], fate[seen], person[seen], keypoint[seen])


def _fates(status: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Of each detected keypoint of a person; what was used for the other side stands in the other side's status."""
    found = np.full(len(status), Fate.NOT_USED, dtype=np.int8)
    for code, fate in _FATES.items():
        found[(status[mirror] if code is ViewStatus.USED_SWAPPED else status) == code] = fate
    return found
