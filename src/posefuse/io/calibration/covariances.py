"""Covariances of cameras in a TOML calibration: a table per camera below ``[metadata.covariance]``.

``parameters`` lists the names with their units, ``reference`` states what the pose is relative to, and ``matrix`` has
one row per parameter (see :class:`posefuse.model.camera_covariance.CameraCovariance`). ``metadata.correlation`` has the
correlations of the parameters of all tables, in their order: the rows of the lower triangle without the diagonal, as
little-endian float32 in base64. Other programs skip ``[metadata]``.
"""

import base64
import binascii
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from posefuse.errors import CameraError, FileError
from posefuse.model.camera_covariance import CameraCovariance
from posefuse.model.cameras import CameraRig

_KEY, _CORRELATION = "covariance", "correlation"
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
    correlation = {} if rig.correlation is None else {_CORRELATION: _packed(rig)}
    text = tomli_w.dumps(data | {"metadata": {**data.get("metadata", {}), **correlation, _KEY: tables}})
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


def read_correlation(
    path: Path, metadata: Mapping[str, Any], covariances: Sequence[CameraCovariance]
) -> np.ndarray | None:
    """Return the correlation of all parameters of the covariances in ``[metadata]``, or None if there is none.

    Raises:
        FileError: if it does not belong to these covariances.
    """
    text = metadata.get(_CORRELATION)
    if text is None:
        return None
    n = sum(len(each.parameters) for each in covariances)
    try:
        values = np.frombuffer(base64.b64decode(text, validate=True), dtype="<f4")
    except (TypeError, ValueError, binascii.Error):
        raise FileError(f"{path}: metadata.{_CORRELATION} must be a text in base64.") from None
    if len(values) != n * (n - 1) // 2 or not np.isfinite(values).all():
        raise FileError(
            f"{path}: metadata.{_CORRELATION} does not belong to the {n} parameters in metadata.{_KEY}. Remove it if "
            "cameras were added or removed."
        )
    out = np.eye(n)
    out[np.tril_indices(n, -1)] = values
    return np.tril(out) + np.tril(out, -1).T


def _packed(rig: CameraRig) -> str:
    """Return the correlations of the cameras of a rig as text."""
    assert rig.correlation is not None
    used = [each.camera in rig.names for each in rig.covariances for _ in each.parameters]
    chosen = rig.correlation[np.ix_(used, used)]
    return base64.b64encode(chosen[np.tril_indices(len(chosen), -1)].astype("<f4").tobytes()).decode()


def _covariance(path: Path, name: str, table: Any) -> CameraCovariance:
    """Return the covariance of a table."""
    try:
        parameters, matrix = [str(each) for each in table["parameters"]], table["matrix"]
        return CameraCovariance(name, tuple(parameters), matrix, str(table.get("reference", "")))
    except CameraError as error:
        raise FileError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError):
        raise FileError(f"{path}, table [metadata.{_KEY}.{name}]: expected parameters and a square matrix.") from None
