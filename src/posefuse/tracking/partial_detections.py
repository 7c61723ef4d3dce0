"""People whom a detector gives twice, or in pieces: legs below a table by themselves, a trunk above it.

A view's matching gives each person one detection. Where that lacks keypoints and another one, which is nobody's, has
them where this person should have them, the two are pieces of one person. A second detection of the whole of somebody
must not be taken for somebody else, whom nothing else shows.
"""

import math
from dataclasses import replace

import numpy as np

from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.tracking.settings import Settings
from posefuse.tracking.stages import Likeness

_NEVER = 600.0
"""Log odds of what is never so; with more, probabilities are 0."""
_SURELY = 1.0 - 1e-12
_COMMON = 0.25
"""Two detections of one view are pieces if no more of the smaller one's keypoints are in both."""


def hold_back(rows: np.ndarray, gain: np.ndarray, lost: np.ndarray, options: TrackerOptions) -> None:
    """One view alone does not move somebody who is lost; nor anybody whom it shows by a second one of somebody else's.

    Args:
        rows: shape (track, view), in and out.
        gain: shape (track, row): what a match is worth.
        lost: shape (track,), bool: who is.
        options: of the tracker.
    """
    shown = (rows >= 0).sum(axis=1)
    rows[lost & (shown < options.reacquire_views)] = -1
    for p in np.flatnonzero(~lost & (shown == 1)).tolist():
        v = int(rows[p].argmax())
        theirs = gain[rows[:, v] >= 0, rows[p, v]]
        if theirs.max() > gain[p, rows[p, v]]:
            rows[p] = -1


def forget_swaps(swapped: np.ndarray, dt_s: float, options: TrackerOptions) -> None:
    """Limbs whose sides are exchanged change back in time, and others are exchanged; whether seen meanwhile or not.

    A Markov chain of two states that is exchanged for ``swap_lasts_s`` at a stretch.

    Args:
        swapped: shape (track, view, group), in and out: how probable it is that sides are exchanged.
        dt_s: since the last frame.
        options: of the tracker.
    """
    usual = 1.0 / (1.0 + math.exp(min(-options.swap_log_odds, _NEVER)))
    lasts = math.exp(-max(dt_s, 0.0) / options.swap_lasts_s)
    np.clip(usual + lasts * (swapped - usual), math.exp(-_NEVER), _SURELY, out=swapped)


def joined_pieces(frame: Frame, rows: np.ndarray, found: Likeness, settings: Settings) -> Frame:
    """The frame in which matched detections have the keypoints, too, of other pieces of the same people.

    Args:
        frame: what the views show.
        rows: shape (track, view): whose each detection is.
        found: how well detections go with people; sides of a piece that is joined go along.
        settings: of the tracker.

    Returns:
        The same frame where there is nothing to join.
    """
    free = found.explained.copy()
    free[rows[rows >= 0]] = False
    joined = frame
    for piece in np.flatnonzero(free).tolist():
        p = int(found.gain[:, piece].argmax())
        row = int(rows[p, frame.view[piece]])
        if row < 0:
            continue
        own, other = (np.isfinite(joined.keypoints_px[r, :, 0]) for r in (row, piece))
        if (own & other).sum() > _COMMON * min(own.sum(), other.sum()):
            continue
        lent = other & ~own
        keypoints_px, confidence = joined.keypoints_px.copy(), joined.confidence.copy()
        keypoints_px[row, lent], confidence[row, lent] = keypoints_px[piece, lent], confidence[piece, lent]
        joined = replace(joined, keypoints_px=keypoints_px, confidence=confidence)
        for sides in (found.swapped[p], found.swap_odds[p]):
            _lend_sides(sides, row, piece, own, settings)
    return joined


def _lend_sides(sides: np.ndarray, row: int, piece: int, own: np.ndarray, settings: Settings) -> None:
    """Sides of limbs of which the detection itself has no keypoint are those of the piece; shape (row, group)."""
    groups = settings.group_of
    known = np.bincount(groups[own & (groups >= 0)], minlength=settings.n_groups) > 0
    sides[row, ~known] = sides[piece, ~known]
