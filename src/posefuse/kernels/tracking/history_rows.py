"""Rows of a history: the state of one person in one frame, and what the views show of that person."""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel
from posefuse.kernels.linear_algebra.triangles import pack_triangle
from posefuse.kernels.tracking.update import copy_rotations, copy_vector

_DROPPED_BITS = 20
"""Number of the last of the 52 stored binary digits of a covariance that are rounded away."""

_HALF, _KEPT = 1 << (_DROPPED_BITS - 1), -(1 << _DROPPED_BITS)


class RowHeads(NamedTuple):
    """What identifies the rows of some people in one frame.

    Attributes:
        place: index of the frame in the history.
        number: shape (person,), int64: numbers of the tracks.
        fresh: shape (person,), bool: whether the filter was initialized in the frame.
        life: shape (person,), int8: states of the tracks.
        missing_s: shape (person,): time since the last support, in seconds.
    """

    place: int
    number: Any
    fresh: Any
    life: Any
    missing_s: Any


class SeenPeople(NamedTuple):
    """What the views show of some people in one frame.

    Attributes:
        rows: shape (person, view), int64: assigned detections, -1 for none.
        used: shape (person, view, keypoint), bool: keypoints that the update used.
        track: shape (person,), int64: index of the person in the following arrays, -1 for none.
        matched: shape (track, view), int64: detections whose keypoints are the person's, -1 for none.
        labels: shape (track, view, keypoint), int64: which of a detection's keypoints is the body's, -1 for none.
        keypoints_px: shape (row, keypoint, 2).
        confidence: shape (row, keypoint).
        node_keypoints: shape (node keypoint,), int64: keypoints that the body has.
    """

    rows: Any
    used: Any
    track: Any
    matched: Any
    labels: Any
    keypoints_px: Any
    confidence: Any
    node_keypoints: Any


class HistoryRows(NamedTuple):
    """Rows of a history, in any order of tracks; those that are not written yet hold undefined values.

    The other fields are those of :class:`posefuse.tracking.history_entries.Entries`, with one entry per row.

    Attributes:
        number: shape (row,), int64: number of the track.
        triangles: shape (row, number): lower triangle of the covariance as in entries; without the rows of a fixed
            shape, the rest is 0.
    """

    number: Any
    places: Any
    fresh: Any
    rows: Any
    used: Any
    life: Any
    missing_s: Any
    keypoints_px: Any
    confidence: Any
    root: Any
    turns: Any
    bones: Any
    shape: Any
    velocity: Any
    free: Any
    triangles: Any


@kernel
def write_rows(first, heads, state, seen, out):
    """Write the rows of some people in one frame.

    Args:
        first: index of the first row.
        heads: RowHeads.
        state: State of these people.
        seen: SeenPeople.
        out: HistoryRows, written.
    """
    n = state.velocity.shape[1]
    bits = out.triangles.view(np.int64)
    for p in range(heads.number.shape[0]):
        i = first + p
        out.number[i] = heads.number[p]
        out.places[i] = heads.place
        out.fresh[i] = heads.fresh[p]
        out.life[i] = heads.life[p]
        out.missing_s[i] = heads.missing_s[p]
        # Assigned slices would take five times as long to compile, because Numba broadcasts them.
        copy_vector(seen.rows[p], out.rows[i])
        copy_vector(state.root[p], out.root[i])
        copy_rotations(state.turns[p], out.turns[i])
        copy_rotations(state.bones[p], out.bones[i])
        copy_vector(state.shape[p], out.shape[i])
        copy_vector(state.velocity[p], out.velocity[i])
        out.free[i] = state.free[p]
        n_fixed = 0 if state.free[p] != 0 else state.shape.shape[1]
        size = state.covariance.shape[1] - n_fixed
        pack_triangle(state.covariance[p], n, n_fixed, out.triangles[i])
        for j in range(size * (size + 1) // 2):
            # Half is rounded away from zero.
            bits[i, j] = (bits[i, j] + _HALF) & _KEPT
        for v in range(seen.rows.shape[1]):
            copy_vector(seen.used[p, v], out.used[i, v])
            row = seen.matched[seen.track[p], v] if seen.track[p] >= 0 else -1
            for j in range(seen.node_keypoints.shape[0]):
                label = seen.labels[seen.track[p], v, seen.node_keypoints[j]] if row >= 0 else -1
                if label >= 0:
                    out.keypoints_px[i, v, j, 0] = seen.keypoints_px[row, label, 0]
                    out.keypoints_px[i, v, j, 1] = seen.keypoints_px[row, label, 1]
                    out.confidence[i, v, j] = seen.confidence[row, label]
                else:
                    out.keypoints_px[i, v, j, 0] = math.nan
                    out.keypoints_px[i, v, j, 1] = math.nan
                    out.confidence[i, v, j] = math.nan
