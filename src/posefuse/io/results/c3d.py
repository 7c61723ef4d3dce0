"""C3D, by ezc3d: a file a person, mm, world axes, missing points with residual -1.

A point's residual is its standard deviation in mm (root mean square over the axes, steps of 0.1, at most 25.5); that of
a filled point is 0, by which the standard tells points that were not measured. Up to seven views set the standard's
camera bits; beyond, POSEFUSE:MEAN_VIEWS gives each keypoint's mean number of views.
More than 65,535 frames are written with the standard's extension, TRIAL:ACTUAL_END_FIELD; programs that do not know
it (ezc3d among them) read the first 65,535. ``c3d_reading`` reads.
"""

import struct
from pathlib import Path

import ezc3d
import numpy as np

from posefuse.errors import ResultError
from posefuse.io.files import replacing
from posefuse.io.results.c3d_reading import matches as matches
from posefuse.io.results.c3d_reading import read_points as read_points
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
    words = np.full((n_rows, len(names)), -1.0)
    index = result.person_ids.index(person)
    views = np.zeros(len(names))
    done = 0
    for part in watched(result.chunks(), result.n_frames, f"writing {path.name}", progress or Silent()):
        rows = places[done : done + part.n_frames]
        part_layer = part.layers[layer]
        xyz = np.asarray(part_layer.points_m)[:, index]
        points[:3, :, rows] = 1000.0 * np.moveaxis(xyz, 0, -1).transpose(1, 0, 2)
        used = is_used(np.asarray(part_layer.view_status)[:, index])
        words[rows] = _words(part_layer, index, used)
        views += used.sum(axis=(0, 2))
        done += part.n_frames
    points[3] = 1.0
    content["header"]["points"]["first_frame"] = _first_frame(result)
    content["data"]["points"] = points
    content.add_parameter("POSEFUSE", "LAYER", [layer])
    _add_list(content, "VIEWS", list(result.rig.names))
    _add_list(content, "MEAN_VIEWS", (views / max(result.n_frames, 1)).tolist())
    _add_screen(content, result.rig.up_axis)
    if n_rows > _FRAMES_OF_HEADER:
        _add_actual_fields(content, n_rows)
    with replacing(path) as temporary:
        content.write(str(temporary))
        _mend(temporary, words)


def _first_frame(result: Reconstruction) -> int:
    """The recording's own number of the first frame, where the header (16 bits) can hold it and the last."""
    first = int(result.frame_numbers[0])
    return first if first + result.n_frames < _FRAMES_OF_HEADER else 0


def _words(layer: Layer, index: int, used: np.ndarray) -> np.ndarray:
    """Shape (frame, keypoint): the format's fourth word of a point, -1 where missing.

    Its high byte are the cameras, the first the lowest bit; its low byte is the standard deviation in steps of 0.1 mm,
    0 where that is not known. Of points that were filled both are 0.

    Args:
        layer: the layer.
        index: of the person.
        used: shape (frame, keypoint, view).
    """
    deviation = 1000.0 * np.sqrt((layer.sd_m[:, index] ** 2).mean(axis=-1))
    steps = np.clip(np.round(np.nan_to_num(deviation, nan=1.0) / _RESIDUAL_STEP_MM), 1, 255)
    n_views = used.shape[-1]
    cameras = (used * 2 ** (8 + np.arange(n_views))).sum(axis=-1) if n_views <= _CAMERA_BITS else 0
    told = np.where(np.isfinite(deviation), steps, 0.0) + cameras
    filled = np.asarray(layer.source)[:, index] == Source.FILLED
    return np.where(layer.has_point[:, index], np.where(filled, 0.0, told), -1.0)


def _add_list(content: ezc3d.c3d, name: str, values: list[str] | list[float]) -> None:
    """A list as NAME, NAME2, ...: a parameter's axis counts to 255, as with LABELS and LABELS2."""
    for part, start in enumerate(range(0, len(values), _LONGEST_AXIS), 1):
        content.add_parameter("POSEFUSE", name if part == 1 else f"{name}{part}", values[start : start + _LONGEST_AXIS])


def _mend(path: Path, words: np.ndarray) -> None:
    """Write what ezc3d writes otherwise than the C3D user guide says.

    The guide has cameras in the high byte of a point's fourth word, below the sign, and the residual in the low one;
    ezc3d has them the other way round, so that other programs take residuals of more than 127 steps for missing points.
    The header has no POINT:SCALE (bytes 12 to 15) but -1, and strict readers compare.

    Args:
        path: the file.
        words: shape (frame, keypoint).
    """
    with path.open("r+b") as file:
        file.seek(12)
        file.write(struct.pack("<f", -_RESIDUAL_STEP_MM))
        file.seek(16)
        (block,) = struct.unpack("<H", file.read(2))
    if words.size:
        stored = np.memmap(path, "<f4", "r+", (block - 1) * 512, (*words.shape, 4))
        stored[..., 3] = words
        stored.flush()


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
