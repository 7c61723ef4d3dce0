"""C3D, by ezc3d: a file a person, mm, world axes, missing points with residual -1.

A point's residual is its standard deviation in mm (root mean square over the axes, steps of 0.1, at most 25); that of a
filled point is 0, by which the standard tells points that were not measured. Up to
seven views set the standard's camera bits; beyond, POSEFUSE:MEAN_VIEWS gives each keypoint's mean number of views.
More than 65,535 frames are written with the standard's extension, TRIAL:ACTUAL_END_FIELD; programs that do not know
it (ezc3d among them) read the first 65,535.
"""

import struct
from pathlib import Path

import ezc3d
import numpy as np

from posefuse.errors import ResultError
from posefuse.io.files import replacing
from posefuse.io.results.timing import export_rate, regular_rows
from posefuse.model.cameras import UpAxis
from posefuse.model.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import Source, is_used
from posefuse.progress import Progress, Silent, watched

_CAMERA_BITS = 7
_RESIDUAL_STEP_MM = 0.1
_FRAMES_OF_HEADER = 65535
_INTEGER = 2
_LONGEST_AXIS = 255
# What is to the right of a viewer who looks at the world with up upwards.
_SCREEN_X: dict[UpAxis, str] = {"z": "+X", "y": "+X", "x": "+Y", "-z": "+X", "-y": "+X", "-x": "+Y"}


def write(result: Reconstruction, person: str, path: Path, layer: LayerName, progress: Progress | None = None) -> None:
    """Write one person.

    Raises:
        ResultError: if the frame rate is unknown or uneven, or there is no such person.
    """
    rate = export_rate(result, "C3D")
    if result.unit != "m":
        raise ResultError(f"A C3D file is in mm; this result is in {result.unit} (one camera's image plane). Use TRC.")
    places, n_rows = regular_rows(result)
    content = ezc3d.c3d()
    names = result.skeleton.keypoints
    point = content["parameters"]["POINT"]
    point["RATE"]["value"] = [rate]
    point["UNITS"]["value"] = ["mm"]
    point["LABELS"]["value"] = list(names)
    point["SCALE"]["value"] = [-_RESIDUAL_STEP_MM]
    points = np.full((4, len(names), n_rows), np.nan)
    residuals = np.full((1, len(names), n_rows), -1.0)
    bits = np.zeros((_CAMERA_BITS, len(names), n_rows), dtype=bool)
    index = result.person_ids.index(person)
    views = np.zeros(len(names))
    done = 0
    for part in watched(result.chunks(), result.n_frames, f"writing {path.name}", progress or Silent()):
        rows = places[done : done + part.n_frames]
        part_layer = part.layers[layer]
        xyz = np.asarray(part_layer.points_m)[:, index]
        points[:3, :, rows] = 1000.0 * np.moveaxis(xyz, 0, -1).transpose(1, 0, 2)
        residuals[0][:, rows] = _residuals(part_layer, index).T
        used = is_used(np.asarray(part_layer.view_status)[:, index])
        if used.shape[-1] <= _CAMERA_BITS:
            bits[: used.shape[-1], :, rows] = np.moveaxis(used, 0, -1).transpose(1, 0, 2)
        views += used.sum(axis=(0, 2))
        done += part.n_frames
    points[3] = 1.0
    content["header"]["points"]["first_frame"] = _first_frame(result)
    content["data"]["points"] = points
    content["data"]["meta_points"] = {"residuals": residuals, "camera_masks": bits}
    content.add_parameter("POSEFUSE", "LAYER", [layer])
    _add_list(content, "VIEWS", list(result.rig.names))
    _add_list(content, "MEAN_VIEWS", (views / max(result.n_frames, 1)).tolist())
    _add_screen(content, result.rig.up_axis)
    if n_rows > _FRAMES_OF_HEADER:
        _add_actual_fields(content, n_rows)
    with replacing(path) as temporary:
        content.write(str(temporary))
        _write_header_scale(temporary)


def _first_frame(result: Reconstruction) -> int:
    """The recording's own number of the first frame, where the header (16 bits) can hold it and the last."""
    first = int(result.frame_numbers[0])
    return first if first + result.n_frames < _FRAMES_OF_HEADER else 0


def _residuals(layer: Layer, index: int) -> np.ndarray:
    """Shape (frame, keypoint): standard deviation in mm, 0 where filled or unknown, -1 where missing."""
    deviation = 1000.0 * np.sqrt((layer.sd_m[:, index] ** 2).mean(axis=-1))
    # ezc3d cuts to whole steps: hand it the middle of the nearest. Zero would mean that nothing is known.
    steps = np.clip(np.round(np.nan_to_num(deviation, nan=1.0) / _RESIDUAL_STEP_MM), 1, 254)
    told = np.isfinite(deviation) & (np.asarray(layer.source)[:, index] != Source.FILLED)
    known = np.where(told, (steps + 0.01) * _RESIDUAL_STEP_MM, 0.0)
    return np.where(layer.has_point[:, index], known, -1.0)


def _add_list(content: ezc3d.c3d, name: str, values: list[str] | list[float]) -> None:
    """A list as NAME, NAME2, ...: a parameter's axis counts to 255, as with LABELS and LABELS2."""
    for part, start in enumerate(range(0, len(values), _LONGEST_AXIS), 1):
        content.add_parameter("POSEFUSE", name if part == 1 else f"{name}{part}", values[start : start + _LONGEST_AXIS])


def _write_header_scale(path: Path) -> None:
    """Put POINT:SCALE into the header too (bytes 12 to 15): ezc3d leaves -1 there, and strict readers compare."""
    with path.open("r+b") as file:
        file.seek(12)
        file.write(struct.pack("<f", -_RESIDUAL_STEP_MM))


def _add_screen(content: ezc3d.c3d, up: UpAxis | None) -> None:
    if up is None:
        return
    content.add_parameter("POINT", "X_SCREEN", [_SCREEN_X[up]])
    content.add_parameter("POINT", "Y_SCREEN", [up.upper() if up.startswith("-") else f"+{up.upper()}"])


def _add_actual_fields(content: ezc3d.c3d, n_rows: int) -> None:
    for name, frame in (("ACTUAL_START_FIELD", 1), ("ACTUAL_END_FIELD", n_rows)):
        words = [frame % 65536, frame // 65536]
        content.add_parameter("TRIAL", name, [float(word) for word in words])
        parameter = content["parameters"]["TRIAL"][name]
        parameter["type"] = _INTEGER
        parameter["value"] = np.array(words)
