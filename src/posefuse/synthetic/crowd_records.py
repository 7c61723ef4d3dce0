"""Records of simulated crowds: staged events, and detections with their true assignment."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.synthetic.bodies import Capsules


class Kind(IntEnum):
    """What a detection shows."""

    PERSON = 0
    """One person."""
    MERGED = 1
    """Two people: each keypoint is that of one of them."""
    DUPLICATE = 2
    """A second detection of a person."""
    FALSE = 3
    """No person."""


@dataclass(frozen=True)
class Staging:
    """Staged events of a scene.

    Attributes:
        things: objects that occlude people.
        dark: shape (frame, view), bool: where a camera shows nothing.
        turned: shape (frame, view), bool: where a camera has the pose of ``turned_rig``.
        turned_rig: cameras after a bump; otherwise those of the rig.
        merged: shape (frame,), bool: when the first two people give one detection in every view.
        spared_view: view that never merges people at random, -1 for none.
    """

    things: Capsules
    dark: np.ndarray
    turned: np.ndarray
    turned_rig: CameraRig
    merged: np.ndarray
    spared_view: int = -1

    @classmethod
    def plain(cls, rig: CameraRig, n_frames: int) -> "Staging":
        """Return no events."""
        nowhere = np.zeros((n_frames, len(rig)), dtype=bool)
        return cls(Capsules.none(n_frames), nowhere, nowhere, rig, np.zeros(n_frames, dtype=bool))


@dataclass(frozen=True)
class CrowdDetections:
    """Detections with their true assignment.

    Attributes:
        detections: detections of all views, in the detector's order.
        owner: shape (row,), int64: person of each detection, -1 for a false one; of a merged one, the person with more
            keypoints.
        other: shape (row,), int64: second person of a merged detection, otherwise -1.
        kind: shape (row,), int64: :class:`Kind`.
    """

    detections: Detections
    owner: np.ndarray
    other: np.ndarray
    kind: np.ndarray


@dataclass
class DetectionSlots:
    """Detections before they are sorted into rows: (frame, view, slot), NaN for an empty slot."""

    pixels: np.ndarray
    confidence: np.ndarray
    owner: np.ndarray
    other: np.ndarray
    kind: np.ndarray
    ids: np.ndarray

    @classmethod
    def of(cls, pixels: np.ndarray, confidence: np.ndarray, owner: np.ndarray | int, kind: Kind) -> "DetectionSlots":
        """Build slots with one owner and kind."""
        shape = pixels.shape[:3]
        return cls(
            pixels,
            confidence,
            np.broadcast_to(owner, shape).copy(),
            np.full(shape, -1),
            np.full(shape, int(kind)),
            np.full(shape, -1),
        )

    @property
    def there(self) -> np.ndarray:
        """Shape (frame, view, slot), bool: whether the slot has a detection."""
        return np.asarray(np.isfinite(self.pixels[..., 0]).any(axis=-1))

    def drop(self, where: np.ndarray) -> None:
        """Remove detections."""
        self.pixels[where] = np.nan
        self.confidence[where] = np.nan
