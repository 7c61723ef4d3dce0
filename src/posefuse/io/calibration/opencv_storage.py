"""Parsing of OpenCV's FileStorage (YAML and XML) and plain YAML to dictionaries; no code is executed."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from posefuse.errors import FileError
from posefuse.io.calibration.camera_records import small_text
from posefuse.io.files import parse_xml

YAML_SUFFIXES = (".yml", ".yaml")
_MATRIX_TAG = "tag:yaml.org,2002:opencv-matrix"


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """A safe loader with OpenCV's matrices; uses LibYAML, which is ten times faster, if available."""


def _matrix(loader: _Loader, node: Any) -> np.ndarray:
    return _shaped(loader.construct_mapping(node, deep=True))


_Loader.add_constructor(_MATRIX_TAG, _matrix)


def _shaped(table: dict[Any, Any]) -> np.ndarray:
    rows, columns = int(table["rows"]), int(table["cols"])
    return np.asarray(table["data"], dtype=np.float64).reshape(rows, columns)


def read_yaml(path: Path) -> Any:
    """Return the content of a YAML file, including OpenCV's matrices.

    Raises:
        FileError: if it is not valid YAML, or a matrix does not have the stated shape.
    """
    lines = small_text(path).split("\n")
    # OpenCV writes %YAML:1.0, which is not valid YAML.
    text = "\n".join(line for line in lines if not line.startswith("%YAML"))
    try:
        # Aliases (*name) can expand a short text to any size, and calibrations do not need them.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, _Loader)):
            raise ValueError("it contains aliases (*name), which are not allowed")
        return yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise FileError(f"{path} is not valid YAML: {reason}. Is it truncated?") from None


def yaml_matches(path: Path) -> Any:
    """Return the content of a file named as YAML, for recognizing formats; None for any other file."""
    return read_yaml(path) if path.suffix in YAML_SUFFIXES and path.is_file() else None


def read_storage(path: Path) -> dict[str, Any]:
    """Return the entries of a FileStorage in YAML or XML.

    Raises:
        FileError: if it is neither, or a matrix does not have the stated shape.
    """
    if path.suffix in YAML_SUFFIXES:
        data = read_yaml(path)
        return {str(key): value for key, value in data.items()} if isinstance(data, dict) else {}
    root = parse_xml(path, small_text(path))
    try:
        return {child.tag: _value(child) for child in root} if root.tag == "opencv_storage" else {}
    except (TypeError, ValueError, OverflowError) as error:
        raise FileError(f"{path}: a matrix is invalid: {error}.") from None


def _value(element: ElementTree.Element) -> Any:
    if element.get("type_id") == "opencv-matrix":
        table = {child.tag: child.text or "" for child in element}
        missing = {"rows", "cols", "data"} - set(table)
        if missing:
            raise ValueError(f"<{element.tag}> has no {sorted(missing)[0]}")
        return _shaped({"rows": table["rows"], "cols": table["cols"], "data": table["data"].split()})
    if len(element):
        return [_value(child) for child in element]
    text = (element.text or "").strip()
    try:
        numbers = [float(part) for part in text.split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers
