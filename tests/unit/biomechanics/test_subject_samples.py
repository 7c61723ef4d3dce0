"""Frames from which a person is estimated."""

import numpy as np

from posefuse.biomechanics.subject_samples import CandidateFrames


def test_candidates_do_not_keep_the_ranges_that_they_come_from_in_memory():
    candidates, ranges = CandidateFrames(1000), []
    for start in range(0, 1000, 100):
        ranges.append((np.full((100, 20, 3), float(start)), np.ones((100, 20, 6))))
        candidates.add(start, *ranges[-1])
    numbers, points, _ = candidates.chosen()
    assert len(numbers) > 200
    np.testing.assert_array_equal(points[:, 0, 0], numbers // 100 * 100)
    kept = [*candidates._points, *candidates._covariances]
    assert not any(np.shares_memory(each, given) for each in kept for some in ranges for given in some)
