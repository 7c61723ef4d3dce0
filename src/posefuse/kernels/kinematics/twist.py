"""Rotations of bones with a twist, from the plane in which neighboring bones bend."""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel, subroutine

_OPPOSITE = -1.0 + 1e-9
"""Cosine below which two directions are opposite, and the least rotation between them is any half turn."""


class BoneTable(NamedTuple):
    """Bones of a tree, carriers first.

    Attributes:
        bones: shape (bone, 6), int64: index, carrying bone and segment (-1 for none), the two bones whose plane shows
            the twist (-1 for none), and the sense in which they bend: 1, -1, or 0 if unknown.
        rest: shape (bone, 3, 3): axes at rest, relative to those of the carrier.
    """

    bones: Any
    rest: Any


@subroutine
def _least_turn(start, end, turn):
    """Write the least rotation between unit vectors; some half turn if they are opposite."""
    cosine = start[0] * end[0] + start[1] * end[1] + start[2] * end[2]
    if cosine < _OPPOSITE:
        least = 0
        for i in range(1, 3):
            if abs(start[i]) < abs(start[least]):
                least = i
        scale = 1.0 / math.sqrt(1.0 - start[least] * start[least])
        one, other = (least + 1) % 3, (least + 2) % 3
        for i in range(3):
            across = scale * (start[other] if i == one else (-start[one] if i == other else 0.0))
            for j in range(3):
                second = scale * (start[other] if j == one else (-start[one] if j == other else 0.0))
                turn[i, j] = 2.0 * across * second - (1.0 if i == j else 0.0)
        return
    x = start[1] * end[2] - start[2] * end[1]
    y = start[2] * end[0] - start[0] * end[2]
    z = start[0] * end[1] - start[1] * end[0]
    share = 1.0 / (1.0 + cosine)
    turn[0, 0] = 1.0 - share * (y * y + z * z)
    turn[1, 1] = 1.0 - share * (x * x + z * z)
    turn[2, 2] = 1.0 - share * (x * x + y * y)
    turn[0, 1] = share * x * y - z
    turn[1, 0] = share * x * y + z
    turn[0, 2] = share * x * z + y
    turn[2, 0] = share * x * z - y
    turn[1, 2] = share * y * z - x
    turn[2, 1] = share * y * z + x


@subroutine
def _multiply(left, right, out):
    """Compute ``out = left right``, 3x3 each."""
    for i in range(3):
        for j in range(3):
            out[i, j] = left[i, 0] * right[0, j] + left[i, 1] * right[1, j] + left[i, 2] * right[2, j]


@subroutine
def _twist(directions, first, then, sense, straight, bent, least):
    """Return the observed twist of a bone relative to its least rotation, and the share to which it counts."""
    ax, ay, az = directions[first, 0], directions[first, 1], directions[first, 2]
    bx, by, bz = directions[then, 0], directions[then, 1], directions[then, 2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = math.sqrt(x * x + y * y + z * z)
    share = (math.atan2(size, ax * bx + ay * by + az * bz) - straight) / (bent - straight)
    scale = 1.0 / max(size, 1e-12)
    along_first = scale * (x * least[0, 0] + y * least[1, 0] + z * least[2, 0])
    along_second = scale * (x * least[0, 1] + y * least[1, 1] + z * least[2, 1])
    if sense < 0 or (sense == 0 and not along_second >= 0.0):
        along_first, along_second = -along_first, -along_second
    # Comparisons with NaN are false, so an unknown direction stays unknown.
    if share < 0.0:
        share = 0.0
    if share > 1.0:
        share = 1.0
    return math.atan2(-along_first, along_second), share


@kernel
def twist_bones(table, turns, directions, straight, bent, frames, unseen):
    """Compute rotations of bones with a twist.

    Args:
        table: BoneTable.
        turns: shape (pose, segment, 3, 3): world from segment.
        directions: shape (pose, bone, 3): unit vectors, NaN where unknown.
        straight: bend in radians up to which the twist is that of the least rotation.
        bent: bend from which the plane of the bend defines the twist.
        frames: shape (pose, bone, 3, 3), written: world from bone.
        unseen: shape (pose, bone), bool, written: whether the twist is unobserved.
    """
    standing, turn, least = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for p in range(directions.shape[0]):
        for n in range(table.bones.shape[0]):
            bone = table.bones[n, 0]
            before, segment = table.bones[n, 1], table.bones[n, 2]
            if before >= 0:
                _multiply(frames[p, before], table.rest[n], standing)
            elif segment >= 0:
                _multiply(turns[p, segment], table.rest[n], standing)
            else:
                for i in range(3):
                    for j in range(3):
                        standing[i, j] = table.rest[n, i, j]
            _least_turn(standing[:, 2], directions[p, bone], turn)
            _multiply(turn, standing, least)
            angle, share = 0.0, 0.0
            if table.bones[n, 3] >= 0:
                angle, share = _twist(
                    directions[p], table.bones[n, 3], table.bones[n, 4], table.bones[n, 5], straight, bent, least
                )
            unseen[p, bone] = not share >= 1.0
            c, s = math.cos(share * angle), math.sin(share * angle)
            for i in range(3):
                frames[p, bone, i, 0] = c * least[i, 0] + s * least[i, 1]
                frames[p, bone, i, 1] = c * least[i, 1] - s * least[i, 0]
                frames[p, bone, i, 2] = least[i, 2]
