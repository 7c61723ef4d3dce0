"""Several people with the models of MediaPipe's wheel, in square parts of the image that overlap by half.

MediaPipe finds people in a picture of 224 pixels, so that small ones are missed. Therefore every tenth image is also
searched in squares of half the size, and a person whom only these show is followed in a square of its own.
"""

# MediaPipe is in the environment of the worker only.
# pyright: reportMissingImports=false
from __future__ import annotations

import os
import tempfile
from typing import Any

import numpy as np

MOST_PEOPLE = 5
"""The most people in each part of an image."""
SEARCH_INTERVAL = 10
"""Number of images after which small people are searched."""
SQUARE = 1.6
"""Side of the square in which a small person is followed, in sides of the person's box."""
MOST_CUT = 0.1
"""A person of whom a larger share of the keypoints is beyond the part, but in the image, is left out."""
MOST_SHARED = 0.6
"""Of two people whose boxes share more of the smaller one, the larger one is kept: one person seen in two parts, or the
legs of a person taken for another one."""


class People:
    """Detects people in all parts of an image, and keeps the best detection of each."""

    def __init__(self) -> None:
        self._bundle = model_bundle()
        self._single = self._landmarker("IMAGE")
        self.reset()

    def reset(self) -> None:
        """Forget the people of earlier images."""
        self._number = 0
        self._size = (0, 0)
        self._parts: list[tuple[int, int, int, int]] = []
        self._landmarkers: list[Any] = []
        self._people: list[np.ndarray] = []

    def detect_one(self, image: np.ndarray) -> np.ndarray:
        """Return x, y and visibility, shape (person, 33, 3)."""
        if image.shape[:2] != self._size:
            self._open(image.shape[:2])
        found = []
        for part, landmarker in zip(self._parts, self._landmarkers):  # noqa: B905
            found += self._detect_in(image, part, landmarker)
        seen = list(found)
        for person in self._people:
            if all(shared_area(person, each) < MOST_SHARED for each in seen):
                found += self._detect_in(image, square_around(person, *self._size))
        if self._number % SEARCH_INTERVAL == 0:
            for part in small_parts_of(*self._size):
                found += self._detect_in(image, part)
        self._number += 1
        self._people = different_people(found, [score_of(person) for person in found])
        return np.array(self._people).reshape(-1, 33, 3)

    def _detect_in(
        self, image: np.ndarray, part: tuple[int, int, int, int], landmarker: Any = None
    ) -> list[np.ndarray]:
        """Return the people in a part of the image: with a landmarker of the part, which follows them, or without."""
        import mediapipe

        left, top, width, height = part
        pixels = np.ascontiguousarray(image[top : top + height, left : left + width])
        given = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=pixels)
        if landmarker is None:
            marked = self._single.detect(given)
        else:
            marked = landmarker.detect_for_video(given, 33 * self._number)
        people = []
        for marks in marked.pose_landmarks:
            rows = np.array([(mark.x, mark.y, mark.visibility) for mark in marks])
            people.append(rows * (width, height, 1.0) + (left - 0.5, top - 0.5, 0.0))
        return [person for person in people if share_cut(person, part, image.shape) < MOST_CUT]

    def _open(self, size: tuple[int, int]) -> None:
        """Open one landmarker for each part: each follows the people of its part."""
        self.reset()
        self._size, self._parts = size, parts_of(*size)
        self._landmarkers = [self._landmarker("VIDEO") for _ in self._parts]

    def _landmarker(self, mode: str) -> Any:
        from mediapipe.tasks.python.core.base_options import BaseOptions
        from mediapipe.tasks.python.vision import pose_landmarker
        from mediapipe.tasks.python.vision.core.vision_task_running_mode import VisionTaskRunningMode

        options = pose_landmarker.PoseLandmarkerOptions(
            base_options=BaseOptions(model_asset_buffer=self._bundle),
            running_mode=VisionTaskRunningMode[mode],
            num_poses=MOST_PEOPLE,
        )
        return pose_landmarker.PoseLandmarker.create_from_options(options)


