"""Left/right kernels against exhaustive references."""

import numpy as np
import pytest

from posefuse.kernels.left_right import orientation
from posefuse.kernels.left_right.records import (
    LabelModel,
    LinkModel,
    MotionSpeeds,
    OrientationCosts,
    PairBlock,
    PairFrames,
    PairMemory,
)
from tests.reference import sides as naive

pytestmark = pytest.mark.no_jit


def block(rng, frames=3, pairs=4):
    """Costs of two of four pairs and the link between them, with ties and gaps."""
    time_cost = rng.normal(0, 2, (frames, pairs, 2, 2))
    time_cost[1, :, 0, 1] += 50.0
    time_cost[1, :, 1, 0] += 50.0
    members, links, ends = np.array([2, 0, 3]), np.array([1, 0]), np.array([[0, 1], [2, 1]])
    return time_cost, rng.normal(0, 2, (frames, pairs)), rng.normal(0, 2, (frames, 3)), members, links, ends


@pytest.mark.parametrize("seed", range(6))
def test_block_has_the_cheapest_sequence(seed):
    costs_of = block(np.random.default_rng(seed))
    members = costs_of[3]
    best, sequence = naive.cheapest(*costs_of)
    out = np.zeros((3, 4), dtype=bool)
    costs, pairs = OrientationCosts(*costs_of[:3]), PairBlock(*costs_of[3:])
    orientation.find_orientations(costs, pairs, np.zeros(8), np.empty((3, 8), dtype=np.int64), out)
    assert naive.cost_of(out[:, members].astype(int), *costs_of) == pytest.approx(best)
    np.testing.assert_array_equal(out[:, members], sequence)
    assert not out[:, 1].any()


@pytest.mark.parametrize("seed", range(4))
def test_sequence_can_be_solved_in_pieces(seed):
    costs_of = block(np.random.default_rng(seed), frames=6)
    costs, pairs = OrientationCosts(*costs_of[:3]), PairBlock(*costs_of[3:])
    whole, pieces = np.zeros(8), np.zeros(8)
    orientation.find_orientations(costs, pairs, whole, np.empty((6, 8), dtype=np.int64), np.zeros((6, 4), dtype=bool))
    for part in (slice(0, 2), slice(2, 6)):
        n = part.stop - part.start
        out, origin = np.zeros((n, 4), dtype=bool), np.empty((n, 8), dtype=np.int64)
        orientation.find_orientations(OrientationCosts(*(each[part] for each in costs)), pairs, pieces, origin, out)
    np.testing.assert_allclose(pieces, whole)


@pytest.mark.parametrize("seed", range(4))
def test_view_swaps_match_the_reference(seed):
    rng = np.random.default_rng(seed)
    odds, time_s = rng.normal(0, 3, (9, 2)), np.cumsum(rng.uniform(0.02, 0.2, 9))
    share, rate = np.array([0.2, 0.4]), np.array([2.0, 9.0])
    out = np.empty((9, 2), dtype=np.int8)
    orientation.find_swap_states(odds, time_s, share, rate, np.empty((9, 2), dtype=np.int64), out)
    for v in range(2):
        np.testing.assert_array_equal(out[:, v], naive.cheapest_swaps(odds[:, v], time_s, share[v], rate[v]))


def covariances(rng, *shape):
    root = rng.normal(0, 0.02, (*shape, 3, 3))
    full = root @ np.swapaxes(root, -1, -2) + 1e-5 * np.eye(3)
    return full[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]


