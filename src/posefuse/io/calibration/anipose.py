"""Anipose's and FreeMoCap's calibration TOML: tables cam_0, cam_1, ..., the unit of the board, an unknown up axis.

Rotation (Rodrigues vector) and translation are world to camera, the camera OpenCV's; five distortion coefficients, or
four with ``fisheye = true``. Files written here also say ``unit``, ``up_axis``, ``notes`` and ``left_out`` under
``[metadata]``, which other programs ignore. Tables are ordered by number: sorting them as text puts cam_10
before cam_2.
"""

from pathlib import Path
from typing import Any

import tomli_w

from posefuse.errors import FileError, choices, suggestion
from posefuse.io.calibration.tables import METRES, camera_from_table, camera_tables, guessed_unit
from posefuse.io.files import read_toml, replacing
from posefuse.model.cameras import UP_AXES, CameraRig, LensModel, UpAxis, vector_from_rotation
from posefuse.model.options import LengthUnit


def matches(path: Path) -> bool:
    """Whether the file is one."""
    return path.suffix == ".toml" and bool(camera_tables(read_toml(path)))


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the order of their numbers.

    Args:
        path: the file.
        unit: of its lengths; by default what ``[metadata]`` says, else mm, or m where the cameras would stand closer
            together than cameras can.

    Raises:
        FileError: if the file is not what its format says.
        CameraError: if a camera's numbers cannot be.
    """
    data = read_toml(path)
    tables = camera_tables(data)
    if not tables:
        raise FileError(f"{path} describes no camera: expected tables [cam_0], [cam_1], ..., got {choices(data)}.")
    metadata = data.get("metadata", {})
    said = metadata.get("unit")
    if said is not None and said not in METRES:
        raise FileError(f"{path}: metadata.unit is {said!r}. {suggestion(str(said), METRES)}")
    notes: tuple[str, ...] = ()
    chosen = unit or said
    if chosen is None:
        chosen = guessed_unit((table.get("rotation"), table.get("translation")) for table in tables.values())
        notes = (f"{path.name} does not say its unit of length; read as {chosen}. --length-unit says otherwise.",)
    cameras = tuple(camera_from_table(path, key, table, METRES[chosen]) for key, table in tables.items())
    notes = (*_texts(path, metadata, "notes"), *notes)
    left_out = _texts(path, metadata, "left_out")
    return CameraRig(cameras, _up_axis(path, metadata), path.name, METRES[chosen], notes, left_out)


def _texts(path: Path, metadata: dict[str, Any], key: str) -> tuple[str, ...]:
    values = metadata.get(key, [])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise FileError(f"{path}: metadata.{key} should be a list of texts, got {values!r}.")
    return tuple(values)


def _up_axis(path: Path, metadata: dict[str, Any]) -> UpAxis | None:
    up = metadata.get("up_axis")
    if up is None and (metadata.get("groundplane_calibration") or metadata.get("groundplane_applied")):
        return "z"
    if up is not None and up not in UP_AXES:
        raise FileError(f"{path}: metadata.up_axis is {up!r}. {suggestion(str(up), UP_AXES)}")
    return up


def write(rig: CameraRig, path: Path) -> None:
    """Write a rig in metres.

    Raises:
        FileError: if a lens model does not fit the format.
    """
    data: dict[str, Any] = {}
    for i, camera in enumerate(rig.cameras):
        distortion = list(camera.distortion) or [0.0] * 5
        data[f"cam_{i}"] = {
            "name": camera.name,
            "size": list(camera.size_px),
            "matrix": camera.matrix.tolist(),
            "distortions": distortion,
            "rotation": vector_from_rotation(camera.rotation).tolist(),
            "translation": camera.translation_m.tolist(),
        }
        if camera.lens is LensModel.FISHEYE:
            data[f"cam_{i}"]["fisheye"] = True
    data["metadata"] = {"unit": "m"} | ({"up_axis": rig.up_axis} if rig.up_axis else {})
    if rig.left_out:
        data["metadata"] |= {"left_out": list(rig.left_out)}
    if rig.notes:
        data["metadata"] |= {"notes": list(rig.notes)}
    with replacing(path) as temporary:
        temporary.write_text(tomli_w.dumps(data), "utf-8")
