"""Bone lengths from all comparisons with the views."""

from typing import cast

import numpy as np
import pytest
from benchmarks.animal_scenes import AnimalOptions, simulate_animals

from posefuse.model.frames import Frame
from posefuse.skeleton.trees import Tree
from posefuse.tracking.bone_lengths import LengthComparison
from posefuse.tracking.history import History
from posefuse.tracking.pooled_lengths import PooledLengths
from posefuse.tracking.settings import tempering_factor
from posefuse.tracking.smoothing import PeopleSmoother
from tests.unit.tracking.mice import MOUSE
from tests.unit.tracking.stage_runs import tracker_without

TREE = cast("Tree", MOUSE.tree)
SD_M, MEMORY_S = 0.004, 0.25


def comparison(time_s: float, longer_m: np.ndarray, misfit: float = 0.8) -> LengthComparison:
    information = np.eye(TREE.n_shape) / SD_M**2
    variance = np.full(TREE.n_shape, SD_M**2)
    return LengthComparison(time_s, information, information @ longer_m, longer_m, variance, misfit)


def pooled(number: int, longer_m: np.ndarray, step_s: float = 0.4, misfit: float = 0.8) -> PooledLengths:
    lengths = PooledLengths()
    for k in range(number):
        lengths.add(comparison(step_s * k, longer_m, misfit), MEMORY_S)
    return lengths


def test_lengths_are_the_posterior_of_prior_and_tempered_comparisons(rng):
    longer_m = 0.003 * rng.standard_normal(TREE.n_shape)
    actual = pooled(20, longer_m).take_m(TREE)
    independent = 1.0 + 19.0 / float(tempering_factor(np.array(0.4), MEMORY_S))
    gain = TREE.shape_covariance @ np.linalg.inv(TREE.shape_covariance + SD_M**2 / independent * np.eye(TREE.n_shape))
    np.testing.assert_allclose(actual, TREE.shape_m + gain @ longer_m, rtol=1e-9)


def test_few_comparisons_and_those_of_mixed_bodies_show_no_lengths():
    nothing = np.zeros(TREE.n_shape)
    assert pooled(10, nothing).is_due
    assert not pooled(9, nothing).is_due
    assert not pooled(40, nothing, misfit=1.5).is_due


def test_lengths_are_taken_again_when_the_comparisons_have_grown():
    lengths, taken = PooledLengths(), []
    for k in range(100):
        lengths.add(comparison(0.4 * k, np.full(TREE.n_shape, 0.001)), MEMORY_S)
        if lengths.is_due:
            lengths.take_m(TREE)
            taken.append(lengths.count)
    assert taken[:3] == [10, 13, 17]
    assert len(taken) < 13


@pytest.mark.parametrize("seed", [0, 1])
def test_fixed_lengths_of_a_mouse_become_more_accurate(seed):
    scene = simulate_animals(AnimalOptions(animals=1, cameras=3, duration_s=16.0, rate_hz=30.0, seed=seed))
    truth = np.asarray(scene.truth.layers["measured"].points_m)[:, 0]
    tracker = tracker_without(scene)
    history, fixed, estimates = History(tracker.settings), 0, []
    for f in range(scene.detections.n_frames):
        history.add(tracker, tracker.process(Frame.of(scene.detections, f)))
        if len(tracker.tracks) and not tracker.state.free[0]:
            fixed = fixed or f
            estimates.append(tracker.state.shape[0].copy())
    # Bones between keypoints, whose true lengths the truth shows.
    bones = [node for node in TREE.nodes if node.is_bone and node.name.startswith("left_")]
    exact = np.array([
        np.median(np.linalg.norm(
            truth[:, MOUSE.index(node.name)] - truth[:, MOUSE.index(TREE.nodes[node.parent].name)], axis=-1
        ))
        for node in bones
    ])  # fmt: skip
    errors = np.abs(np.array(estimates)[:, [node.shape[2] for node in bones]] - exact).mean(axis=1)
    assert errors[-1] < 0.9 * errors[0]
    # The smoother fits the lengths of each epoch again, and keeps the signs of coordinates.
    (part,) = PeopleSmoother(history).take(scene.detections.n_frames)
    lengths = part.body.shape_m[fixed - part.places[0] :]
    np.testing.assert_allclose(lengths[-1], estimates[-1], rtol=0.6, atol=0.003)
    assert np.abs(lengths[-1][[node.shape[2] for node in bones]] - exact).mean() < 2.0 * errors[0]
    found = np.linalg.norm(
        part.body.points_m[-1, MOUSE.index("left_knee")] - part.body.points_m[-1, MOUSE.index("spine_middle")]
    )
    assert found == pytest.approx(lengths[-1][TREE.shape_names.index("left_knee")], rel=1e-6)
