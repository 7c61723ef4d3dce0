"""Covariances of cameras in a TOML calibration: a table per camera below ``[metadata.covariance]``.

``parameters`` lists the names with their units, ``reference`` states what the pose is relative to, and ``matrix`` has
one row per parameter (see :class:`posefuse.model.camera_covariance.CameraCovariance`). Other programs skip
``[metadata]``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from posefuse.errors import CameraError, FileError
from posefuse.model.camera_covariance import CameraCovariance
from posefuse.model.cameras import CameraRig

_KEY = "covariance"
_PLACEHOLDER = "posefuse-covariance-{}"


def text_with_covariances(data: dict[str, Any], rig: CameraRig) -> str:
    """Return a TOML text of some data with the covariances of a rig in ``[metadata]``, one line per row."""
    known = [each for each in rig.covariances if each.camera in rig.names]
    if not known:
        return tomli_w.dumps(data)
    tables = {
        each.camera: {
            "reference": each.reference,
            "parameters": list(each.parameters),
            "matrix": _PLACEHOLDER.format(i),
        }
        for i, each in enumerate(known)
    }
    text = tomli_w.dumps(data | {"metadata": {**data.get("metadata", {}), _KEY: tables}})
    for i, each in enumerate(known):
        rows = ",\n".join(f"    [{', '.join(map(repr, row))}]" for row in each.matrix.tolist())
        text = text.replace(f'"{_PLACEHOLDER.format(i)}"\n', f"[\n{rows},\n]\n", 1)
    return text


def read_covariances(path: Path, metadata: Mapping[str, Any]) -> tuple[CameraCovariance, ...]:
    """Return the covariances in ``[metadata]``; empty if there are none.

    Raises:
        FileError: if a table is not a covariance.
    """
    tables = metadata.get(_KEY, {})
    if not isinstance(tables, dict):
        raise FileError(f"{path}: metadata.{_KEY} must be a table per camera, got {repr(tables)[:60]}.")
    return tuple(_covariance(path, name, table) for name, table in tables.items())


def _covariance(path: Path, name: str, table: Any) -> CameraCovariance:
    """Return the covariance of a table."""
    try:
        parameters, matrix = [str(each) for each in table["parameters"]], table["matrix"]
        return CameraCovariance(name, tuple(parameters), matrix, str(table.get("reference", "")))
    except CameraError as error:
        raise FileError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError):
        raise FileError(f"{path}, table [metadata.{_KEY}.{name}]: expected parameters and a square matrix.") from None
