"""glTF 2.0 (``.glb``, or ``.gltf`` with embedded data): one animation skeleton per person, meters, y up, facing z.

Layout after the specification of the Khronos Group. The skin has the joints of the animation skeleton; its mesh has one
stick per bone, blue on the left and red on the right. One animation has the rotations of the joints and the translation
of the root at the times of the frames, relative to the start of the recording. Frames in which the person is absent
have no keys, and the skeleton is scaled to zero there, which hides interpolated poses.
"""

import base64
import json
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from posefuse.errors import ResultError
from posefuse.io.files import replacing
from posefuse.io.results.clips import (
    BODY_TO_Y_UP,
    Clip,
    Presence,
    check_presence,
    clip_of,
    hold_unknown,
    limitation_notes,
    motions,
    rest_root_m,
    to_file_axes,
)
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.sticks import Sticks, sticks_of
from posefuse.io.results.timing import export_rate
from posefuse.model.animation_figures import Figure, Motion
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress

_GAP_HANDLING = "the glTF has no keys there, and the skeleton is scaled to zero"
_COLORS = {"left": (0.10, 0.35, 0.80), "right": (0.80, 0.15, 0.12), "middle": (0.55, 0.55, 0.58)}
_COMPONENTS = {np.dtype(np.float32): 5126, np.dtype(np.uint32): 5125, np.dtype(np.uint16): 5123}
_TYPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_MAX_BYTES = 2**32 - 1
_CHUNK_BYTES = 3 * 2**18


def write(result: Reconstruction, person: str, path: Path, progress: Progress | None = None) -> list[str]:
    """Write one person, as a binary file (``.glb``) or as JSON (``.gltf``), depending on the ending of the path.

    Returns:
        Notes on what the file does not contain, in sentences.

    Raises:
        ResultError: if there is no fitted model, the person is never present, frames have no times, or the motion is
            too long.
    """
    return write_clip(result, clip_of(result, person), path, progress)


def write_clip(result: Reconstruction, clip: Clip, path: Path, progress: Progress | None = None) -> list[str]:
    """Write one clip; see :func:`write`."""
    check_presence(clip)
    content = _Content()
    document = _document(content, result, clip, _times(result))
    if content.size > _MAX_BYTES:
        size_gib = content.size / 2**30
        raise ResultError(
            f"The motion of {clip.figure.person} takes {size_gib:.1f} GiB; a glTF file can store at most 4. "
            "Reconstruct a shorter range with `end_s`."
        )
    what = f"writing {path.name}"
    with replacing(path) as temporary:
        if path.suffix.lower() == ".gltf":
            with replacing(temporary.with_suffix(".bin")) as numbers:
                _fill(content, numbers, 0)
                _fill_motion(content, numbers, 0, result, clip, motions(clip.body, result, progress, what))
                _write_text(temporary, document, numbers)
        else:
            start = _write_binary_header(temporary, document, content.size)
            _fill(content, temporary, start)
            _fill_motion(content, temporary, start, result, clip, motions(clip.body, result, progress, what))
    return list(limitation_notes(result, clip, _GAP_HANDLING))


def _times(result: Reconstruction) -> np.ndarray:
    """Return the times of the frames in s since the first one, shape (frame,)."""
    if np.isfinite(result.time_s).all() and (np.diff(result.time_s) > 0.0).all():
        return result.time_s - result.time_s[0]
    return (result.frame_numbers - result.frame_numbers[0]) / export_rate(result, "glTF")


@dataclass(frozen=True)
class _Block:
    """Data of an accessor: offset in the buffer and values, None for the motion."""

    start: int
    shape: tuple[int, ...]
    dtype: np.dtype
    values: np.ndarray | None


