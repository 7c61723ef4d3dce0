"""The TOML file that describes an ONNX model: its input, its output and its skeleton."""

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from posefuse.errors import DetectorError, choices, suggestion
from posefuse.skeleton.skeletons import find_skeleton

CHOICES = {
    "layout": ("nchw", "nhwc"),
    "color": ("rgb", "bgr"),
    "resize": ("letterbox", "corner", "stretch"),
    "kind": ("points", "yolo", "heatmaps", "simcc"),
    "origin": ("center", "corner"),
}
"""Values of the keys that have a fixed set."""


@dataclass(frozen=True)
class OnnxInput:
    """How an image becomes the input of a model.

    Attributes:
        size_px: width and height; by default those of the model.
        layout: order of the axes: batch, channel, height and width, or batch, height, width and channel.
        color: order of the channels.
        resize: ``letterbox`` keeps the aspect ratio and centers the image, ``corner`` keeps it and puts the image in
            the top-left corner, ``stretch`` fills the input.
        pad: value of the pixels around the image.
        mean: subtracted from each channel.
        std: by which each channel is then divided.
    """

    size_px: tuple[int, ...] = ()
    layout: str = "nchw"
    color: str = "rgb"
    resize: str = "letterbox"
    pad: int = 114
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class OnnxOutput:
    """How the output of a model becomes keypoints.

    Attributes:
        kind: ``points``: numbers of each keypoint, shape (batch, keypoint, number), (batch, person, keypoint, number)
            or (batch, person, column), whose first columns are the keypoints; ``yolo``: box, score and keypoints of
            candidates, shape (batch, column, candidate); ``heatmaps``: one map per keypoint, shape (batch, keypoint,
            height, width); ``simcc``: two outputs, of the columns and the rows, shape (batch, keypoint, bin).
        names: names of the outputs; by default the first ones of the model.
        order: the numbers of a keypoint: ``x``, ``y`` and ``c`` for the confidence.
        normalized: whether coordinates are fractions of the input's size.
        origin: whether the coordinate 0 is the center or the corner of the top-left pixel of the input; by default the
            corner for ``yolo`` and fractions, else the center.
        score_column: column with the person's score, for ``points``; -1 without one.
        min_score: people with a lower score are left out; those without a score never are.
        max_overlap: of two ``yolo`` boxes whose intersection is a larger share of their union, the better one is kept.
    """

    kind: str = "points"
    names: tuple[str, ...] = ()
    order: str = "xyc"
    normalized: bool = False
    origin: str = ""
    score_column: int = -1
    min_score: float = 0.3
    max_overlap: float = 0.65


@dataclass(frozen=True)
class OnnxDescription:
    """An ONNX model.

    Attributes:
        model: its file.
        skeleton: a shipped skeleton, the path of a TOML file, or the names of the keypoints.
        input: how an image becomes its input.
        output: how its output becomes keypoints.
        several_people: whether it detects more than one person.
    """

    model: str
    skeleton: str | tuple[str, ...]
    several_people: bool = False
    input: OnnxInput = field(default_factory=OnnxInput)
    output: OnnxOutput = field(default_factory=OnnxOutput)


def read_onnx_description(path: Path) -> dict[str, Any]:
    """Return the tables of a description, complete and checked, with absolute paths.

    Raises:
        DetectorError: if the file is no such description; the message names the key.
    """
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DetectorError(f"{path.name} is not valid TOML: {error}.") from None
    for key in ("model", "skeleton"):
        if key not in data:
            raise DetectorError(f"{path.name}: the description of an ONNX model needs {key!r}; it has {choices(data)}.")
    tables = {key: _record(kind, data.pop(key, {}), f"{path.name}: [{key}]") for key, kind in _TABLES.items()}
    whole = _record(OnnxDescription, data, path.name, **tables)
    model = path.parent / whole.model
    if not model.is_file():
        raise DetectorError(f"{path.name}: there is no model {model}.")
    skeleton = whole.skeleton
    if isinstance(skeleton, str) and skeleton.endswith(".toml"):
        skeleton = str((path.parent / skeleton).absolute())
    count = len(find_skeleton(skeleton)) if isinstance(skeleton, str) else len(skeleton)
    return {**asdict(whole), "model": str(model.absolute()), "skeleton": skeleton, "n_keypoints": count}


_TABLES = {"input": OnnxInput, "output": OnnxOutput}


def _record(kind: Any, data: object, where: str, **tables: Any) -> Any:
    """Return a record of a table's values."""
    if not isinstance(data, Mapping):
        raise DetectorError(f"{where} must be a table, got {data!r}.")
    known = {each.name: each for each in fields(kind) if each.name not in _TABLES}
    values = {}
    for key, value in data.items():
        if key not in known:
            raise DetectorError(f"{where}: unknown key {key!r}. {suggestion(key, known)}")
        values[key] = _value(key, value, known[key].default, where)
    return kind(**values, **tables)


def _value(key: str, value: Any, default: Any, where: str) -> Any:
    """Return a value of a table in the type of its default."""
    if key in CHOICES and value not in CHOICES[key]:
        raise DetectorError(f"{where}: {key} must be one of {choices(CHOICES[key])}, got {value!r}.")
    if key == "skeleton":
        good = isinstance(value, str) or (isinstance(value, list) and value and all(isinstance(n, str) for n in value))
    elif isinstance(default, tuple):
        kind = str if key == "names" else int if key == "size_px" else int | float
        length = {"size_px": (2,), "mean": (3,), "std": (3,)}.get(key, (1, 2))
        good = isinstance(value, list) and len(value) in length and all(isinstance(each, kind) for each in value)
        good = good and not (key in ("size_px", "std") and any(each <= 0 for each in value))
    elif isinstance(default, float):
        good = isinstance(value, int | float) and not isinstance(value, bool)
    else:
        good = isinstance(value, type(default) if isinstance(default, str | bool | int) else str)
    if key == "order":
        good = good and sorted(str(value)) in (["c", "x", "y"], ["x", "y"])
    if not good:
        raise DetectorError(f"{where}: {key} has the wrong form: {value!r}. {_FORMS.get(key, 'See docs/detect.md.')}")
    return tuple(value) if isinstance(value, list) else value


_FORMS = {
    "size_px": "It is a width and a height, such as [256, 256].",
    "mean": "It is three numbers, such as [123.7, 116.3, 103.5].",
    "std": "It is three positive numbers, such as [58.4, 57.1, 57.4].",
    "order": "It is the order of the letters x, y and c, such as 'xyc'.",
    "skeleton": "It is a shipped skeleton, a TOML file or a list of names.",
    "names": "It is a list of one or two names of outputs.",
}
