"""Association scores on frames worked out by hand."""

import numpy as np
import pytest
from benchmarks.association_scores import score_association

from posefuse.errors import ResultError

PERSON = np.array([[0.0, 0, 0], [0, 0, 0.5]])


def at(*x: float) -> np.ndarray:
    return np.array([PERSON + np.array([each, 0, 0]) for each in x]).reshape(-1, 2, 3)


def views(*n: int) -> np.ndarray:
    return np.repeat(np.array(n, dtype=int)[:, None], 2, axis=1)


def test_scores_of_two_frames_match_hand_computed_values():
    """The oracle matches three of four people, the proposals two of these; one proposal is false."""
    truth = [at(0.0, 2.0), at(0.0, 2.0)]
    oracle = [at(0.06, 2.08), at(0.06, np.nan)]
    proposals = [at(0.05, 9.0), at(0.1, 2.2)]
    actual = score_association(proposals, truth, oracle, [views(3, 2), views(3, 1)])
    assert (actual.n_true, actual.n_oracle, actual.n_proposals) == (4, 3, 4)
    assert (actual.recall, actual.oracle_recall) == (3 / 4, 3 / 4)
    assert actual.relative_recall == pytest.approx(2 / 3)
    assert actual.false_share == 1 / 4
    assert actual.error_mm == pytest.approx(75)
    assert actual.error_mm_by_views == {2: pytest.approx(np.nan, nan_ok=True), 3: pytest.approx(75)}
    assert actual.oracle_error_mm_by_views == {2: pytest.approx(80), 3: pytest.approx(60)}


def test_person_without_truth_is_not_a_false_positive():
    truth, oracle = [at(0.0)], [at(0.0)]
    original = score_association([at(0.0, 5.0)], truth, oracle, [views(3)], [np.array([True, False])])
    assert original.false_share == 0


def test_excluded_keypoints_are_ignored():
    truth, oracle = [at(0.0)], [at(0.0)]
    proposal = at(0.0)
    proposal[0, 1, 0] = 0.3
    actual = score_association([proposal], truth, oracle, [views(2)], compared=[0])
    assert (actual.error_mm, actual.recall) == (0, 1)


def test_one_proposal_matches_one_person():
    actual = score_association([at(0.1)], [at(0.0, 0.2)], [at(0.0, 0.2)], [views(2, 2)])
    assert actual.recall == 1 / 2


def test_frames_without_people():
    empty = np.empty((0, 2, 3))
    actual = score_association([empty, at(1.0)], [at(0.0), empty], [at(0.0), empty], [views(2), views()])
    assert (actual.recall, actual.false_share) == (0, 1)
    with pytest.raises(ResultError, match="one entry per frame"):
        score_association([empty], [at(0.0), empty], [at(0.0), empty], [views(2), views()])
