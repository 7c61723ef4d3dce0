"""Open a detector by its name, its file, or as a Python callable."""

import hashlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.detection.detector import Detector
from posefuse.detection.detectors.in_process import CallableDetector
from posefuse.detection.environments import Device, environment_of, installed_python, requirements_of, worker_file
from posefuse.detection.onnx_description import read_onnx_description
from posefuse.detection.process import WorkerCommand, WorkerProcess, WorkerSettings
from posefuse.detection.registry import detectors, find_detector
from posefuse.detection.weights import missing_weights
from posefuse.errors import DetectorError, choices
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

AnyDetector = str | Path | Detector | Callable[[np.ndarray], Any]
"""A name of the registry, a file, a detector, or a function of one image."""


def opens_several(detector: AnyDetector) -> bool:
    """Return whether a detector can be opened several times, to work in parallel; a callable cannot."""
    return isinstance(detector, str | Path)


@dataclass(frozen=True)
class DefaultDetector:
    """The detector that is used if none is named.

    Attributes:
        name: its name.
        reason: why it is the default, in a few words.
    """

    name: str
    reason: str


def default_detector(*, weights_given: bool = False, python_given: bool = False) -> DefaultDetector:
    """Return the best installed detector whose weights are on this computer, or else the best installed one.

    Args:
        weights_given: whether files of weights are given, which leaves the detectors that take them.
        python_given: whether an interpreter is given, which no default fits.

    Raises:
        DetectorError: if an interpreter is given, or no detector is installed; the message has the commands that
            install one.
    """
    if python_given:
        raise DetectorError(
            "`detector_python` needs `detector`: a worker file (.py) that uses this Python, or mediapipe or rtmpose if "
            "their packages are installed in it."
        )
    general = [record for record in detectors() if record.models[0].skeleton]
    general = [record for record in general if record.takes_weights or not weights_given]
    installed = [record for record in general if environment_of(record).state == "installed"]
    if not installed:
        commands = " or ".join(f"posefuse detector install {record.name}" for record in reversed(general))
        what = "No detector that takes `weights`" if weights_given else "No detector"
        raise DetectorError(f"{what} is installed. Run: {commands}.")
    if weights_given:
        return DefaultDetector(installed[0].name, "the detector that takes `weights`")
    ready = [record for record in installed if not missing_weights(record.models[0])]
    best = installed[0]
    if not ready:
        return DefaultDetector(best.name, "the only one installed; it downloads its weights now")
    if ready[0] is best:
        return DefaultDetector(best.name, "the best one installed")
    reason = f"because the weights of {best.name} are not on this computer; `detector='{best.name}'` downloads them"
    return DefaultDetector(ready[0].name, reason)


def open_detector(
    detector: AnyDetector,
    *,
    skeleton: str | Path | Skeleton | None = None,
    python: Path | None = None,
    device: Device = "auto",
    weights: Sequence[Path] = (),
    threads: int = 1,
) -> Detector:
    """Return a detector that is ready to use; the caller closes it.

    Args:
        detector: ``NAME`` or ``NAME:MODEL`` of an installed detector; a worker file (``.py``); the description of an
            ONNX model (``.toml``); a function of one image, shape (height, width, 3), uint8, RGB, that returns x, y and
            confidence, shape (person, keypoint, 3); or an object with the methods of
            :class:`~posefuse.detection.detector.Detector`.
        skeleton: skeleton of the keypoints that a function returns; by default its attribute ``skeleton``.
        python: interpreter that has the detector's packages; by default that of the installed environment, and this
            one for a worker file.
        device: device of a model that can run on several.
        weights: files of weights, by default the detector's own; a worker file may take folders.
        threads: number of threads of a worker.

    Raises:
        DetectorError: if there is no such detector, it is not installed, it does not start, or a function comes without
            a skeleton.
    """
    if isinstance(detector, str | Path):
        own = str(detector).endswith(".py")
        files = [_existing(each, folders=own) for each in weights]
        settings = WorkerSettings(device=device, threads=threads, weights=tuple(map(str, files)))
        return _open_worker(str(detector), python, settings)
    if isinstance(detector, Detector):
        return detector
    given = skeleton if skeleton is not None else getattr(detector, "skeleton", None)
    if given is None:
        raise DetectorError(
            "A function as detector needs `skeleton`, the name or file of the skeleton of its keypoints, such as "
            "`skeleton='coco_17'`."
        )
    return CallableDetector(detector, find_skeleton(given))


def _open_worker(detector: str, python: Path | None, settings: WorkerSettings) -> WorkerProcess:
    python = None if python is None else _interpreter(python)
    if detector.endswith(".py"):
        path = _existing(Path(detector))
        command = WorkerCommand(path.stem, python or Path(sys.executable), path, isolated=False)
        worker = WorkerProcess(command, settings)
        worker.version = " ".join(filter(None, (worker.version, f"worker file {_digest(path)}")))
        return worker
    described = detector.endswith(".toml")
    record, model = find_detector("onnx" if described else detector)
    if not described and not model.skeleton:
        raise DetectorError(f"The detector {record.name} needs the TOML file that describes the model, as its name.")
    if settings.weights and not record.takes_weights:
        raise DetectorError(f"The detector {record.name} takes no `weights`. {record.weights}")
    if settings.device == "cuda":
        requirements_of(record, cuda=True)
    command = WorkerCommand(
        Path(detector).stem if described else record.name,
        python or installed_python(record),
        worker_file(record),
        isolated=python is None,
    )
    description = read_onnx_description(_existing(Path(detector))) if described else {}
    return WorkerProcess(command, replace(settings, model=model.name, description=description))


def _interpreter(python: Path) -> Path:
    """Return the interpreter of a path that is one or the folder of an environment."""
    inside = [python / name for name in ("bin/python", "Scripts/python.exe", "python.exe")]
    found = next((path for path in inside if path.exists()), python) if python.is_dir() else python
    if not found.is_file():
        raise DetectorError(f"There is no Python interpreter {python}. Name the file or the folder of its environment.")
    return found


def _existing(path: Path, *, folders: bool = False) -> Path:
    if not (path.is_file() or (folders and path.is_dir())):
        siblings = sorted(each.name for each in path.parent.glob(f"*{path.suffix}")) if path.parent.is_dir() else []
        raise DetectorError(f"There is no file {path}. In its folder: {choices(siblings)}.")
    return path.absolute()


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]
