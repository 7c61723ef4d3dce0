"""A layer of a result as a dataset of xarray or a table of pandas."""

from importlib import import_module
from typing import Any

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus

_POINT = ("time", "individual", "keypoint")


def to_xarray(result: Reconstruction, layer: LayerName | None = None) -> Any:
    """Return a layer as a dataset; see :meth:`posefuse.Reconstruction.to_xarray`."""
    xarray = _library("xarray")
    name, points = result.best_layer(layer)
    unit = result.unit
    variables = {
        "position": ((*_POINT, "space"), np.asarray(points.points_m[:]), {"units": unit}),
        "sd": ((*_POINT, "space"), points.sd_m, {"units": unit}),
        "status": (_POINT, np.asarray(points.status[:]), {"meanings": _meanings()}),
        "n_views": (_POINT, points.n_views),
        "reprojection_error": (_POINT, np.asarray(points.reprojection_error_px[:]), {"units": "px"}),
    }
    coordinates = {
        "time": ("time", result.time_s, {"units": "s"}),
        "frame": ("time", result.frame_numbers),
        "individual": list(result.person_ids),
        "keypoint": list(result.skeleton.keypoints),
        "space": ["x", "y", "z"],
    }
    angles = result.joint_angles
    if angles is not None:
        own = ("time", "individual", "angle")
        variables["joint_angle"] = (own, np.asarray(angles.degrees[:]), {"units": "degrees"})
        variables["joint_angle_sd"] = (own, np.asarray(angles.sd_deg[:]), {"units": "degrees"})
        coordinates["angle"] = list(angles.names)
        coordinates["convention"] = ("angle", list(angles.conventions))
    attributes = {"layer": name, "skeleton": result.skeleton.name, "rate_hz": result.rate_hz or np.nan}
    return xarray.Dataset(variables, coordinates, attributes)


def to_dataframe(result: Reconstruction, layer: LayerName | None = None) -> Any:
    """Return a layer as a table; see :meth:`posefuse.Reconstruction.to_dataframe`."""
    pandas = _library("pandas")
    name, points = result.best_layer(layer)
    shape = points.points_m.shape[:3]
    frame, person, keypoint = (index.ravel() for index in np.indices(shape))
    position, sd = np.asarray(points.points_m[:]).reshape(-1, 3), points.sd_m.reshape(-1, 3)
    columns: dict[str, Any] = {
        "frame": result.frame_numbers[frame],
        "time_s": result.time_s[frame],
        "person": pandas.Categorical.from_codes(person, list(result.person_ids)),
        "keypoint": pandas.Categorical.from_codes(keypoint, list(result.skeleton.keypoints)),
    }
    columns |= {f"{axis}_{result.unit}": position[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"sd_{axis}_{result.unit}": sd[:, i] for i, axis in enumerate("xyz")}
    columns["n_views"] = points.n_views.ravel()
    columns["reprojection_error_px"] = np.asarray(points.reprojection_error_px[:]).ravel()
    labels = {int(code): code.label for code in PointStatus}
    columns["status"] = pandas.Series(np.asarray(points.status[:]).ravel()).map(labels).astype("category")
    table = pandas.DataFrame(columns)
    table.attrs["layer"] = name
    return table


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise ResultError(f"This needs {name}, which is not installed. Run: pip install {name}") from None


def _meanings() -> str:
    return ", ".join(f"{int(code)} {code.label}" for code in PointStatus)
