"""Visibility: which cameras should see a person, and which of them have a detection."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import Skeleton

_SEEN_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Misses:
    """Counts of missed detections of active people.

    Attributes:
        expected: shape (person, view), int64: frames in which the view should see the person.
        missed: shape (person, view), int64: those without an assigned detection.
    """

    expected: np.ndarray
    missed: np.ndarray

    @property
    def share(self) -> np.ndarray:
        """Shape (person, view): missed over expected; NaN if the view should never see the person."""
        return np.where(self.expected > 0, self.missed / np.maximum(self.expected, 1), np.nan)


def count_misses(parts: Iterable[Reconstruction], layer: LayerName) -> Misses | None:
    """Count missed detections over consecutive ranges of frames; None without tracks.

    Occlusion is unknown here: an occluded person counts as missed.
    """
    expected = missed = None
    for part in parts:
        if part.tracks is None:
            return None
        points = part.layers[layer]
        active = np.asarray(part.tracks.state[:]) == TrackState.ACTIVE
        should = in_image(part.rig, part.skeleton, np.asarray(points.points_m[:])) & active[..., None]
        should &= recorded(points)[:, None]
        lacks = should & (np.asarray(part.tracks.detection[:]) < 0)
        expected = should.sum(axis=0) + (0 if expected is None else expected)
        missed = lacks.sum(axis=0) + (0 if missed is None else missed)
    return None if expected is None or missed is None else Misses(expected, missed)


def in_image(rig: CameraRig, skeleton: Skeleton, points_m: np.ndarray) -> np.ndarray:
    """Shape (frame, person, view), bool: where at least half of a person's core keypoints are inside the image.

    Args:
        rig: cameras.
        skeleton: skeleton; all keypoints count if it has no core.
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
    """
    core = [skeleton.index(name) for name in skeleton.core] or list(range(len(skeleton)))
    pixels = np.moveaxis(rig.project(points_m[:, :, core]), 1, 2)
    size = np.array([camera.size_px for camera in rig.cameras])[:, None]
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= -0.5) & (pixels < size - 0.5)).all(axis=-1)
    return inside.mean(axis=-1) >= _SEEN_SHARE


def recorded(layer: Layer) -> np.ndarray:
    """Shape (frame, view), bool: whether the view recorded the frame, according to the layer."""
    status = np.asarray(layer.view_status[:])
    if not status.shape[1]:
        return np.ones((len(status), status.shape[-1]), dtype=bool)
    return (status != ViewStatus.NOT_RECORDED).any(axis=(1, 2))
