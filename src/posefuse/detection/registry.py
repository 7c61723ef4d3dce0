"""The detectors that posefuse installs, and the models of each.

A detector is one file of :mod:`posefuse.detection.detectors` with one constant ``DETECTOR``, and a worker file of
:mod:`posefuse.detection.workers`. :data:`MODULES` names the files, the best detector first.
"""

from dataclasses import dataclass
from functools import cache
from importlib import import_module

from posefuse.errors import DetectorError, choices, suggestion


@dataclass(frozen=True)
class DetectorModel:
    """A model of a detector.

    Attributes:
        name: name after the colon of ``DETECTOR:MODEL``.
        skeleton: shipped skeleton of its keypoints; empty if a file describes it.
        help: what it detects, in a few words.
        weights: files of weights that it downloads when it is first used; empty if its package contains them.
    """

    name: str
    skeleton: str
    help: str
    weights: tuple[str, ...] = ()


@dataclass(frozen=True)
class Requirements:
    """Packages of an environment.

    Attributes:
        files: files of pinned packages in the folder ``requirements``, all of whose packages are installed, and
            nothing that they depend on.
        python: oldest and newest Python, minor versions of 3.
        size_mb: size on disk, on Linux.
        download_mb: size of the download, on Linux.
    """

    files: tuple[str, ...]
    python: tuple[int, int]
    size_mb: int
    download_mb: int


@dataclass(frozen=True)
class DetectorRecord:
    """A detector that runs in an environment of its own.

    Attributes:
        name: name in ``--detector`` and ``posefuse detector install``.
        help: one sentence.
        models: its models, the default first.
        requirements: packages of its environment.
        worker: name of its worker file.
        licenses: licenses of code and weights.
        weights: where the weights come from, in one sentence.
        takes_weights: whether files of weights can be given.
        cuda: packages of its environment with CUDA, or None if it runs on the CPU only.
    """

    name: str
    help: str
    models: tuple[DetectorModel, ...]
    requirements: Requirements
    worker: str
    licenses: str
    weights: str
    takes_weights: bool = False
    cuda: Requirements | None = None


MODULES = ("rtmpose", "mediapipe", "onnx")


@cache
def detectors() -> tuple[DetectorRecord, ...]:
    """Return the detectors, the best one first."""
    return tuple(import_module(f"posefuse.detection.detectors.{name}").DETECTOR for name in MODULES)


def find_detector(name: str) -> tuple[DetectorRecord, DetectorModel]:
    """Return a detector and one of its models by ``DETECTOR`` or ``DETECTOR:MODEL``.

    Raises:
        DetectorError: if there is no such detector or model.
    """
    first, _, second = name.partition(":")
    record = next((each for each in detectors() if each.name == first), None)
    if record is None:
        names = [each.name for each in detectors()]
        raise DetectorError(
            f"There is no detector {first!r}. {suggestion(first, names)} Or name a worker file (.py) or the "
            "description of an ONNX model (.toml)."
        )
    model = next((each for each in record.models if each.name == (second or record.models[0].name)), None)
    if model is None:
        names = [each.name for each in record.models]
        raise DetectorError(f"The detector {first} has no model {second!r}. It has {choices(names)}.")
    return record, model
