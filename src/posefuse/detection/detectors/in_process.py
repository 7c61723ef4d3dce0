"""A Python callable as a detector, in this process."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from posefuse.detection.detector import FrameDetections, parse_detections
from posefuse.errors import DetectorError, PosefuseError
from posefuse.skeleton.skeletons import Skeleton


class CallableDetector:
    """Calls a function once per image.

    Args:
        function: receives an image of shape (height, width, 3), uint8, RGB, and returns what
            :func:`~posefuse.detection.detector.parse_detections` takes. If it has a method ``reset``, that is called
            before images that do not continue the ones before.
        skeleton: skeleton of the keypoints that it returns.
    """

    version = ""
    batch_size = 1
    several_people = True

    def __init__(self, function: Callable[[np.ndarray], Any], skeleton: Skeleton) -> None:
        self.name = str(getattr(function, "__name__", type(function).__name__))
        self.skeleton = skeleton
        self._function = function

    def reset(self) -> None:
        """Call the function's own ``reset``, if it has one."""
        reset = getattr(self._function, "reset", None)
        if callable(reset):
            reset()

    def detect(self, frames: Sequence[np.ndarray] | np.ndarray) -> list[FrameDetections]:
        """Return the detections of consecutive images.

        Raises:
            DetectorError: if the function raises an exception or returns something else than detections.
        """
        return [self._detect_one(frame) for frame in frames]

    def close(self) -> None:
        """Do nothing; the caller owns the function."""

    def _detect_one(self, frame: np.ndarray) -> FrameDetections:
        try:
            result = self._function(frame)
        except PosefuseError:
            raise
        except Exception as error:
            raise DetectorError(f"The detector {self.name} failed: {type(error).__name__}: {error}.") from error
        return parse_detections(result, len(self.skeleton), f"The detector {self.name}")
