"""Compact storage of one track's states in a history."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from posefuse.kernels.linear_algebra.triangles import pack_triangle, unpack_triangles
from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState

_DROPPED_BITS = 20
"""Number of the last of the 52 stored binary digits of a covariance that are rounded away."""


@dataclass(frozen=True, eq=False)
class AssignedViews:
    """What the views show of one person in one frame.

    Attributes:
        rows: shape (view,), int64: assigned detections, -1 for none.
        used: shape (view, keypoint), bool: keypoints that the update used.
        keypoints_px: shape (view, node keypoint, 2): assigned keypoints of the body, NaN where there is none.
        confidence: shape (view, node keypoint).
    """

    rows: np.ndarray
    used: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True, eq=False)
class Entries:
    """States of one track in some frames, in order.

    Attributes:
        places: shape (frame,), int64: indices of the frames in the history.
        fresh: shape (frame,), bool: whether the filter was initialized in the frame.
        rows: shape (frame, view), int64: assigned detections, -1 for none.
        used: shape (frame, view, keypoint), bool: keypoints that the update used.
        life: shape (frame,), int8: :class:`TrackState`.
        missing_s: shape (frame,): time since the last support, in seconds.
        keypoints_px: shape (frame, view, node keypoint, 2), float32: assigned keypoints of the body, NaN where there is
            none.
        confidence: shape (frame, view, node keypoint), float32.
        root: shape (frame, 3); this and the following fields are those of the State.
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        shape: shape (frame, shape).
        velocity: shape (frame, pose).
        free: shape (frame,), int64.
        triangles: shape (number,): lower triangles of the covariances, without the rows of a fixed shape, rounded to 33
            binary digits: further ones do not compress.
    """

    places: np.ndarray
    fresh: np.ndarray
    rows: np.ndarray
    used: np.ndarray
    life: np.ndarray
    missing_s: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray
    root: np.ndarray
    turns: np.ndarray
    bones: np.ndarray
    shape: np.ndarray
    velocity: np.ndarray
    free: np.ndarray
    triangles: np.ndarray

    def __len__(self) -> int:
        return len(self.places)

    @classmethod
    def one(
        cls, place: int, fresh: bool, state: State, seen: AssignedViews, life: TrackState, missing_s: float
    ) -> "Entries":
        """Return the entry of one frame, with copies of the state of one person."""
        n, fixed = state.velocity.shape[1], 0 if state.free[0] else state.shape.shape[1]
        size = state.covariance.shape[1] - fixed
        triangle = np.empty(size * (size + 1) // 2)
        pack_triangle(state.covariance[0], n, fixed, triangle)
        _round_in_place(triangle)
        return cls(
            np.array([place]), np.array([fresh]), seen.rows[None].copy(), seen.used[None].copy(),
            np.array([life], dtype=np.int8), np.array([missing_s]), seen.keypoints_px[None].astype(np.float32),
            seen.confidence[None].astype(np.float32), state.root.copy(), state.turns.copy(),
            state.bones.copy(), state.shape.copy(), state.velocity.copy(), state.free.copy(), triangle,
        )  # fmt: skip

    @classmethod
    def joined(cls, parts: Sequence["Entries"]) -> "Entries":
        """Return consecutive entries as one."""
        if len(parts) == 1:
            return parts[0]
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def frames(self, start: int, stop: int) -> "Entries":
        """Return the frames ``start`` to ``stop`` of these."""
        n, h = self.velocity.shape[1], self.shape.shape[1]
        size = np.where(self.free != 0, 2 * n + h, 2 * n)
        ends = np.concatenate([[0], np.cumsum(size * (size + 1) // 2)])
        cut = {field.name: getattr(self, field.name)[start:stop] for field in fields(self)}
        cut["triangles"] = self.triangles[ends[start] : ends[stop]]
        return Entries(**cut)

    def within(self, start: int, stop: int) -> "Entries":
        """Return the frames from ``start`` to ``stop`` of the history."""
        first, last = np.searchsorted(self.places, (start, stop))
        return self.frames(int(first), int(last))

    def unbroken(self) -> list["Entries"]:
        """Return the parts in which every frame continues the one before."""
        begins = np.flatnonzero(self.fresh[1:] | (np.diff(self.places) != 1)) + 1
        edges = [0, *begins.tolist(), len(self)]
        return [self.frames(first, last) for first, last in pairwise(edges)]

    @property
    def state(self) -> State:
        """State with one entry per frame instead of per person."""
        n, h = self.velocity.shape[1], self.shape.shape[1]
        covariance = np.empty((len(self), 2 * n + h, 2 * n + h))
        unpack_triangles(self.triangles, self.free, n, h, covariance)
        return State(self.root, self.turns, self.bones, self.shape, self.velocity, covariance, self.free)


def _round_in_place(numbers: np.ndarray) -> None:
    """Round finite float64 numbers to fewer binary digits; half is rounded away from zero."""
    bits = numbers.view(np.int64)
    bits += 1 << (_DROPPED_BITS - 1)
    bits &= -(1 << _DROPPED_BITS)
