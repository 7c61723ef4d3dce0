"""The method votes."""

from dataclasses import replace

import numpy as np

from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.left_right.results import PairSequence
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.rigs import build_rig

from .conftest import assign, replace_pairs, select_frame


class TestVotes:
    def test_frames_are_independent(self, swapped):
        whole = assign(swapped.given, "votes")
        for t in (0, 17):
            one = select_frame(swapped.given, t)
            one = replace(one, confidence=swapped.given.confidence[t : t + 1])
            np.testing.assert_array_equal(assign(one, "votes").flipped[0], whole.flipped[t])

    def test_swapping_all_labels_mirrors_the_person(self, swapped):
        pairs = swapped.given.pairs
        mirrored = replace_pairs(swapped.given, used=np.where(pairs.used >= 0, 1 - pairs.used, -1).astype(np.int8))
        np.testing.assert_array_equal(assign(swapped.given, "votes").flipped, ~assign(mirrored, "votes").flipped)

    def test_detections_without_confidence_vote_as_with_equal_confidence(self, swapped):
        equal = replace(swapped.given, confidence=np.ones_like(swapped.given.confidence))
        without = replace(swapped.given, confidence=np.full_like(swapped.given.confidence, np.nan))
        other_side = np.where(without.pairs.used >= 0, 1 - without.pairs.used, -1).astype(np.int8)
        mirrored = replace_pairs(without, used=other_side)
        np.testing.assert_array_equal(assign(without, "votes").flipped, assign(equal, "votes").flipped)
        assert (assign(without, "votes").flipped | assign(mirrored, "votes").flipped).all()

    def test_votes_are_weighted_by_confidence_and_direction(self):
        """A confident view with the points side by side outweighs two views with one point behind the other."""
        rig = build_rig("ring", 4)
        points = np.array([[[[0.2, 0.0, 1.0], [-0.2, 0.0, 1.0]]]])
        used = np.array([[[[0, 1], [1, 0], [0, 1], [-1, -1]]]], dtype=np.int8)
        pairs = SolvedPairs(
            points, np.zeros((1, 1, 2, 6)), np.zeros((1, 1, 2)), used, np.zeros(used.shape), np.zeros(used.shape),
            np.zeros((1, 1, 4)), np.zeros((1, 1)),
        )  # fmt: skip
        skeleton = Skeleton("two", ("left_a", "right_a"), pairs=(("left_a", "right_a"),))
        sequence = PairSequence(pairs, skeleton, rig, np.zeros(1), np.full((1, 1, 1, 4, 2), 0.8))
        assert assign(sequence, "votes").flipped.all()
        unsure = np.array(sequence.confidence)
        unsure[..., 1, :] = 0.001
        assert not assign(replace(sequence, confidence=unsure), "votes").flipped.any()
