"""BVH (Biovision): one animation skeleton per person, cm, y up; the rest pose faces z with arms out.

Layout after Meredith & Maddock 2001, "Motion Capture File Formats Explained". Every joint has three angles in degrees,
about z, x and y in this order (R = Rz Rx Ry); the root has its position before them. The file covers the frames from
the first to the last in which the person is tracked. The format cannot represent frames without a pose, so the last
pose is held while a person is absent or a hand is not tracked.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from posefuse.io.files import replacing
from posefuse.io.number_rows import number_rows
from posefuse.io.results.clips import (
    BODY_TO_Y_UP,
    Clip,
    check_presence,
    clip_of,
    hold_unknown,
    limitation_notes,
    motions,
    to_file_axes,
)
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.timing import export_rate, regular_rows
from posefuse.model.animation_figures import Figure, Motion
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress

_CM = 100.0
_DECIMALS = 6
"""Decimals of angles in degrees and positions in cm."""
_CHANNELS = "Zrotation Xrotation Yrotation"
_ROOT = "Xposition Yposition Zposition"
_GAP_HANDLING = "BVH cannot omit frames, so the last pose is held"


def write(result: Reconstruction, person: str, path: Path, progress: Progress | None = None) -> list[str]:
    """Write one person.

    Returns:
        Notes on what the file does not contain, in sentences.

    Raises:
        ResultError: if there is no fitted model, the person is never present, or the frame rate is unknown or not
            constant.
    """
    return write_clip(result, clip_of(result, person), path, progress)


def write_clip(result: Reconstruction, clip: Clip, path: Path, progress: Progress | None = None) -> list[str]:
    """Write one clip; see :func:`write`."""
    check_presence(clip)
    rate, presence, figure = export_rate(result, "BVH"), clip.presence, clip.figure
    row_indices, _ = regular_rows(result)
    rows = int(row_indices[presence.last] - row_indices[presence.first]) + 1
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write("HIERARCHY\n")
        file.writelines(_hierarchy(figure))
        file.write(f"MOTION\nFrames: {rows}\nFrame Time: {1.0 / rate:.10g}\n")
        motion_ranges = motions(clip.body, result, progress, f"writing {path.name}")
        for values in _rows(result, figure, motion_ranges, row_indices - row_indices[presence.first]):
            file.write(_text(values))
    notes = list(limitation_notes(result, clip, _GAP_HANDLING))
    if presence.first > 0:
        first = result.frame_numbers[presence.first]
        notes.insert(0, f"{figure.person}: the first frame of the BVH is frame {first} of the recording.")
    return notes


def _hierarchy(figure: Figure) -> Iterator[str]:
    offsets = _CM * figure.offsets_m @ BODY_TO_Y_UP.T
    # Some readers add the root's offset to its position, others do not.
    offsets[0] = 0.0
    yield from _joint(figure, offsets, 0, "")


def _joint(figure: Figure, offsets: np.ndarray, j: int, indent: str) -> Iterator[str]:
    yield f"{indent}{'JOINT' if j else 'ROOT'} {figure.joints[j].name}\n{indent}{{\n"
    deeper = indent + "  "
    yield f"{deeper}OFFSET {_three(offsets[j])}\n"
    yield f"{deeper}CHANNELS {f'3 {_CHANNELS}' if j else f'6 {_ROOT} {_CHANNELS}'}\n"
    children = figure.children(j)
    for child in children:
        yield from _joint(figure, offsets, child, deeper)
    if not children:
        # Every branch needs an end site; it continues in the direction of the last bone.
        yield f"{deeper}End Site\n{deeper}{{\n{deeper}  OFFSET {_three(0.2 * offsets[j])}\n{deeper}}}\n"
    yield f"{indent}}}\n"


def _three(values: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in values + 0.0)


def _rows(
    result: Reconstruction, figure: Figure, motion_ranges: Iterable[Motion], row_indices: np.ndarray
) -> Iterator[np.ndarray]:
    """Yield blocks of rows of shape (row, 3 + 3 joint); rows without a frame repeat the previous one."""
    order = _order(figure)
    before = np.tile(np.eye(3), (len(order), 1, 1))
    angles = np.zeros((len(order), 3))
    last: np.ndarray | None = None
    done = 0
    for motion in motion_ranges:
        present = np.flatnonzero(motion.there)
        start, done = done, done + motion.n_frames
        if not len(present):
            continue
        root, turns = to_file_axes(result, motion)
        turns = hold_unknown(turns[present], before)
        before = turns[-1]
        unwound = _unwrap_angles(_euler_zxy(turns[:, order]), angles)
        angles = unwound[-1]
        values = np.concatenate([_CM * root[present], np.degrees(unwound).reshape(len(present), -1)], axis=1)
        yield from _repeat_rows(values, row_indices[start + present], last)
        last = np.append(values[-1], row_indices[start + present[-1]])


def _repeat_rows(values: np.ndarray, row_indices: np.ndarray, last: np.ndarray | None) -> Iterator[np.ndarray]:
    """Yield each row repeated up to the next one; ``last`` is the previous row, followed by its index."""
    if last is not None:
        values, row_indices = np.concatenate([last[None, :-1], values]), np.append(int(last[-1]), row_indices)
        times = np.diff(row_indices, append=row_indices[-1] + 1)
        times[0] -= 1
    else:
        times = np.diff(row_indices, append=row_indices[-1] + 1)
    yield np.repeat(values, times, axis=0)


def _order(figure: Figure) -> list[int]:
    """Return the joints in the order of the file: depth first."""
    out: list[int] = []
    pending = [0]
    while pending:
        j = pending.pop()
        out.append(j)
        pending.extend(reversed(figure.children(j)))
    return out


def _euler_zxy(turns: np.ndarray) -> np.ndarray:
    """Return the angles about z, x, y of R = Rz Rx Ry, shape (..., 3), radians."""
    x = np.arcsin(np.clip(turns[..., 2, 1], -1.0, 1.0))
    z = np.arctan2(-turns[..., 0, 1], turns[..., 1, 1])
    y = np.arctan2(-turns[..., 2, 0], turns[..., 2, 2])
    locked = np.hypot(turns[..., 0, 1], turns[..., 1, 1]) < 1e-9
    # Gimbal lock: if x is 90 degrees, only the sum of the other angles is determined.
    z = np.where(locked, np.arctan2(turns[..., 1, 0], turns[..., 0, 0]), z)
    return np.stack([z, x, np.where(locked, 0.0, y)], axis=-1)


def _unwrap_angles(angles: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return equivalent angles nearest to those of the previous frame, which avoids jumps.

    Args:
        angles: shape (frame, joint, 3), radians.
        before: shape (joint, 3): angles of the frame before the first.
    """
    full = 2.0 * np.pi
    other = np.stack([angles[..., 0] + np.pi, np.pi - angles[..., 1], angles[..., 2] + np.pi], axis=-1)
    both = np.stack([angles, other])
    out = np.empty_like(angles)
    for f in range(len(angles)):
        near = both[:, f] + full * np.round((before - both[:, f]) / full)
        second = np.abs(near[1] - before).sum(axis=-1) < np.abs(near[0] - before).sum(axis=-1)
        out[f] = before = np.where(second[:, None], near[1], near[0])
    return out


def _text(values: np.ndarray) -> str:
    return number_rows(values, _DECIMALS, " ").decode()


FORMAT = ResultFormat(
    name="bvh",
    files="<person>.bvh",
    conventions=(
        "cm, y up; rest pose faces z with arms out; angles z x y; articulated bodies; the last "
        "pose is held while a person is absent"
    ),
    endings=(".bvh",),
    write_figure=write,
)
