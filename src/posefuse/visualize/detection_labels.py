"""Labels of detections for drawing: used, swapped, rejected, not used or unassigned."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus


class DetectionLabel(IntEnum):
    """How a detected keypoint was used."""

    UNASSIGNED = 0
    """The detection is not assigned to any person."""
    USED = 1
    SWAPPED = 2
    """Used after correction of a left/right swap."""
    REJECTED = 3
    """Inconsistent with the other views."""
    NOT_USED = 4
    """Confidence too low, outside the valid region of the lens model, or the point was not triangulated."""


_LABELS = {
    ViewStatus.USED: DetectionLabel.USED,
    ViewStatus.USED_SWAPPED: DetectionLabel.SWAPPED,
    ViewStatus.OUTLIER: DetectionLabel.REJECTED,
    ViewStatus.BEHIND_CAMERA: DetectionLabel.REJECTED,
}


@dataclass(frozen=True, eq=False)
class LabeledDetections:
    """The detected keypoints of one view in one frame.

    Attributes:
        pixels: shape (point, 2).
        label: shape (point,), int8: :class:`DetectionLabel`.
        person: shape (point,), int64: index of the person, -1 for unassigned detections.
        keypoint: shape (point,), int64: index of the detected keypoint.
    """

    pixels: np.ndarray
    label: np.ndarray
    person: np.ndarray
    keypoint: np.ndarray


def label_detections(
    part: Reconstruction, frame: int, view: int, view_status: np.ndarray, detections: Detections, detections_frame: int
) -> LabeledDetections:
    """Return the detected keypoints of one view in one frame with their labels.

    Args:
        part: a range of frames of the result.
        frame: index of the frame in ``part``.
        view: index of the camera.
        view_status: shape (person, keypoint), of that frame and view.
        detections: detections of the same skeleton, with views in the order of the cameras.
        detections_frame: index of the frame in ``detections``.
    """
    cell = detections_frame * detections.n_views + view
    first, last = int(detections.offsets[cell]), int(detections.offsets[cell + 1])
    pixels = np.asarray(detections.keypoints_px[first:last])
    label = np.full(pixels.shape[:2], DetectionLabel.UNASSIGNED, dtype=np.int8)
    person = np.full(pixels.shape[:2], -1)
    assigned = np.full(0, -1) if part.tracks is None else np.asarray(part.tracks.detection)[frame, :, view]
    for p, row in enumerate(assigned.tolist()):
        if 0 <= row < len(pixels):
            label[row], person[row] = _label_keypoints(view_status[p], part.skeleton.mirror), p
    detected = np.isfinite(pixels).all(axis=-1)
    keypoint = np.broadcast_to(np.arange(pixels.shape[1]), detected.shape)
    return LabeledDetections(pixels[detected], label[detected], person[detected], keypoint[detected])


def _label_keypoints(status: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Return the label of each detected keypoint of a person.

    A detection used for the other side has its status at the keypoint of the other side.
    """
    labels = np.full(len(status), DetectionLabel.NOT_USED, dtype=np.int8)
    for code, label in _LABELS.items():
        labels[(status[mirror] if code is ViewStatus.USED_SWAPPED else status) == code] = label
    return labels
