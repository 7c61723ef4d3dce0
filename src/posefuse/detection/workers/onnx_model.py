"""Any ONNX model that a description fits; posefuse.detection.onnx_description states the keys."""

# ONNX Runtime and OpenCV are in the environment of the worker only.
# pyright: reportMissingImports=false
from __future__ import annotations

from typing import Any

import numpy as np
from onnx_sessions import choose_device, digest, limit_threads, open_session

_BATCH = 8


class Detector:
    """Runs the model on whole images."""

    def __init__(self, settings: dict[str, Any]) -> None:
        import cv2
        import onnxruntime

        self.skeleton: Any = ["point"]
        self.several_people = True
        device = choose_device(settings["device"])
        limit_threads(settings["threads"])
        cv2.setNumThreads(settings["threads"])
        if settings["check"]:
            return
        given = settings["description"]
        self.skeleton, self.several_people = given["skeleton"], given["several_people"]
        self._input, self._output, self._count = given["input"], given["output"], given["n_keypoints"]
        self._session = open_session(given["model"], device)
        self.version = f"onnxruntime {onnxruntime.__version__}, model {digest(given['model'])}"
        first = self._session.get_inputs()[0]
        self._name, self._type = first.name, np.uint8 if "uint8" in first.type else np.float32
        self.batch_size = 1 if isinstance(first.shape[0], int) else _BATCH
        self._size = self._size_of(first.shape)
        self._names = list(self._output["names"]) or [
            each.name for each in self._session.get_outputs()[: 2 if self._output["kind"] == "simcc" else 1]
        ]

    def detect(self, images: np.ndarray) -> list[Any]:
        """Return x, y and confidence of the keypoints, shape (person, keypoint, 3), of each image."""
        found: list[Any] = []
        for start in range(0, len(images), self.batch_size):
            placed = [self._place(image) for image in images[start : start + self.batch_size]]
            batch = np.stack([each[0] for each in placed])
            outputs = self._session.run(self._names, {self._name: batch})
            for i, (_, placement) in enumerate(placed):
                found.append(self._in_image(self._decode([output[i] for output in outputs]), placement))
        return found

    def _size_of(self, shape: list[Any]) -> tuple[int, int]:
        """Return width and height of the input."""
        size = self._input["size_px"]
        height, width = shape[2:4] if self._input["layout"] == "nchw" else shape[1:3]
        if size:
            return int(size[0]), int(size[1])
        if isinstance(height, int) and isinstance(width, int):
            return width, height
        raise ValueError("the model takes images of any size; its description needs size_px in [input]")

    def _place(self, image: np.ndarray) -> tuple[np.ndarray, tuple[float, ...]]:
        """Return the input of an image, and its scale and offset in x and y."""
        import cv2

        width, height = self._size
        scale = np.array([width / image.shape[1], height / image.shape[0]])
        if self._input["resize"] != "stretch":
            scale[:] = scale.min()
        new = np.maximum(1, np.round(scale * image.shape[1::-1])).astype(int)
        left, top = (width - new[0]) // 2, (height - new[1]) // 2
        if self._input["resize"] == "corner":
            left = top = 0
        canvas = np.full((height, width, 3), self._input["pad"], dtype=np.uint8)
        canvas[top : top + new[1], left : left + new[0]] = cv2.resize(image, (int(new[0]), int(new[1])))
        if self._input["color"] == "bgr":
            canvas = canvas[..., ::-1]
        if self._type == np.float32:
            canvas = (canvas - np.array(self._input["mean"])) / np.array(self._input["std"])
        if self._input["layout"] == "nchw":
            canvas = canvas.transpose(2, 0, 1)
        placement = (new[0] / image.shape[1], new[1] / image.shape[0], float(left), float(top))
        return np.ascontiguousarray(canvas, dtype=self._type), placement

    def _in_image(self, rows: np.ndarray, placement: tuple[float, ...]) -> np.ndarray:
        """Return keypoints in pixels of the image, 0 at the center of the top-left pixel."""
        rows = rows.astype(np.float64)
        origin = self._output["origin"]
        fractions = self._output["normalized"]
        if fractions:
            rows[..., :2] *= self._size
        if (origin or ("corner" if fractions or self._output["kind"] == "yolo" else "center")) == "center":
            rows[..., :2] += 0.5
        rows[..., :2] = (rows[..., :2] - placement[2:]) / placement[:2] - 0.5
        return rows

    def _decode(self, outputs: list[np.ndarray]) -> np.ndarray:
        """Return keypoints in pixels of the input, shape (person, keypoint, 3)."""
        return getattr(self, "_" + self._output["kind"])(outputs)

    def _points(self, outputs: list[np.ndarray]) -> np.ndarray:
        array, column = outputs[0], self._output["score_column"]
        numbers = len(self._output["order"])
        if array.shape[-1] == numbers:
            return self._ordered(array.reshape(-1, self._count, numbers))
        table = array.reshape(-1, array.shape[-1])
        if column >= 0:
            table = table[table[:, column] >= self._output["min_score"]]
        return self._ordered(table[:, : self._count * numbers].reshape(-1, self._count, numbers))

    def _yolo(self, outputs: list[np.ndarray]) -> np.ndarray:
        table = outputs[0].T
        numbers = len(self._output["order"])
        first = table.shape[1] - self._count * numbers
        if first < 5:
            raise ValueError(
                f"the output has {table.shape[1]} columns; {self._count} keypoints need {5 + self._count * numbers}"
            )
        scores = table[:, 4:first].max(axis=1)
        table, scores = table[scores >= self._output["min_score"]], scores[scores >= self._output["min_score"]]
        center, half = table[:, :2], table[:, 2:4] / 2.0
        boxes = np.concatenate([center - half, center + half], axis=1)
        keep = best_boxes(boxes, scores, self._output["max_overlap"])
        return self._ordered(table[keep, first:].reshape(len(keep), self._count, numbers))

    def _heatmaps(self, outputs: list[np.ndarray]) -> np.ndarray:
        maps = outputs[0]
        height, width = maps.shape[1:]
        rows = np.full((1, len(maps), 3), np.nan)
        for k, heat in enumerate(maps):
            y, x = (int(place) for place in np.unravel_index(int(np.argmax(heat)), heat.shape))
            rows[0, k] = (
                (x + peak(heat[y], x) + 0.5) * self._size[0] / width - 0.5,
                (y + peak(heat[:, x], y) + 0.5) * self._size[1] / height - 0.5,
                heat[y, x],
            )
        return rows

    def _simcc(self, outputs: list[np.ndarray]) -> np.ndarray:
        places = [each.argmax(axis=1) * self._size[i] / each.shape[1] for i, each in enumerate(outputs)]
        score = np.minimum(outputs[0].max(axis=1), outputs[1].max(axis=1))
        return np.stack([*places, score], axis=1)[None]

    def _ordered(self, rows: np.ndarray) -> np.ndarray:
        """Return x, y and confidence, NaN without one, of numbers in the model's order."""
        order = self._output["order"]
        parts = [
            rows[..., order.index(letter)] if letter in order else np.full(rows.shape[:2], np.nan) for letter in "xyc"
        ]
        return np.stack(parts, axis=2)


def peak(line: np.ndarray, place: int) -> float:
    """Return the offset of a parabola's maximum through three samples, between -0.5 and 0.5."""
    if not 0 < place < len(line) - 1:
        return 0.0
    before, here, after = (float(each) for each in line[place - 1 : place + 2])
    curvature = before - 2.0 * here + after
    return 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0


def best_boxes(boxes: np.ndarray, scores: np.ndarray, max_overlap: float) -> list[int]:
    """Return the indices of boxes, best first, without those that overlap with a better one."""
    kept: list[int] = []
    area = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    for i in np.argsort(-scores, kind="stable").tolist():
        inside = np.minimum(boxes[i, 2:], boxes[kept, 2:]) - np.maximum(boxes[i, :2], boxes[kept, :2])
        shared = np.prod(np.maximum(inside, 0.0), axis=1)
        if not np.any(shared > max_overlap * (area[i] + area[kept] - shared)):
            kept.append(i)
    return kept
