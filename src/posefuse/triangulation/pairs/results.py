"""What a two-point solve found: for every pair two points, not yet told apart as left and right."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SolvedPairs:
    """Two points of every pair, ``person_frame = frame * people + person``.

    Attributes:
        points_m: shape (person_frame, pair, 2, 3), NaN where missing.
        covariance_m2: shape (person_frame, pair, 2, 6): xx, xy, xz, yy, yz, zz.
        status: shape (person_frame, pair, 2), int8: point codes.
        used: shape (person_frame, pair, 2, view), int8: which label's observation each point rests on in the view, 0
            the left label's, 1 the right's, -1 none.
        view_error_px: shape (person_frame, pair, 2, view), float32.
        evidence: shape (person_frame, pair, view), float32: the bounded cost of the view as labelled, the first point
            being the left one, less that of the labels swapped, in squared sigmas; 0 where the view says nothing.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    used: np.ndarray
    view_error_px: np.ndarray
    evidence: np.ndarray