def parts_of(height: int, width: int) -> list[tuple[int, int, int, int]]:
    """Return left, top, width and height of the parts: the whole image, and squares if it is not nearly square."""
    side = min(height, width)
    if max(height, width) <= 1.05 * side:
        return [(0, 0, width, height)]
    count = int(np.ceil((max(height, width) - side) / (0.5 * side))) + 1
    starts = [round(start) for start in np.linspace(0, max(height, width) - side, count)]
    squares = [(start, 0, side, side) if width > height else (0, start, side, side) for start in starts]
    return [(0, 0, width, height), *squares]


def small_parts_of(height: int, width: int) -> list[tuple[int, int, int, int]]:
    """Return left, top, width and height of squares of half the shorter side of the image, which overlap by half."""
    side = min(height, width) // 2
    tops, lefts = (
        [round(start) for start in np.linspace(0, size - side, int(np.ceil((size - side) / (0.5 * side))) + 1)]
        for size in (height, width)
    )
    return [(left, top, side, side) for top in tops for left in lefts]


def square_around(person: np.ndarray, height: int, width: int) -> tuple[int, int, int, int]:
    """Return left, top, width and height of a square around a person, moved into the image."""
    low, high = person[:, :2].min(axis=0), person[:, :2].max(axis=0)
    side = min(max(round(SQUARE * float((high - low).max())), 1), height, width)
    left, top = (round(float(center) - 0.5 * side) for center in 0.5 * (low + high))
    return min(max(left, 0), width - side), min(max(top, 0), height - side), side, side


def score_of(person: np.ndarray) -> float:
    """Return the mean visibility of a person, times its height: of two detections, the higher one is kept."""
    return float(person[:, 2].mean() * np.ptp(person[:, 1]))


def share_cut(person: np.ndarray, part: tuple[int, int, int, int], shape: tuple[int, ...]) -> float:
    """Return the share of keypoints in the image and beyond the part: another part shows the person better."""
    left, top, width, height = part
    x, y = person[:, 0], person[:, 1]
    in_image = (x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])
    in_part = (x >= left) & (x < left + width) & (y >= top) & (y < top + height)
    return float((in_image & ~in_part).mean())


def different_people(people: list[np.ndarray], scores: list[float]) -> list[np.ndarray]:
    """Return people, best first, without those that are detections of a better one."""
    kept: list[np.ndarray] = []
    for i in np.argsort(-np.array(scores), kind="stable").tolist():
        if all(shared_area(people[i], other) < MOST_SHARED for other in kept):
            kept.append(people[i])
    return kept


def shared_area(one: np.ndarray, other: np.ndarray) -> float:
    """Return the area that the boxes of two people share, relative to the smaller one."""
    boxes = [(rows[:, :2].min(axis=0), rows[:, :2].max(axis=0)) for rows in (one, other)]
    inside = np.minimum(boxes[0][1], boxes[1][1]) - np.maximum(boxes[0][0], boxes[1][0])
    smaller = min(float(np.prod(high - low)) for low, high in boxes)
    return float(np.prod(np.maximum(inside, 0.0))) / max(smaller, 1e-9)


def model_bundle() -> bytes:
    """Return the models of the wheel in the form that MediaPipe's landmarker of several people takes."""
    import mediapipe
    from mediapipe.tasks.python.metadata.metadata_writers import metadata_writer, model_asset_bundle_utils

    models = {
        "pose_detector.tflite": ("pose_detection/pose_detection.tflite", 127.5, 127.5),
        "pose_landmarks_detector.tflite": ("pose_landmark/pose_landmark_full.tflite", 0.0, 255.0),
    }
    folder = os.path.join(os.path.dirname(str(mediapipe.__file__)), "modules")
    described = {}
    for name, (path, mean, std) in models.items():
        with open(os.path.join(folder, *path.split("/")), "rb") as file:
            writer = metadata_writer.MetadataWriter.create(bytearray(file.read()))
        writer.add_image_input([mean], [std])
        described[name] = bytes(writer.populate()[0])
    with tempfile.TemporaryDirectory() as temporary:
        path = os.path.join(temporary, "pose.task")
        model_asset_bundle_utils.create_model_asset_bundle(described, path)
        with open(path, "rb") as file:
            return file.read()
