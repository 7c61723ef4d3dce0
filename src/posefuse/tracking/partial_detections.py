"""Merging of several detections that show parts of one person in one view.

A detector may show legs below a table and the trunk above it as two people. The assignment gives each person at most
one detection per view. If that detection lacks keypoints, and an unassigned one has them where this person should have
them, both are parts of one person.
"""

from dataclasses import replace

import numpy as np

from posefuse.model.frames import Frame
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import MatchScores


def merge_partial_detections(frame: Frame, rows: np.ndarray, scores: MatchScores, settings: TrackerSettings) -> Frame:
    """Return the frame with the keypoints of partial detections added to the assigned detections.

    Args:
        frame: The detections.
        rows: shape (track, view): assigned detections, -1 for none.
        scores: Scores of the assignment; updated in place: swaps of merged limbs.
        settings: Settings of the tracker.

    Returns:
        The same frame if there is nothing to merge.
    """
    free = scores.explained.copy()
    free[rows[rows >= 0]] = False
    merged, max_common = frame, settings.options.partial_detections.max_common_share
    for part in np.flatnonzero(free).tolist():
        p = int(scores.gain[:, part].argmax())
        row = int(rows[p, frame.view[part]])
        if row < 0:
            continue
        own, other = (np.isfinite(merged.keypoints_px[r, :, 0]) for r in (row, part))
        if (own & other).sum() > max_common * min(own.sum(), other.sum()):
            continue
        added = other & ~own
        keypoints_px, confidence = merged.keypoints_px.copy(), merged.confidence.copy()
        keypoints_px[row, added], confidence[row, added] = keypoints_px[part, added], confidence[part, added]
        merged = replace(merged, keypoints_px=keypoints_px, confidence=confidence)
        for sides in (scores.swapped[p], scores.swap_odds[p]):
            _copy_sides(sides, row, part, own, settings)
    return merged


def _copy_sides(sides: np.ndarray, row: int, part: int, own: np.ndarray, settings: TrackerSettings) -> None:
    """Copy the sides, shape (row, group), of limbs without a keypoint in the assigned detection from the part."""
    groups = settings.group_of
    known = np.bincount(groups[own & (groups >= 0)], minlength=settings.n_groups) > 0
    sides[row, ~known] = sides[part, ~known]