def test_temporal_costs_match_the_reference(rng):
    frames, pairs, views = 2, 3, 2
    points, covariance = rng.normal(0, 0.3, (frames, pairs, 2, 3)), covariances(rng, frames, pairs, 2)
    points[1] = points[0] + rng.normal(0, 0.05, points[0].shape)
    points[1, 2] = np.nan
    odds = rng.normal(0, 3, (frames, pairs, views))
    odds[1, 0, 1] = 0.0
    odds[0] += np.sign(odds[0])
    share, rate, weight = np.array([0.2, 0.3]), np.array([2.0, 5.0]), rng.uniform(0.2, 1, (pairs, views))
    turn = np.array([1.0, 2.0, 3.0])
    memory = PairMemory(
        np.full((pairs, 2, 3), np.nan), np.full((pairs, 2, 6), np.nan), np.full((pairs, 2), -np.inf),
        np.zeros((pairs, views)), np.full((pairs, views), -np.inf),
    )  # fmt: skip
    out, time_s = np.empty((frames, pairs, 2, 2)), np.array([5.0, 5.04])
    frames_of = PairFrames(points, covariance, odds, time_s)
    labels = LabelModel(share, rate, weight)
    orientation.temporal_costs(frames_of, memory, MotionSpeeds(turn, turn), labels, np.empty((2, 6)), out)
    for p in range(pairs):
        first, second = np.zeros((2, 2)), np.zeros((2, 2))
        for v in range(views):
            first += weight[p, v] * naive.label_cost(odds[0, p, v], 0.0, np.inf, share[v], rate[v])
            if odds[1, p, v]:
                labels = naive.label_cost(odds[1, p, v], odds[0, p, v], 0.04, share[v], rate[v])
                second += weight[p, v] * labels
        cost = 50.0
        if p < 2:
            cost = naive.turn_cost(
                points[1, p], covariance[1, p], points[0, p], covariance[0, p], (turn[p] * 0.04) ** 2
            )
        np.testing.assert_allclose(out[0, p], first, atol=1e-9)
        np.testing.assert_allclose(out[1, p], second + cost * (1 - np.eye(2)), atol=1e-9)
    np.testing.assert_array_equal(memory[0][:2], points[1, :2])
    np.testing.assert_array_equal(memory[0][2], points[0, 2])
    np.testing.assert_array_equal(memory[2], [[5.04, 5.04], [5.04, 5.04], [5.0, 5.0]])


def test_single_point_of_a_pair_uses_its_last_position(rng):
    near, far = np.zeros(3), np.array([0.3, 0.0, 0.0])
    covariance = np.tile([1e-4, 0, 0, 1e-4, 0, 1e-4], (2, 1, 2, 1))
    points = np.array([[[near, far]], [[far + 0.01, np.full(3, np.nan)]]])
    memory = PairMemory(
        np.full((1, 2, 3), np.nan), np.full((1, 2, 6), np.nan), np.full((1, 2), -np.inf),
        np.zeros((1, 1)), np.full((1, 1), -np.inf),
    )  # fmt: skip
    labels = LabelModel(np.array([0.2]), np.array([2.0]), np.ones((1, 1)))
    out, time_s = np.empty((2, 1, 2, 2)), np.array([0.0, 0.03])
    frames, speeds = PairFrames(points, covariance, np.zeros((2, 1, 1)), time_s), MotionSpeeds(np.ones(1), np.ones(1))
    orientation.temporal_costs(frames, memory, speeds, labels, np.empty((2, 6)), out)
    assert out[1, 0, 0, 1] < -4.0
    assert out[1, 0, 0, 1] == out[1, 0, 1, 0]


def test_link_costs_match_the_reference(rng):
    hips, knees = np.array([[0.0, 0.1, 1.0], [0.0, -0.1, 1.0]]), np.array([[0.1, 0.1, 0.6], [-0.1, -0.1, 0.6]])
    length = float(np.linalg.norm(hips[0] - knees[0]))
    points = np.stack([np.stack([hips, knees]), np.stack([hips, knees[::-1]]), np.stack([hips, [[np.nan] * 3] * 2])])
    odds = np.zeros((3, 2, 1))
    odds[2] = [[3.0], [-3.0]]

    def costs(together: float, likeness: float = 0.0) -> np.ndarray:
        out = np.empty((3, 1))
        one = np.ones(1)
        links = np.array([[0, 1]])
        model = LinkModel(links, length * one, 0.02 * one, likeness * one, one, np.full((1, 1), together))
        orientation.link_costs(points, odds, model, 100.0, 1.0, out)
        return out[:, 0]

    crossed = np.linalg.norm(hips[0] - knees[1])
    expected = min((crossed - length) ** 2 / 0.02**2, 9.0)
    np.testing.assert_allclose(costs(0.0), [expected, -expected, 0.0], atol=1e-9)
    agreement = 2 * np.arctanh(np.tanh(1.5) * np.tanh(-1.5) * np.tanh(1.0))
    assert costs(2.0)[2] == pytest.approx(agreement)
    assert costs(0.0, 0.5)[0] > expected


def test_cross_links_use_decided_pairs_only():
    field, link_cost = np.zeros((1, 3)), np.array([[2.0, 5.0]])
    links, flipped, out = np.array([[0, 1], [1, 2]]), np.array([[False, True, False]]), np.empty((1, 3))
    orientation.add_cross_links(field, link_cost, links, np.array([0, 1]), flipped, np.array([True, True, False]), out)
    np.testing.assert_array_equal(out, [[-2.0, 2.0, -5.0]])
