"""Arrays that the pair kernels write into, and their result."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from posefuse.kernels.left_right.records import PairPoints
from posefuse.model.status import PointStatus
from posefuse.model.tracks import Tracks, TrackState


@dataclass(frozen=True, eq=False)
class SolvedPairs:
    """Hold both points of every pair of keypoints; ``person_frame = frame * people + person``.

    The first point of a pair is the one that most labels, weighted by confidence, call left. The assignment of left and
    right decides which one is the left one.

    Attributes:
        points_m: shape (person_frame, pair, 2, 3), NaN where missing.
        covariance_m2: shape (person_frame, pair, 2, 6), xx xy xz yy yz zz, NaN where missing.
        status: shape (person_frame, pair, 2), int8, :class:`PointStatus`.
        used: shape (person_frame, pair, view, 2), int8: label of the observation that each point rests on in the view,
            0 left, 1 right, -1 none.
        view_error_px: shape (person_frame, pair, view, 2), float32: reprojection error of that observation; NaN where
            there is none.
        view_status: shape (person_frame, pair, view, 2), int8, :class:`ViewStatus` of the observation of each label,
            regardless of the point it was assigned to.
        evidence: shape (person_frame, pair, view), float32: bounded cost of the view as labeled minus that of the view
            swapped, in squared standard deviations: positive where labels look swapped; 0 without information.
        cost: shape (person_frame, pair): bounded cost of both points over all views, in squared standard deviations;
            NaN where the method has none.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    used: np.ndarray
    view_error_px: np.ndarray
    view_status: np.ndarray
    evidence: np.ndarray
    cost: np.ndarray

    @classmethod
    def allocate(cls, person_frames: int, n_pairs: int, views: int) -> Self:
        """Allocate uninitialized arrays."""
        shape = (person_frames, n_pairs)
        return cls(
            points_m=np.empty((*shape, 2, 3)),
            covariance_m2=np.empty((*shape, 2, 6)),
            status=np.empty((*shape, 2), dtype=np.int8),
            used=np.empty((*shape, views, 2), dtype=np.int8),
            view_error_px=np.empty((*shape, views, 2), dtype=np.float32),
            view_status=np.empty((*shape, views, 2), dtype=np.int8),
            evidence=np.empty((*shape, views), dtype=np.float32),
            cost=np.empty(shape),
        )

    @property
    def arrays(self) -> PairPoints:
        """Return the arrays as kernels take them."""
        return PairPoints(*(getattr(self, field.name) for field in fields(self)))

    def finish(self, tracks: Tracks) -> Self:
        """Return the result; points of absent people have the status absent."""
        absent = (np.asarray(tracks.state[:]) == TrackState.ABSENT).reshape(-1)
        self.status[absent] = PointStatus.ABSENT
        return self
