"""Read files of posefuse as named numbers and named labels, for :mod:`benchmarks.same_numbers`.

The name of a number is its variable, its column, or the path of its key. Texts, including those in attributes, are
labels. Documents in attributes (options, skeleton, provenance) are read as documents.
"""

import csv
import json
import re
import struct
import tomllib
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ezc3d
import h5py
import numpy as np
import pyarrow.parquet as pq

NOT_COMPARED = (".png", ".svg", ".html", ".log")
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.]*\d)")
_OPTION_IN_COMMENT = re.compile(r"^# (?=[a-z_0-9]+ = )", re.MULTILINE)
_ATTRIBUTES_OF_FORMAT = {
    "_Netcdf4Dimid", "_Netcdf4Coordinates", "_NCProperties", "CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST",
    "DIMENSION_LABELS", "object_id", ".specloc",
}  # fmt: skip
_ACCESSOR_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


@dataclass
class Content:
    """Content of a file.

    Attributes:
        numbers: numbers by name.
        labels: lists of texts by name.
        inner: numbers of documents in attributes, by attribute and key; their keys may be renamed.
    """

    numbers: dict[str, np.ndarray] = field(default_factory=dict)
    labels: dict[str, list[str]] = field(default_factory=dict)
    inner: dict[str, np.ndarray] = field(default_factory=dict)


def read(path: Path) -> Content:
    """Read a file by its suffix; unknown files are read as text that contains numbers."""
    return READERS.get(path.suffix.lower(), _text)(path)


def _document(data: Any) -> Content:
    """Return the leaves of a JSON or TOML document; list positions are not part of the name."""
    numbers, labels = defaultdict(list), defaultdict(list)

    def visit(value: Any, name: str) -> None:
        if isinstance(value, dict):
            for key, each in value.items():
                visit(each, f"{name}.{key}" if name else str(key))
        elif isinstance(value, list):
            for each in value:
                visit(each, f"{name}[]")
        elif value is None:
            numbers[name].append(np.nan)
        elif isinstance(value, bool | int | float):
            numbers[name].append(float(value))
        else:
            labels[name].append(str(value))

    visit(data, "")
    return Content({name: np.array(values) for name, values in numbers.items()}, dict(labels))


def _parsed(text: str) -> Any:
    """Parse a JSON or TOML document in a text; None if it is neither."""
    try:
        if text[:1] in ("{", "["):
            return json.loads(text)
        if " = " in text and "\n" in text:
            return tomllib.loads(text)
    except ValueError:
        return None
    return None


def _json(path: Path) -> Content:
    return _document(json.loads(path.read_text("utf-8")))


def _jsonl(path: Path) -> Content:
    return _document([json.loads(line) for line in path.read_text("utf-8").splitlines() if line])


def _toml(path: Path) -> Content:
    text = path.read_text("utf-8")
    try:
        return _document(tomllib.loads(_OPTION_IN_COMMENT.sub("", text)))
    except tomllib.TOMLDecodeError:
        return _text(path)


def numbers_of_text(text: str) -> Content:
    """Return the numbers in a text, in order, and its words."""
    found = np.array([float(each) for each in _NUMBER.findall(text)])
    return Content({"numbers": found}, {"words": _NUMBER.sub("#", text).split()})


def _text(path: Path) -> Content:
    return numbers_of_text(path.read_text("utf-8", errors="replace"))


def _printed(path: Path) -> Content:
    """Read the output of a command; numbers are sorted, because sentences may change."""
    content = _text(path)
    content.numbers["numbers"].sort()
    return content


def _columns(rows: list[list[str]], names: list[str]) -> Content:
    content = Content()
    for index, own in enumerate(names):
        name = own if names.index(own) == index else f"{own} ({index})"
        cells = [row[index] if index < len(row) else "" for row in rows]
        try:
            content.numbers[name] = np.array([float(cell) if cell else np.nan for cell in cells])
        except ValueError:
            content.labels[name] = cells
    content.labels["column names"] = names
    return content


def _csv(path: Path) -> Content:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    return _columns(rows[1:], rows[0]) if rows else Content()


def _trc(path: Path) -> Content:
    """Read markers as one array, and the header separately."""
    lines = [line.split("\t") for line in path.read_text("utf-8").splitlines()]
    head, body = lines[:5], [line for line in lines[5:] if any(line)]
    width = max(map(len, body), default=0)
    cells = [[float(cell) if cell else np.nan for cell in line + [""] * (width - len(line))] for line in body]
    header = numbers_of_text("\n".join("\t".join(line) for line in head[1:3]))
    return Content(
        {"points": np.array(cells), "header": header.numbers["numbers"]},
        {"header": header.labels["words"], "markers": [cell for line in head[3:] for cell in line if cell]},
    )