class _Content:
    """Data in the order of the buffer, with its views and accessors."""

    def __init__(self) -> None:
        self.blocks: list[_Block] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(self, values: np.ndarray, target: int | None = None, bounds: bool = False) -> int:
        """Add an accessor with values and return its index."""
        number = self.reserve(values.shape, values.dtype, target)
        self.blocks[number] = _Block(self.blocks[number].start, values.shape, values.dtype, values)
        if bounds:
            flat = values.reshape(len(values), -1)
            low, high = flat.min(axis=0).tolist(), flat.max(axis=0).tolist()
            self.accessors[number].update(min=low, max=high)
        return number

    def reserve(self, shape: tuple[int, ...], dtype: np.dtype, target: int | None = None) -> int:
        """Add an accessor whose values are written later, and return its index."""
        length = int(np.prod(shape)) * dtype.itemsize
        view = {"buffer": 0, "byteOffset": self.size, "byteLength": length}
        self.views.append(view if target is None else {**view, "target": target})
        accessor = {"bufferView": len(self.views) - 1, "componentType": _COMPONENTS[dtype], "count": shape[0]}
        self.accessors.append({**accessor, "type": _TYPES[shape[1:]]})
        self.blocks.append(_Block(self.size, shape, dtype, None))
        self.size += -(-length // 4) * 4
        return len(self.accessors) - 1


def _document(content: _Content, result: Reconstruction, clip: Clip, times: np.ndarray) -> dict[str, Any]:
    """Return the JSON of the file; the accessors of the motion are the last, in the order of ``_fill_motion``."""
    figure = clip.figure
    sticks = sticks_of(figure)
    joints = list(range(len(figure.joints)))
    inverse = np.tile(np.eye(4, dtype=np.float32), (len(joints), 1, 1))
    # Matrices are stored in column order.
    inverse[:, 3, :3] = -(figure.rest_m @ BODY_TO_Y_UP.T + rest_root_m(figure))
    skin = {"joints": joints, "skeleton": 0, "inverseBindMatrices": content.add(inverse)}
    materials = [
        {"name": side, "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0}}
        for side, color in _COLORS.items()
    ]
    primitives = [_primitive(content, sticks[side], i) for i, side in enumerate(_COLORS) if side in sticks]
    extras = {"person": figure.person, "layer": "model", "skeleton": result.skeleton.name}
    if result.rig.inferred_up is not None:
        extras["world_up"] = result.rig.up_text
    return {
        "asset": {"version": "2.0", "generator": "posefuse", "extras": extras},
        "scene": 0,
        "scenes": [{"name": figure.person, "nodes": [0, len(joints)]}],
        "nodes": [*_nodes(figure), {"name": figure.person, "mesh": 0, "skin": 0}],
        "meshes": [{"name": figure.person, "primitives": primitives}],
        "materials": materials,
        "skins": [{"name": figure.person, **skin}],
        "animations": [_animation(content, figure, clip.presence, times)],
        "bufferViews": content.views,
        "accessors": content.accessors,
        "buffers": [{"byteLength": content.size}],
    }


def _nodes(figure: Figure) -> list[dict[str, Any]]:
    offsets = figure.offsets_m @ BODY_TO_Y_UP.T
    offsets[0] = rest_root_m(figure)
    nodes: list[dict[str, Any]] = []
    for j, joint in enumerate(figure.joints):
        node = {"name": joint.name, "translation": (offsets[j] + 0.0).tolist()}
        children = figure.children(j)
        nodes.append({**node, "children": list(children)} if children else node)
    return nodes


def _primitive(content: _Content, sticks: Sticks, material: int) -> dict[str, Any]:
    joints = np.zeros((len(sticks.joints), 4), dtype=np.uint16)
    joints[:, 0] = sticks.joints
    weights = np.zeros((len(sticks.joints), 4), dtype=np.float32)
    weights[:, 0] = 1.0
    return {
        "attributes": {
            "POSITION": content.add(sticks.vertices_m.astype(np.float32), _ARRAY_BUFFER, bounds=True),
            "NORMAL": content.add(sticks.normals.astype(np.float32), _ARRAY_BUFFER),
            "JOINTS_0": content.add(joints, _ARRAY_BUFFER),
            "WEIGHTS_0": content.add(weights, _ARRAY_BUFFER),
        },
        "indices": content.add(np.arange(len(sticks.joints), dtype=np.uint32), _ELEMENT_BUFFER),
        "material": material,
    }


def _animation(content: _Content, figure: Figure, presence: Presence, times: np.ndarray) -> dict[str, Any]:
    visibility = _visibility_keys(presence, times)
    paths: list[tuple[int, str, int, int, str]] = []
    if visibility is not None:
        seconds, scales = visibility
        paths.append((0, "scale", content.add(seconds, bounds=True), content.add(scales), "STEP"))
    keys = content.add(times[presence.present].astype(np.float32), bounds=True)
    count, float32 = int(presence.present.sum()), np.dtype(np.float32)
    paths.append((0, "translation", keys, content.reserve((count, 3), float32), "LINEAR"))
    paths += [(j, "rotation", keys, content.reserve((count, 4), float32), "LINEAR") for j in figure.turning]
    return {
        "name": figure.person,
        "channels": [
            {"sampler": i, "target": {"node": node, "path": what}} for i, (node, what, *_) in enumerate(paths)
        ],
        "samplers": [{"input": before, "output": after, "interpolation": kind} for _, _, before, after, kind in paths],
    }


def _visibility_keys(presence: Presence, times: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return times in s and scales of shape (key, 3) that hide the absent person; None if always present."""
    present = presence.present
    if present.all():
        return None
    changes = np.flatnonzero(np.diff(present, prepend=not present[0]))
    scales = np.repeat(present[changes, None], 3, axis=1).astype(np.float32)
    return times[changes].astype(np.float32), scales


def _write_binary_header(path: Path, document: dict[str, Any], size: int) -> int:
    """Write a glb up to its data, and return the offset of the data."""
    text = _json(document)
    text += b" " * (-len(text) % 4)
    with path.open("wb") as file:
        file.write(struct.pack("<III", _MAGIC, 2, 12 + 8 + len(text) + 8 + size))
        file.write(struct.pack("<II", len(text), _JSON) + text)
        file.write(struct.pack("<II", size, _BIN))
        return file.tell()


def _json(document: dict[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode("utf-8")


def _fill(content: _Content, path: Path, start: int) -> None:
    """Write the values that do not depend on the motion, and reserve space for the others."""
    with path.open("r+b" if path.exists() else "w+b") as file:
        file.truncate(start + content.size)
        for block in content.blocks:
            if block.values is not None:
                _write_at(file, start + block.start, block.values)


def _write_at(file: BinaryIO, at: int, values: np.ndarray) -> None:
    file.seek(at)
    file.write(np.ascontiguousarray(values).tobytes())


def _fill_motion(
    content: _Content, path: Path, start: int, result: Reconstruction, clip: Clip, motion_ranges: Iterable[Motion]
) -> None:
    """Write translations and rotations, a range of frames at a time."""
    translation, *rotations = (block for block in content.blocks if block.values is None)
    turning = list(clip.figure.turning)
    before_turns = np.tile(np.eye(3), (len(clip.figure.joints), 1, 1))
    before = np.tile([0.0, 0.0, 0.0, 1.0], (len(turning), 1))
    done = 0
    with path.open("r+b") as file:
        for motion in motion_ranges:
            there = motion.there
            if not there.any():
                continue
            root, turns = to_file_axes(result, motion)
            turns = hold_unknown(turns[there], before_turns)
            before_turns = turns[-1]
            quaternions = _quaternions(turns[:, turning], before)
            before = quaternions[-1]
            _write_at(file, start + translation.start + 12 * done, root[there].astype(np.float32))
            for j, block in enumerate(rotations):
                _write_at(file, start + block.start + 16 * done, quaternions[:, j].astype(np.float32))
            done += len(quaternions)


def _quaternions(turns: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return quaternions x y z w, shape (frame, joint, 4), with signs that agree with the previous frame's.

    Programs interpolate linearly between keys, which requires consistent signs.
    """
    from scipy.spatial.transform import Rotation

    out = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat().reshape(*turns.shape[:2], 4)
    agree = np.einsum("fji,fji->fj", out, np.concatenate([before[None], out[:-1]]))
    return out * np.cumprod(np.where(agree < 0.0, -1.0, 1.0), axis=0)[..., None]


def _write_text(path: Path, document: dict[str, Any], numbers: Path) -> None:
    """Write a ``.gltf`` with its data embedded in base64."""
    mark = "NUMBERS"
    buffers = [{"uri": mark, **document["buffers"][0]}]
    head, tail = _json({**document, "buffers": buffers}).split(json.dumps(mark).encode())
    with path.open("wb") as file, numbers.open("rb") as source:
        file.write(head + b'"data:application/octet-stream;base64,')
        while chunk := source.read(_CHUNK_BYTES):
            file.write(base64.b64encode(chunk))
        file.write(b'"' + tail)


FORMAT = ResultFormat(
    name="gltf",
    files="<person>.glb (or .gltf)",
    conventions=(
        "meters, y up; rest pose faces z with arms out; skin and animation; articulated bodies; "
        "hidden while a person is absent"
    ),
    endings=(".glb", ".gltf"),
    write_figure=write,
)
