"""The method chains."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.left_right.results import PairSequence
from posefuse.skeleton.skeletons import Skeleton

from .conftest import Scene, assign, exchange_points, replace_pairs, simulate_walk


class TestChains:
    @pytest.mark.parametrize(("cameras", "most"), [(8, 0.005), (5, 0.01), (3, 0.02)])
    @pytest.mark.parametrize("law", ["chain", "pair", "body"])
    def test_left_and_right_are_correct(self, law, cameras, most):
        data = simulate_walk(law, cameras, skeleton="halpe_26")
        assert data.wrong(assign(data.given)).mean() <= most
        votes = data.wrong(assign(data.given, "votes")).mean()
        assert votes > 0.03

    def test_unreliable_views_have_little_weight(self):
        data = simulate_walk("chain", 8)
        rng = np.random.default_rng(3)
        evidence = np.array(data.given.pairs.evidence)
        flips = rng.random((len(evidence), 1, 4)) < 0.5
        evidence[..., :4] = np.where(flips, -evidence[..., :4], evidence[..., :4])
        assert data.wrong(assign(replace_pairs(data.given, evidence=evidence))).mean() < 0.01

    def test_no_flips_without_swaps(self):
        data = simulate_walk(share=0.0)
        sides = assign(data.given)
        assert not sides.flipped.any()
        assert (sides.chain_swapped[..., 1:] <= 0).all()
        # Noise alone swaps eyes that are above each other in a view.
        assert (sides.chain_swapped[..., 0] == 1).mean() < 0.01

    def test_no_flips_of_single_frames(self):
        data = simulate_walk("pair", 3)
        wrong = data.wrong(assign(data.given))
        assert not ((wrong[1:-1] != wrong[:-2]) & (wrong[1:-1] != wrong[2:])).any()

    def test_swapped_views_are_identified(self, swapped):
        sides = assign(swapped.given)
        assert sides.chains == ("face", "arm", "leg")
        for chain, first in (("arm", "left_shoulder"), ("leg", "left_hip")):
            pair = [left for left, _ in swapped.given.skeleton.pairs].index(first)
            actual = sides.chain_swapped[:, 0, :, sides.chains.index(chain)]
            reference = actual >= 0
            assert reference.mean() > 0.95
            assert ((actual == 1) == swapped.swapped[:, :, pair])[reference].mean() > 0.98

    def test_result_is_independent_of_the_order_of_points(self, swapped, rng):
        which = rng.random((swapped.given.n_frames, 8)) < 0.3
        one, other = assign(swapped.given), assign(exchange_points(swapped.given, which))
        np.testing.assert_array_equal(one.flipped[:, 0], other.flipped[:, 0] ^ which)
        np.testing.assert_array_equal(one.chain_swapped, other.chain_swapped)

    def test_result_is_independent_of_the_order_of_views(self, swapped):
        order = np.array([3, 0, 4, 2, 1])
        sequence, pairs = swapped.given, swapped.given.pairs
        other = replace_pairs(
            replace(sequence, rig=sequence.rig.select([sequence.rig.names[v] for v in order])),
            used=pairs.used[:, :, order], evidence=pairs.evidence[..., order],
        )  # fmt: skip
        one, two = assign(sequence), assign(other)
        np.testing.assert_array_equal(one.flipped, two.flipped)
        np.testing.assert_array_equal(one.chain_swapped[:, :, order], two.chain_swapped)

    def test_result_is_independent_of_the_world_pose(self, swapped):
        turn, shift = Rotation.random(random_state=1).as_matrix(), np.array([3.0, -7.0, 2.0])
        pairs = swapped.given.pairs
        full = turn @ pairs.covariance_m2[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]] @ turn.T
        moved = replace_pairs(
            replace(swapped.given, midline_m=swapped.given.midline_m @ turn.T + shift),
            points_m=pairs.points_m @ turn.T + shift,
            covariance_m2=full[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]],
        )
        np.testing.assert_array_equal(assign(swapped.given).flipped, assign(moved).flipped)

    def test_result_is_independent_of_the_scale(self, swapped):
        sequence, pairs = swapped.given, swapped.given.pairs
        small = replace_pairs(
            replace(sequence, midline_m=0.05 * sequence.midline_m),
            points_m=0.05 * pairs.points_m, covariance_m2=0.05**2 * pairs.covariance_m2,
        )  # fmt: skip
        assert (assign(sequence).flipped == assign(small).flipped).mean() > 0.999

    def test_swapping_all_labels_mirrors_the_person(self, swapped):
        """Without the nose, only labels distinguish the two mirror images."""
        sequence = replace(swapped.given, midline_m=None)
        mirrored = replace_pairs(sequence, evidence=-sequence.pairs.evidence)
        np.testing.assert_array_equal(assign(sequence).flipped, ~assign(mirrored).flipped)

    def test_nose_decides_without_labels(self, swapped):
        sequence = replace_pairs(swapped.given, evidence=np.zeros_like(swapped.given.pairs.evidence))
        trunk = [[left for left, _ in sequence.skeleton.pairs].index(f"left_{name}") for name in ("shoulder", "hip")]
        assert swapped.wrong(assign(sequence))[:, trunk].mean() == 0.0

    def test_result_is_deterministic(self, swapped):
        one, other = assign(swapped.given), assign(swapped.given)
        assert one.flipped.tobytes() == other.flipped.tobytes()
        assert one.chain_swapped.tobytes() == other.chain_swapped.tobytes()

    def test_people_are_independent(self):
        first, second = simulate_walk(seed=1, seconds=2), simulate_walk(seed=2, seconds=2)
        both = SolvedPairs(
            *(
                np.stack([getattr(s.given.pairs, field.name) for s in (first, second)], axis=1).reshape(
                    -1, *getattr(first.given.pairs, field.name).shape[1:]
                )
                for field in fields(SolvedPairs)
            )
        )
        midline = np.concatenate([first.given.midline_m, second.given.midline_m], axis=1)
        sequence = replace(first.given, pairs=both, midline_m=midline, confidence=None, n_people=2)
        together = assign(sequence)
        for person, alone in enumerate((first, second)):
            sides = assign(alone.given)
            np.testing.assert_array_equal(together.flipped[:, person], sides.flipped[:, 0])
            np.testing.assert_array_equal(together.chain_swapped[:, person], sides.chain_swapped[:, 0])


class TestMissing:
    def without_points(self, data: Scene, which: np.ndarray) -> PairSequence:
        """Return the pairs without some points (frame, pair, 2)."""
        pairs = data.given.pairs
        lost = which.any(axis=-1)[..., None]
        return replace_pairs(
            data.given,
            points_m=np.where(which[..., None], np.nan, pairs.points_m),
            covariance_m2=np.where(which[..., None], np.nan, pairs.covariance_m2),
            used=np.where(which[:, :, None], -1, pairs.used).astype(np.int8),
            evidence=np.where(lost, 0.0, pairs.evidence),
        )

    def test_single_points_are_assigned(self, rng):
        data = simulate_walk()
        sequence = self.without_points(data, rng.random((data.given.n_frames, 8, 2)) < 0.15)
        points = np.isfinite(sequence.pairs.points_m).all(axis=-1)
        sides = assign(sequence)
        assert data.wrong(sides)[points.all(axis=-1)].mean() < 0.01
        ordered = sides.applied(sequence.pairs).points_m
        own = np.linalg.norm(ordered - data.truth_m, axis=-1)
        other = np.linalg.norm(ordered - data.truth_m[:, :, ::-1], axis=-1)
        alone = np.isfinite(own) & (points.sum(axis=-1) == 1)[..., None]
        assert (other < own)[alone].mean() < 0.03

    def test_gaps_in_time(self):
        data = simulate_walk()
        which = np.zeros((data.given.n_frames, 8, 2), dtype=bool)
        which[40:70] = True
        sequence = self.without_points(data, which)
        present = ~which.any(axis=(1, 2))
        assert data.wrong(assign(sequence))[present].mean() == 0.0

    def test_intermittent_views(self, rng):
        data = simulate_walk(missing=0.3)
        assert data.wrong(assign(data.given)).mean() < 0.01

    @pytest.mark.parametrize("frames", [1, 2, 7])
    @pytest.mark.parametrize("method", ["chains", "votes", "plane"])
    def test_few_frames(self, swapped, frames, method):
        few = swapped.given
        pairs = SolvedPairs(*(getattr(few.pairs, field.name)[:frames] for field in fields(SolvedPairs)))
        sequence = replace(
            few, pairs=pairs, time_s=few.time_s[:frames], confidence=few.confidence[:frames],
            midline_m=few.midline_m[:frames],
        )  # fmt: skip
        assert assign(sequence, method).flipped.shape == (frames, 1, 8)

    @pytest.mark.parametrize("method", ["chains", "votes", "plane"])
    def test_no_points(self, swapped, method):
        sequence = self.without_points(swapped, np.ones((swapped.given.n_frames, 8, 2), dtype=bool))
        sequence = replace(sequence, midline_m=None)
        sides = assign(sequence, method)
        assert not sides.flipped.any()
        assert (sides.chain_swapped == -1).all()

    def test_skeleton_without_chains_or_bones(self, swapped):
        bare = Skeleton("bare", swapped.given.skeleton.keypoints, pairs=swapped.given.skeleton.pairs)
        sequence = replace(swapped.given, skeleton=bare)
        sides = assign(sequence)
        assert len(sides.chains) == 8
        assert swapped.wrong(sides).mean() < 0.01

    def test_skeleton_without_pairs(self, swapped):
        lone = Skeleton("lone", ("head", "tail"))
        none = {f.name: getattr(swapped.given.pairs, f.name)[:, :0] for f in fields(SolvedPairs)}
        sequence = replace(swapped.given, skeleton=lone, pairs=SolvedPairs(**none), midline_m=None, confidence=None)
        for method in ("chains", "votes", "plane"):
            assert assign(sequence, method).flipped.shape == (swapped.given.n_frames, 1, 0)