def _c3d(path: Path) -> Content:
    found, content = ezc3d.c3d(str(path)), Content()
    content.numbers["points"] = found["data"]["points"]
    for name, values in found["data"]["meta_points"].items():
        content.numbers[name] = np.asarray(values)
    for group, parameters in found["parameters"].items():
        for name, parameter in parameters.items():
            if isinstance(parameter, dict) and "value" in parameter:
                values = np.asarray(parameter["value"])
                key = f"{group}.{name}"
                if values.dtype.kind in "iuf":
                    content.numbers[key] = values
                else:
                    content.labels[key] = [str(value) for value in values.ravel()]
    return content


def _bvh(path: Path) -> Content:
    hierarchy, _, motion = path.read_text("utf-8").partition("MOTION")
    first, second = numbers_of_text(hierarchy), numbers_of_text(motion)
    return Content(
        {"hierarchy": first.numbers["numbers"], "motion": second.numbers["numbers"]},
        {"hierarchy": first.labels["words"], "motion": second.labels["words"]},
    )


def _glb(path: Path) -> Content:
    """Read the numbers of the scene, and decode every accessor."""
    data, chunks, place = path.read_bytes(), {}, 12
    while place < len(data):
        length, kind = struct.unpack_from("<II", data, place)
        chunks[kind] = data[place + 8 : place + 8 + length]
        place += 8 + length
    scene, binary = json.loads(chunks[0x4E4F534A]), chunks.get(0x004E4942, b"")
    content = _document(scene)
    for number, accessor in enumerate(scene.get("accessors", [])):
        view = scene["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        width, kind = _COMPONENTS[accessor["type"]], np.dtype(_ACCESSOR_TYPES[accessor["componentType"]])
        if "byteStride" in view:
            raise ValueError(f"{path.name}: interleaved buffers are not supported.")
        values = np.frombuffer(binary, kind, accessor["count"] * width, start)
        content.numbers[f"accessor {number}"] = values.reshape(-1, width)
    return content


def _array(content: Content, name: str, values: np.ndarray) -> None:
    """Add an array to numbers or labels; records are split."""
    if values.dtype.names:
        for part in values.dtype.names:
            _array(content, f"{name}.{part}", values[part])
    elif values.dtype.kind in "biufc":
        content.numbers[name] = values
    elif values.dtype.kind in "SUOT":
        content.labels[name] = [each.decode(errors="replace") if isinstance(each, bytes) else str(each)
                                for each in values.ravel()]  # fmt: skip


def _attributes(content: Content, where: str, attributes: Any) -> None:
    for name, value in attributes.items():
        if name in _ATTRIBUTES_OF_FORMAT or isinstance(value, h5py.Empty | h5py.Reference):
            continue
        key, value = f"{where}@{name}", value.decode(errors="replace") if isinstance(value, bytes) else value
        document = _parsed(value) if isinstance(value, str) else None
        if document is None:
            _array(content, key, np.asarray(value))
            continue
        inside = _document(document)
        content.inner |= {f"{key}:{part}": numbers for part, numbers in inside.numbers.items()}
        content.labels |= {f"{key}:{part}": texts for part, texts in inside.labels.items()}


def _hdf5(path: Path) -> Content:
    """Read netCDF-4 and any other HDF5 file."""
    content = Content()

    def visit(name: str, item: Any) -> None:
        _attributes(content, name, item.attrs)
        if isinstance(item, h5py.Dataset) and item.dtype != h5py.ref_dtype and item.shape is not None:
            _array(content, name, np.asarray(item[()]))

    with h5py.File(path) as file:
        _attributes(content, "", file.attrs)
        file.visititems(visit)
    return content


def _npz(path: Path) -> Content:
    content = Content()
    with np.load(path) as held:
        for name in held.files:
            _array(content, name, held[name])
    return content


def _npy(path: Path) -> Content:
    content = Content()
    _array(content, "array", np.load(path))
    return content


def _parquet(path: Path) -> Content:
    table, content = pq.read_table(path), Content()
    for name in table.column_names:
        values = table[name].to_pylist()
        if any(isinstance(value, list | dict) for value in values):
            inside = _document([{name: value} for value in values])
            content.numbers |= inside.numbers
            content.labels |= inside.labels
        elif any(isinstance(value, str) for value in values):
            content.labels[name] = [str(value) for value in values]
        else:
            content.numbers[name] = table[name].to_numpy()
    for key, value in (table.schema.metadata or {}).items():
        if key != b"ARROW:schema":
            _attributes(content, "", {key.decode(): value})
    return content


READERS: dict[str, Callable[[Path], Content]] = {
    ".json": _json, ".jsonl": _jsonl, ".toml": _toml, ".csv": _csv, ".trc": _trc, ".c3d": _c3d, ".bvh": _bvh,
    ".glb": _glb, ".nc": _hdf5, ".h5": _hdf5, ".nwb": _hdf5, ".npz": _npz, ".npy": _npy, ".parquet": _parquet,
    ".txt": _printed,
}  # fmt: skip
