"""What a detector is, and what it returns for one image."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import DetectorError
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True, eq=False)
class FrameDetections:
    """The detections of one image.

    Pixel (0, 0) is the center of the top-left pixel. A keypoint without coordinates is NaN in both.

    Attributes:
        keypoints_px: shape (person, keypoint, 2), float64.
        confidence: shape (person, keypoint), float64: the detector's score; NaN without one.
        boxes_px: shape (person, 4), float64: left, top, right and bottom of each person, or None.

    Raises:
        DetectorError: if the shapes do not match, or a number is infinite.
    """

    keypoints_px: np.ndarray
    confidence: np.ndarray
    boxes_px: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in ("keypoints_px", "confidence", "boxes_px"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name), np.float64))
        n_people, n_keypoints = self.confidence.shape if self.confidence.ndim == 2 else (-1, -1)
        expected = {"keypoints_px": (n_people, n_keypoints, 2), "boxes_px": (n_people, 4)}
        for name, shape in expected.items():
            array = getattr(self, name)
            if array is not None and array.shape != shape:
                raise DetectorError(
                    f"{name} of an image has the shape {array.shape}, and confidence {self.confidence.shape}. "
                    f"Expected (person, keypoint, 2), (person, keypoint) and, for boxes_px, (person, 4)."
                )
        for name in ("keypoints_px", "confidence", "boxes_px"):
            array = getattr(self, name)
            if array is not None and np.isinf(array).any():
                raise DetectorError(f"{name} of an image contains an infinite number. Use NaN for missing values.")

    def __len__(self) -> int:
        return len(self.confidence)


@runtime_checkable
class Detector(Protocol):
    """A detector that is ready to use.

    Attributes:
        name: name such as ``mediapipe``.
        version: what its results depend on, in one line: package, version, model and digest of the weights.
        skeleton: skeleton of the keypoint axis.
        batch_size: the number of images per call with which it is fastest.
        several_people: whether it detects more than one person per image.
    """

    name: str
    version: str
    skeleton: Skeleton
    batch_size: int
    several_people: bool

    def reset(self) -> None:
        """Forget all earlier images; the results of the next ones depend on them alone."""
        ...

    def detect(self, frames: Sequence[np.ndarray] | np.ndarray) -> list[FrameDetections]:
        """Return the detections of consecutive images of one view.

        Args:
            frames: images, each of shape (height, width, 3), uint8, RGB.

        Raises:
            DetectorError: if the detector fails.
        """
        ...

    def close(self) -> None:
        """Release memory and processes."""
        ...


def parse_detections(result: Any, n_keypoints: int, source: str) -> FrameDetections:
    """Return what a detector reported for one image.

    Args:
        result: array of x, y and confidence, shape (person, keypoint, 3) or, for one person, (keypoint, 3); or a tuple
            of such an array and boxes, shape (person, 4). None stands for an image without people. A keypoint with a
            coordinate that is NaN is missing, a person without any keypoint is left out.
        n_keypoints: number of keypoints of the skeleton.
        source: the detector, for messages.

    Raises:
        DetectorError: if the result has another form.
    """
    rows, boxes = result if isinstance(result, tuple) and len(result) == 2 else (result, None)
    if rows is None or (isinstance(rows, list | tuple) and not rows):
        rows = np.empty((0, n_keypoints, 3))
    try:
        array = np.array(rows, dtype=np.float64)
        boxes = None if boxes is None else np.array(boxes, dtype=np.float64).reshape(-1, 4)
    except (TypeError, ValueError):
        raise DetectorError(_wrong_result(source, n_keypoints, f"a {type(rows).__name__}")) from None
    array = array[None] if array.ndim == 2 else array
    if array.ndim != 3 or array.shape[1:] != (n_keypoints, 3) or (boxes is not None and len(boxes) != len(array)):
        got = f"an array of shape {array.shape}" + ("" if boxes is None else f" with {len(boxes)} boxes")
        raise DetectorError(_wrong_result(source, n_keypoints, got))
    if np.isinf(array).any() or (boxes is not None and np.isinf(boxes).any()):
        raise DetectorError(f"{source} returned an infinite number. It must return NaN for missing values.")
    array[np.isnan(array[..., :2]).any(axis=2)] = np.nan
    found = np.isfinite(array[..., 0]).any(axis=1)
    return FrameDetections(array[found, :, :2], array[found, :, 2], None if boxes is None else boxes[found])


def _wrong_result(source: str, n_keypoints: int, got: str) -> str:
    return (
        f"{source} returned {got} for an image. Expected x, y and confidence, shape (person, {n_keypoints}, 3), "
        "or a tuple of this array and boxes, shape (person, 4)."
    )
