"""Assignment of detections to tracks."""

import numpy as np
import pytest

from posefuse.model.options.tracker import TrackerOptions
from posefuse.tracking.associate import suppress_single_view_matches


@pytest.mark.parametrize(
    ("gain", "rows", "lost", "after"),
    [
        # The only detection of the second track fits the first one better, which has its own in that view.
        ([[9.0, 8.0], [1.0, 4.0]], [[0, 2], [1, -1]], [False, False], [[0, 2], [-1, -1]]),
        # It fits the second track better.
        ([[9.0, 3.0], [1.0, 4.0]], [[0, 2], [1, -1]], [False, False], [[0, 2], [1, -1]]),
        # The first track has no detection in that view.
        ([[9.0, 8.0], [1.0, 4.0]], [[-1, 2], [1, -1]], [False, False], [[-1, 2], [1, -1]]),
        # Another view shows the second track, too.
        ([[9.0, 8.0, 9.0, 0.0], [1.0, 4.0, 0.0, 9.0]], [[0, 2], [1, 3]], [False, False], [[0, 2], [1, 3]]),
        # A single view does not update a lost track.
        ([[9.0, 1.0], [1.0, 9.0]], [[0, 2], [1, -1]], [False, True], [[0, 2], [-1, -1]]),
    ],
)
def test_weak_single_view_matches_are_dropped(gain, rows, lost, after):
    worth = np.full((2, 4), -np.inf)
    worth[:, : len(gain[0])] = gain
    rows = np.array(rows, dtype=np.int64)
    suppress_single_view_matches(rows, worth, np.array(lost), TrackerOptions())
    assert rows.tolist() == after
