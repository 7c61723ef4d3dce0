"""MediaPipe's Pose and Holistic, and several people, with the models that its wheel contains."""

# MediaPipe is in the environment of the worker only.
# pyright: reportMissingImports=false
from __future__ import annotations

import os
import sys
import types
from typing import Any

import numpy as np

# Pose detection needs none of these, which MediaPipe imports: 700 MB.
for _name in ("matplotlib", "matplotlib.pyplot", "sounddevice", "jax"):
    sys.modules.setdefault(_name, types.ModuleType(_name))
os.environ.setdefault("GLOG_minloglevel", "2")

PARTS = (("pose_landmarks", 33), ("face_landmarks", 468), ("left_hand_landmarks", 21), ("right_hand_landmarks", 21))


class Detector:
    """Follows people through consecutive images until :meth:`reset`."""

    def __init__(self, settings: dict[str, Any]) -> None:
        import importlib.metadata

        if settings["device"] == "cuda":
            raise ValueError("MediaPipe's wheel runs on the CPU only; use the device cpu")
        self._model = settings["model"]
        self.skeleton = "mediapipe_holistic_543" if self._model == "holistic" else "mediapipe_33"
        self.several_people = self._model == "people"
        self.version = (
            f"mediapipe {importlib.metadata.version('mediapipe')}, {self._model}, model complexity 1, not smoothed"
        )
        self._graph = self._open()

    def _open(self) -> Any:
        # MediaPipe's filter assumes 30 images per second, delays the motion and hides the noise.
        options = {"static_image_mode": False, "model_complexity": 1, "smooth_landmarks": False}
        if self._model == "people":
            from mediapipe_people import People

            return People()
        if self._model == "pose":
            from mediapipe.python.solutions.pose import Pose

            return Pose(**options)
        from mediapipe.python.solutions.holistic import Holistic

        return Holistic(**options)

    def reset(self) -> None:
        """Forget the person of the image before."""
        self._graph.reset()

    def detect(self, images: np.ndarray) -> list[np.ndarray | None]:
        """Return x, y and visibility, shape (person, keypoint, 3), for each image."""
        if self._model == "people":
            return [self._graph.detect_one(image) for image in images]
        return [self._detect_one(image) for image in images]

    def _detect_one(self, image: np.ndarray) -> np.ndarray | None:
        height, width = image.shape[:2]
        found = self._graph.process(image)
        if found.pose_landmarks is None:
            return None
        parts = PARTS[:1] if self._model == "pose" else PARTS
        rows = np.full((1, sum(count for _, count in parts), 3), np.nan)
        start = 0
        for name, count in parts:
            marks = getattr(found, name)
            if marks is not None:
                # Hands and faces have no score of their own: they are reported or not.
                rows[0, start : start + count] = [
                    (
                        mark.x * width - 0.5,
                        mark.y * height - 0.5,
                        mark.visibility if name == "pose_landmarks" else 1.0,
                    )
                    for mark in marks.landmark
                ]
            start += count
        return rows
