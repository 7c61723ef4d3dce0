"""Scene points: positions in the world and in the images of the cameras, in a TOML or CSV file.

* TOML: ``world_m`` is a list of positions ``[x, y, z]`` in meters, or the path of Pose2Sim's ``Config.toml``, whose
  ``object_coords_3d`` is read. ``[image_px]`` has, for each camera, one ``[u, v]`` per point in the same order, and
  ``[]`` for a point that it does not show. ``up`` is the up axis of the world, ``z`` by default.
* CSV: the columns ``camera, x_m, y_m, z_m, u_px, v_px``, a row per camera and point that it shows.
"""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import CalibrationError, FileError, choices
from posefuse.io.files import must_exist, read_toml, reading
from posefuse.model.scene_points import ScenePoints

_COLUMNS = ("camera", "x_m", "y_m", "z_m", "u_px", "v_px")
_POSE2SIM_KEY = "object_coords_3d"


def read_scene_points(path: str | Path) -> ScenePoints:
    """Read points of known position.

    Raises:
        FileError: if the file does not exist, or has no such points.
        CalibrationError: if the points are not consistent.
    """
    path = must_exist(Path(path), "file of scene points")
    try:
        if path.suffix.lower() == ".csv":
            with reading(path, "file of scene points"):
                return _from_csv(path)
        return _from_toml(path, read_toml(path))
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None


def _from_csv(path: Path) -> ScenePoints:
    with path.open(encoding="utf-8-sig", newline="") as stream:
        reader = csv.DictReader(stream)
        missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise FileError(f"{path} has no column {choices(missing)}; a file of scene points has {choices(_COLUMNS)}.")
        rows = [(row["camera"], [float(row[name]) for name in _COLUMNS[1:]]) for row in reader]
    if not rows:
        raise FileError(f"{path} has no rows: it must have one per camera and point.")
    values = np.array([numbers for _, numbers in rows])
    points, index = np.unique(values[:, :3], axis=0, return_inverse=True)
    names = [name for name, _ in rows]
    pixels = {name: np.full((len(points), 2), np.nan) for name in dict.fromkeys(names)}
    for name, point, place in zip(names, np.ravel(index), values[:, 3:], strict=True):
        if np.isfinite(pixels[name][point]).any():
            raise CalibrationError(
                f"Camera {name!r} shows the point {points[point].tolist()} twice. Remove one of the rows."
            )
        pixels[name][point] = place
    return ScenePoints(points, pixels, "z")


def _from_toml(path: Path, data: Mapping[str, Any]) -> ScenePoints:
    world, images = data.get("world_m"), data.get("image_px")
    if world is None or not isinstance(images, dict):
        raise FileError(
            f"{path} has no scene points: expected world_m (positions in meters, or the path of Pose2Sim's "
            f"Config.toml) and a table [image_px] with one [u, v] per point for each camera; it has {choices(data)}."
        )
    if isinstance(world, str):
        world = _from_pose2sim(path.parent / world)
    points = _numbers(path, "world_m", world, 3)
    pixels = {name: _numbers(path, f"image_px.{name}", places, 2) for name, places in images.items()}
    return ScenePoints(points, pixels, data.get("up", "z"))


def _numbers(path: Path, key: str, rows: Any, width: int) -> np.ndarray:
    """Return rows of numbers, NaN for empty rows."""
    out = np.full((len(rows) if isinstance(rows, list) else 0, width), np.nan)
    try:
        for i, row in enumerate(rows):
            if len(row):
                out[i] = row
    except (TypeError, ValueError):
        raise FileError(f"{path}: {key} must be a list with {width} numbers per point.") from None
    return out


def _from_pose2sim(path: Path) -> Any:
    """Return the positions in Pose2Sim's ``Config.toml``."""
    found = _find(read_toml(must_exist(path, "configuration of Pose2Sim")))
    if found is None:
        raise FileError(f"{path} has no {_POSE2SIM_KEY}, the positions of the scene points.")
    return found


def _find(table: Mapping[str, Any]) -> Any:
    """Return the positions in nested tables, or None."""
    if _POSE2SIM_KEY in table:
        return table[_POSE2SIM_KEY]
    inside = [_find(each) for each in table.values() if isinstance(each, dict)]
    return next((each for each in inside if each is not None), None)
