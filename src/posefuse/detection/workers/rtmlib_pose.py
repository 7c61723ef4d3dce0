"""RTMPose and RTMO with rtmlib and ONNX Runtime: several people, body, feet, hands and face."""

# rtmlib is in the environment of the worker only.
# pyright: reportMissingImports=false
from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from onnx_sessions import UsageError, choose_device, digest, limit_threads, open_session

SKELETONS = {"body17": "coco_17", "body26": "halpe_26", "wholebody133": "coco_wholebody_133"}
SOLUTIONS = {"body17": "Body", "body26": "BodyWithFeet", "wholebody133": "Wholebody"}
COUNTS = {"body17": 17, "body26": 26, "wholebody133": 133}


class Detector:
    """Detects people with YOLOX and their keypoints with RTMPose, or both at once with RTMO."""

    several_people = True
    batch_size = 1

    def __init__(self, settings: dict[str, Any]) -> None:
        import onnxruntime
        import rtmlib

        self._model = settings["model"]
        self.skeleton = SKELETONS[self._model]
        self._device = choose_device(settings["device"])
        limit_threads(settings["threads"])
        self.version = f"rtmlib, onnxruntime {onnxruntime.__version__}, {self._model}"
        if settings["check"]:
            return
        files = self._given(settings["weights"])
        shipped: dict[str, Any] = getattr(rtmlib, SOLUTIONS[self._model]).MODE["balanced"]
        if "both" not in files:
            download_weights(
                [shipped[kind] for kind, name in (("det", "person"), ("pose", "pose")) if name not in files]
            )
        self._person: Any = None
        self._pose: Any = None
        self._both: Any = None
        if "both" in files:
            self._both = self._load(rtmlib.RTMO, files["both"], (640, 640))
        else:
            person = files["person"] if "person" in files else shipped["det"]
            pose = files["pose"] if "pose" in files else shipped["pose"]
            self._person = self._load(rtmlib.YOLOX, person, shipped["det_input_size"])
            self._pose = self._load(rtmlib.RTMPose, pose, shipped["pose_input_size"])
        loaded = [each.onnx_model for each in (self._both, self._person, self._pose) if each is not None]
        self.version += ", weights " + " ".join(digest(path) for path in loaded)

    def detect(self, images: np.ndarray) -> list[Any]:
        """Return x, y and score of the keypoints, shape (person, keypoint, 3), and the boxes of each image."""
        return [self._detect_one(image) for image in images]

    def _detect_one(self, image: np.ndarray) -> Any:
        # As in their training: YOLOX and RTMO take blue, green and red, RTMPose takes red, green and blue.
        bgr = np.ascontiguousarray(image[..., ::-1])
        if self._both is not None:
            keypoints, scores = self._both(bgr)
            found = (scores > 0.0).any(axis=1)
            return as_rows(keypoints[found], scores[found])
        boxes = np.asarray(self._person(bgr), dtype=np.float64).reshape(-1, 4)
        if len(boxes) == 0:
            return None
        keypoints, scores = self._pose(image, bboxes=boxes)
        return as_rows(keypoints, scores), boxes

    def _given(self, paths: list[str]) -> dict[str, str]:
        """Return the files of weights by what they are, which their outputs tell."""
        files: dict[str, str] = {}
        for path in paths:
            outputs = open_session(path, "cpu").get_outputs()
            names = [each.name for each in outputs]
            kind = "pose" if "simcc_x" in names else "both" if "keypoints" in names else "person"
            if kind in files:
                raise UsageError(f"{path} and {files[kind]} are both weights of the same kind ({kind})")
            files[kind] = path
            if kind != "person":
                axis = 1 if kind == "pose" else 2
                name = "simcc_x" if kind == "pose" else "keypoints"
                self._check_count(path, outputs[names.index(name)].shape[axis])
        return files

    def _check_count(self, path: str, count: Any) -> None:
        """Raise an error if weights have another number of keypoints than the chosen model; None if unknown."""
        if isinstance(count, int) and count != COUNTS[self._model]:
            better = next((f"; use rtmpose:{name}" for name, n in COUNTS.items() if n == count), "")
            raise UsageError(f"{path} has {count} keypoints, and {self._model} has {COUNTS[self._model]}{better}")

    def _load(self, kind: Any, path: str, size: tuple[int, int]) -> Any:
        """Load a model with the size of its input, if the file has a fixed one."""
        height_width = input_size(path) if os.path.exists(path) else None
        if height_width is not None:
            # rtmlib names width and height of RTMPose, and height and width of the others.
            height, width = height_width
            size = (width, height) if kind.__name__ == "RTMPose" else (height, width)
        return kind(path, model_input_size=size, backend="onnxruntime", device=self._device)


def download_weights(addresses: list[str]) -> None:
    """Download the weights that are not on this computer."""
    from rtmlib.tools import file

    try:
        with one_at_a_time(file._get_rtmhub_dir()):
            for address in addresses:
                file.download_checkpoint(address, progress=False)
    except OSError as error:
        folder = os.path.join(file._get_rtmhub_dir(), "checkpoints")
        reason = getattr(error, "reason", error)
        raise UsageError(
            f"its weights cannot be downloaded ({reason}). On a computer with a network, download "
            f"{' and '.join(addresses)}. Put the files into {folder}, or unpack them and name each end2end.onnx by "
            "`weights`"
        ) from None


@contextlib.contextmanager
def one_at_a_time(folder: str) -> Iterator[None]:
    """Wait until no other worker unpacks weights in the folder; without such locks (Windows), do not wait."""
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, ".posefuse.lock"), "w") as file:
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def as_rows(keypoints: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Return x, y and score; a keypoint without a score is missing."""
    rows = np.concatenate([keypoints, scores[..., None]], axis=2).astype(np.float64)
    rows[~(rows[..., 2] > 0.0)] = np.nan
    return rows


def input_size(path: str) -> tuple[int, int] | None:
    """Return height and width of a model's input, or None if they are not fixed."""
    shape = open_session(path, "cpu").get_inputs()[0].shape
    height, width = shape[2:]
    return (height, width) if isinstance(height, int) and isinstance(width, int) else None
