"""Detections with keypoints of two people in close contact."""

from dataclasses import replace
from itertools import product
from typing import Any, cast

import numpy as np
import pytest

from posefuse.kernels.tracking.records import KeypointGraph
from posefuse.kernels.tracking.shared_detections import _split_keypoints, _SplitWorkspace
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.shared_detections import share_between_tracks
from tests.unit.tracking.stage_runs import active_people, errors_m, run_without

SKELETON = shipped_skeleton("body_20")
N = len(SKELETON)
LEFT_ARM = np.array([name in ("left_shoulder", "left_elbow", "left_wrist") for name in SKELETON.keypoints])
SCALE = 300.0
NONE = np.zeros(N, dtype=bool)


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    rig = build_rig("ring", 2)
    return TrackerSettings.of(rig, SKELETON, default_noise(rig, Options()), TrackerOptions())


def two_people(apart_px: float) -> ProjectedBodies:
    """Return two people whose keypoints lie at different pixels, and whose centers are some distance apart."""
    at = np.random.default_rng(0).uniform(-250.0, 250.0, (2, 1, N, 2)).repeat(2, axis=1)
    at -= at[:, :, SKELETON.core_indices].mean(axis=2, keepdims=True) - 600.0
    at[1, ..., 0] += apart_px
    variance = np.tile([25.0, 0.0, 25.0], (2, 2, N, 1))
    return ProjectedBodies(
        np.zeros((2, N, 3)), np.zeros((2, N, 6)), at, variance, np.full((2, 2, N), SCALE)
    )  # fmt: skip


def share(
    settings: TrackerSettings, second: np.ndarray, apart_px: float = 30.0, rows: tuple[int, int] = (0, -1)
) -> tuple[np.ndarray, np.ndarray]:
    """Share one detection in the first view, of which some keypoints are the second person's."""
    bodies = two_people(apart_px)
    pixels = np.where(second[:, None], bodies.pixels[1, 0], bodies.pixels[0, 0])[None]
    pixels = pixels + np.random.default_rng(1).normal(0.0, 4.0, pixels.shape)
    frame = Frame(
        pixels, np.full((1, N), 0.9), np.zeros(1, dtype=np.int64), np.full(1, -1), np.zeros(2), np.ones(2, dtype=bool)
    )
    assigned = np.array([[rows[0], -1], [rows[1], -1]])
    labels = np.tile(np.arange(N), (2, 2, 1))
    shared = share_between_tracks(frame, assigned, labels, bodies, np.ones(2, dtype=bool), settings)
    np.testing.assert_array_equal(assigned, [[rows[0], -1], [rows[1], -1]])
    return shared, labels


def test_each_keypoint_belongs_to_the_person_whom_it_shows(settings: TrackerSettings):
    shared, labels = share(settings, LEFT_ARM)
    assert shared.tolist() == [[0, -1], [0, -1]]
    np.testing.assert_array_equal(labels[0, 0], np.where(LEFT_ARM, -1, np.arange(N)))
    np.testing.assert_array_equal(labels[1, 0], np.where(LEFT_ARM, np.arange(N), -1))
    np.testing.assert_array_equal(labels[:, 1], np.tile(np.arange(N), (2, 1)))


@pytest.mark.parametrize(("second", "apart_px"), [(NONE, 30.0), (LEFT_ARM, 1.1 * 0.7 * SCALE)])
def test_detection_of_one_person_or_of_people_apart_is_not_shared(
    settings: TrackerSettings, second: np.ndarray, apart_px: float
):
    shared, labels = share(settings, second, apart_px)
    assert shared.tolist() == [[0, -1], [-1, -1]]
    np.testing.assert_array_equal(labels, np.tile(np.arange(N), (2, 2, 1)))


def test_split_has_the_highest_total_of_all():
    rng, split = np.random.default_rng(2), cast("Any", _split_keypoints).py_func
    for _ in range(20):
        n = 7
        parents = np.array([-1, *(rng.integers(0, k) for k in range(1, n))])
        parents[rng.integers(1, n)] = -1
        gain, edge = rng.normal(0.0, 2.0, n), float(rng.uniform(0.0, 3.0))
        gain[rng.integers(n)] = np.nan
        work = _SplitWorkspace(gain, np.empty((n, 2)), np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64))
        split(KeypointGraph(np.arange(n), parents, np.arange(n)), edge, work)

        def total(labels, gain=gain, parents=parents, edge=edge) -> float:
            chosen = np.array(labels)
            cut = (parents >= 0) & (chosen != chosen[parents])
            return float(np.nansum(gain * chosen) - edge * cut.sum())

        best = max(total(labels) for labels in product((0, 1), repeat=n))
        assert total(work.is_second) == pytest.approx(best)


def test_keypoint_graph_is_a_spanning_tree_of_the_edges(settings: TrackerSettings):
    order, parents, _ = settings.keypoint_graph
    assert sorted(order.tolist()) == list(range(N))
    edges = {frozenset(edge) for edge in SKELETON.edge_indices.tolist()}
    place = np.argsort(order)
    for k in np.flatnonzero(parents >= 0):
        assert frozenset((int(k), int(parents[k]))) in edges
        assert place[parents[k]] < place[k]


@pytest.fixture(scope="module")
def hug() -> CrowdScene:
    return simulate_crowd(CrowdOptions("hug", seed=2, duration_s=16.0))


def test_people_who_hug_are_tracked_better(hug: CrowdScene):
    """Most views show a single detection of both: it moves the two tracks, each by its own keypoints."""
    truth = np.asarray(hug.truth.layers["measured"].points_m)
    (merged,) = (span for span in hug.spans if span.what == "merged")
    time_s = np.asarray(hug.truth.time_s)
    during = (time_s >= merged.from_s) & (time_s <= merged.to_s + 0.5)
    mean_mm = []
    for stages in ((), ("shared_detections",)):
        results = run_without(hug, *stages)
        names = sorted(active_people(results[100]))
        cost = [[np.nanmean(errors_m(results, name, truth[:, p])[80:180]) for p in range(2)] for name in names]
        own = np.argmin(cost, axis=1)
        errors = [errors_m(results, name, truth[:, p])[during] for name, p in zip(names, own, strict=True)]
        mean_mm.append(1e3 * float(np.nanmean(errors)))
    assert mean_mm[0] < 0.75 * mean_mm[1]
    assert mean_mm[0] < 60.0


def test_shared_detection_belongs_to_one_person_in_the_results(hug: CrowdScene):
    """The keypoints of a view that shares its detection are used, but the detection stays that of its owner."""
    views = hug.detections.n_views
    results, n_shared = run_without(hug), 0
    for people in results:
        rows = np.array([person.rows for person in active_people(people).values()]).reshape(-1, views)
        for v in range(views):
            assigned = rows[rows[:, v] >= 0, v]
            assert len(set(assigned.tolist())) == len(assigned)
        for person in active_people(people).values():
            for v in np.flatnonzero((person.rows < 0) & person.used.any(axis=1)):
                n_shared += 1
                assert (rows[:, v] >= 0).any()
    assert n_shared > 20


def test_specification_assigns_each_detection_to_one_person(hug: CrowdScene):
    options = Options(tracker=replace(TrackerOptions(), strategy="specification"))
    tracker = tracker_of(hug.rig, SKELETON, default_noise(hug.rig, options), options)
    assert not tracker.settings.options.shared_detections.enabled
