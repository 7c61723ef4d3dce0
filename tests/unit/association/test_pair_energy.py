"""Proposals by the energy E_pair: a loop over its equation, and frames of two people."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from posefuse.association.groups import observe_detections
from posefuse.association.pair_energy import (
    anthropometric_penalty,
    cluster_pairs,
    pair_energy,
    pairs_of,
    propose_by_energy,
)
from posefuse.association.trunk import full
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.options.specification import SpecificationOptions
from posefuse.model.options.tracking_motion import MotionOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies, body_of

SKELETON = shipped_skeleton("body_20")
TREE = SKELETON.tree
assert TREE is not None
RIG = build_rig("ring", 4)
NOISE = NoiseModel(np.array([3.0, 4.0, 5.0, 6.0]), 1.0)
OPTIONS = SpecificationOptions()
CORE = SKELETON.core_indices


def standing(x_m: float, y_m: float = 0.0) -> np.ndarray:
    """Return the points of an upright person, shape (keypoint, 3)."""
    assert TREE is not None
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [x_m, y_m, 0.95]
    state = initial_state(TREE, points, TREE.shape_m, TREE.shape_covariance, MotionOptions())
    return ProjectedBodies.of(state, RIG.packed[:0], body_of(TREE)).points_m[0]


def frame_of(people: list[np.ndarray], rng: np.random.Generator, sd_px: float = 1.0) -> Frame:
    """Return a frame in which every view shows all people, with noise."""
    pixels = np.stack([RIG.project(person[None])[0] for person in people], axis=1)
    pixels = pixels + sd_px * rng.standard_normal(pixels.shape)
    confidence = rng.uniform(0.3, 1.0, pixels.shape[:3])
    return Frame.of_people(list(pixels), list(confidence), 0.0)


def pairs_in(frame: Frame, options: SpecificationOptions = OPTIONS):
    free = np.ones(len(frame.view), dtype=bool)
    every = np.arange(len(SKELETON))
    detections = observe_detections(RIG, frame, NOISE, every, free, AssociationOptions())
    return detections, pairs_of(RIG, frame, NOISE, SKELETON, detections, options)


def propose(frame: Frame, options: SpecificationOptions = OPTIONS, association: AssociationOptions | None = None):
    free = np.ones(len(frame.view), dtype=bool)
    return propose_by_energy(RIG, NOISE, SKELETON, association or AssociationOptions(), options, frame, free)


def naive_energy(frame: Frame, rows: tuple[int, int], points: np.ndarray, options: SpecificationOptions) -> float:
    """Return E_pair, term by term."""
    total = options.anthropometric_weight * naive_penalty({k: points[k] for k in CORE})
    for k in CORE:
        if not np.isfinite(points[k]).all():
            continue
        rays = []
        for row in rows:
            v = frame.view[row]
            pixel = RIG.cameras[v].project(points[k])[0]
            sigma = NOISE.scale_px[v] / frame.confidence[row, k]
            total += float(((frame.keypoints_px[row, k] - pixel) ** 2).sum()) / sigma**2
            rays.append(points[k] - RIG.cameras[v].center_m)
        cosine = rays[0] @ rays[1] / np.linalg.norm(rays[0]) / np.linalg.norm(rays[1])
        total += options.angle_weight / np.sin(np.arccos(cosine)) ** 2
    return total


def naive_penalty(points: dict[int, np.ndarray]) -> float:
    """Return psi_anthro: lengths beyond half and twice their mean, sides that differ by more than half."""
    assert TREE is not None
    mean = dict(zip(TREE.shape_names, TREE.shape_m, strict=True))
    expected = {
        ("shoulder", "elbow"): mean["left_elbow"],
        ("elbow", "wrist"): mean["left_wrist"],
        ("hip", "knee"): mean["left_knee"],
        ("knee", "ankle"): mean["left_ankle"],
    }

    def length(a: str, b: str) -> float:
        return float(np.linalg.norm(points[SKELETON.index(a)] - points[SKELETON.index(b)]))

    def excess(ratio: float, limit: float) -> float:
        return max(0.0, abs(np.log(ratio)) - np.log(limit)) ** 2 / 0.1**2

    total = excess(length("left_hip", "right_hip") / (2.0 * mean["left_hip.left"]), 2.0)
    total += excess(length("left_shoulder", "right_shoulder") / (2.0 * mean["left_shoulder.left"]), 2.0)
    for (a, b), usual in expected.items():
        left, right = (length(f"{side}_{a}", f"{side}_{b}") for side in ("left", "right"))
        total += excess(left / usual, 2.0) + excess(right / usual, 2.0) + excess(left / right, 1.5)
    return total


@pytest.mark.parametrize(
    "options",
    [OPTIONS, replace(OPTIONS, angle_weight=0.0), replace(OPTIONS, anthropometric_weight=3.0)],
    ids=["default", "without angles", "strong lengths"],
)
def test_energy_is_that_of_the_equation(options: SpecificationOptions, rng: np.random.Generator) -> None:
    frame = frame_of([standing(0.0), standing(0.8)], rng, 3.0)
    detections, pairs = pairs_in(frame, options)
    assert len(pairs.pair) == 4 * 3 // 2 * 4
    for n in range(len(pairs.pair)):
        a, b = detections.rows[pairs.pair[n]]
        if np.isfinite(pairs.points_m[n][CORE]).all():
            expected = naive_energy(frame, (int(a), int(b)), pairs.points_m[n], options)
            assert pairs.energy[n] == pytest.approx(expected, rel=1e-6)


def test_missing_keypoints_add_no_energy(rng: np.random.Generator) -> None:
    frame = frame_of([standing(0.0)], rng)
    rows, points = np.array([[0, 1]]), standing(0.0)[None].copy()
    full = pair_energy(RIG, frame, NOISE, SKELETON, rows, points, OPTIONS)[0]
    points[0, CORE[:4]] = np.nan
    part = pair_energy(RIG, frame, NOISE, SKELETON, rows, points, OPTIONS)[0]
    assert 0.0 < part < full


def test_small_ray_angles_cost_energy(rng: np.random.Generator) -> None:
    """Cameras 0 and 1 see the person at right angles; behind that person, their rays are closer to parallel."""
    frame = frame_of([standing(0.0)], rng)
    rows = np.array([[0, 1]])
    without = replace(OPTIONS, angle_weight=0.0, anthropometric_weight=0.0)
    with_angle = replace(without, angle_weight=1.0)
    away = -sum(RIG.cameras[v].center_m - np.array([0.0, 0.0, 1.0]) for v in range(2))
    added = []
    for distance in (0.0, 2.0):
        points = standing(0.0)[None] + distance * away
        low, high = (pair_energy(RIG, frame, NOISE, SKELETON, rows, points, each)[0] for each in (without, with_angle))
        added.append(high - low)
    assert len(CORE) <= added[0] < 2.0 * len(CORE)
    assert added[1] > 5.0 * added[0]


def test_plausible_bodies_have_no_penalty_and_others_do() -> None:
    points = standing(0.0)
    assert anthropometric_penalty(points[CORE], SKELETON) == 0.0
    wide = points.copy()
    wide[SKELETON.index("left_shoulder")] += 3.0 * (points[SKELETON.index("left_shoulder")] - points[CORE].mean(axis=0))
    long = points.copy()
    long[SKELETON.index("left_wrist")] += 2.0 * (
        points[SKELETON.index("left_wrist")] - points[SKELETON.index("left_elbow")]
    )
    for wrong in (wide, long):
        expected = naive_penalty({k: wrong[k] for k in CORE})
        assert expected > 10.0
        assert anthropometric_penalty(wrong[CORE], SKELETON) == pytest.approx(expected, rel=1e-9)


def test_two_people_are_two_clusters_with_all_views(rng: np.random.Generator) -> None:
    people = [standing(-0.7), standing(0.7, 0.3)]
    found = propose(frame_of(people, rng))
    assert len(found) == 2
    np.testing.assert_array_equal(found.n_views, 4)
    np.testing.assert_array_equal(found.n_pairs, 6)
    assert len(np.unique(found.rows)) == 8
    off = [
        min(np.nanmax(np.linalg.norm(each[CORE] - person[CORE], axis=-1)) for person in people)
        for each in found.points_m
    ]  # fmt: skip
    assert max(off) < 0.05


def test_centroid_is_the_mean_of_the_pairs(rng: np.random.Generator) -> None:
    frame = frame_of([standing(0.0)], rng)
    _, pairs = pairs_in(frame)
    found = propose(frame)
    np.testing.assert_allclose(found.points_m[0], np.nanmean(pairs.points_m, axis=0), atol=1e-9)


def test_gate_and_volume_bound_proposals(rng: np.random.Generator) -> None:
    frame = frame_of([standing(0.0)], rng)
    assert len(propose(frame)) == 1
    assert not len(propose(frame, replace(OPTIONS, pair_gate=0.01)))
    assert not len(propose(frame, association=AssociationOptions(volume_m=(1.0, -1.0, 0.0, 3.0, 1.0, 2.0))))
    assert not len(propose(frame, association=AssociationOptions(min_common=13)))


def test_gate_is_per_common_keypoint(rng: np.random.Generator) -> None:
    """The same relative energy passes with few and with many keypoints."""
    frame = frame_of([standing(0.0)], rng)
    _, pairs = pairs_in(frame)
    each = (pairs.energy / pairs.n_common).max()
    kept = propose(frame, replace(OPTIONS, pair_gate=float(each) * 1.001))
    assert kept.n_pairs.tolist() == [6]


def test_covariances_predict_the_scatter_of_points(rng: np.random.Generator) -> None:
    """Squared errors of pairs' points in units of their covariances have a mean of three or less."""
    squared, person = [], standing(0.2)
    exact = replace(AssociationOptions(), sigma_factor=1.0)
    for _ in range(60):
        pixels = RIG.project(person[None])[0][:, None]
        pixels = pixels + NOISE.scale_px[:, None, None, None] * rng.standard_normal(pixels.shape)
        frame = Frame.of_people(list(pixels), [np.ones((1, len(SKELETON)))] * 4, 0.0)
        free, every = np.ones(4, dtype=bool), np.arange(len(SKELETON))
        detections = observe_detections(RIG, frame, NOISE, every, free, exact)
        pairs = pairs_of(RIG, frame, NOISE, SKELETON, detections, OPTIONS)
        error = pairs.points_m - person
        squared.append((error * np.linalg.solve(full(pairs.covariance_m2), error[..., None])[..., 0]).sum(axis=-1))
    assert np.nanmean(squared) == pytest.approx(3.0, rel=0.1)


def test_clusters_follow_single_linkage(rng: np.random.Generator) -> None:
    frame = frame_of([standing(-0.7), standing(0.7)], rng)
    detections, pairs = pairs_in(frame)
    own = detections.rows % 2
    good = pairs.select(own[pairs.pair[:, 0]] == own[pairs.pair[:, 1]])
    assert len(good.pair) == 12
    clusters = cluster_pairs(good, SKELETON, OPTIONS)
    assert sorted(len(group) for group in clusters) == [6, 6]
    alone = cluster_pairs(good, SKELETON, replace(OPTIONS, cluster_gate=0.0))
    assert len(alone) == len(good.pair)
    assert sorted(itertools.chain(*(group.tolist() for group in clusters))) == list(range(12))
