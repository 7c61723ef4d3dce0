"""Bone lengths that are fixed when stable, and estimated again where the views contradict them."""

from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.skeleton.trees import Tree
from posefuse.synthetic.crowds import CrowdScene, crowd_of_points
from posefuse.synthetic.figures import human
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.walkers import Attendance, stroll
from posefuse.tracking.bone_lengths import LengthComparison, LengthMonitor, measure_lengths, reopen_shape
from posefuse.tracking.history import History
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.smoothing import PeopleSmoother
from posefuse.tracking.strategies import find_strategy
from posefuse.tracking.tracker import ArticulatedTracker
from tests.unit.tracking.stage_runs import tracker_without

RATE_HZ, SHORT_S, SHARE = 25.0, 5.0, 0.2
SKELETON, RIG = shipped_skeleton("body_20"), build_rig("ring", 5, "pinhole", radius_m=5.0)
KNEES = [SKELETON.index(f"{side}_knee") for side in ("left", "right")]
TREE = cast("Tree", SKELETON.tree)
THIGH, SHANK = (TREE.shape_names.index(name) for name in ("left_knee", "left_ankle"))


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    return TrackerSettings.of(RIG, SKELETON, NoiseModel(np.full(5, 4.5), 1.0), TrackerOptions())


def walk(seed: int, share: float) -> tuple[CrowdScene, np.ndarray]:
    """Return 12 s of one person whose thighs appear shorter by a share in the first 5 s, and the true points."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(300) / RATE_HZ
    figure = human(1.75)
    (way,) = stroll((Attendance(),), 2.0, 12.0, rng)
    truth = way.positions(figure, time_s)[:, figure.columns(SKELETON)]
    shown, during = truth.copy(), time_s < SHORT_S
    for side, knee in zip(("left", "right"), KNEES, strict=True):
        shown[during, knee] += share * (truth[during, SKELETON.index(f"{side}_hip")] - truth[during, knee])
    return crowd_of_points(shown[:, None], RIG, SKELETON, RATE_HZ, seed=seed), truth


def track(scene: CrowdScene) -> Iterator[tuple[ArticulatedTracker, History, list[str]]]:
    """Yield the tracker, its history and its events so far after every frame."""
    tracker, events = tracker_without(scene), []
    history = History(tracker.settings)
    for f in range(scene.detections.n_frames):
        tracked = tracker.process(Frame.of(scene.detections, f))
        history.add(tracker, tracked)
        events += [event.what for event in tracked.people.events]
        yield tracker, history, events


def knee_errors_mm(seed: int, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Return errors of the knees, causal and smoothed, shape (frame,), smoothed lengths (frame, shape), and events."""
    scene, truth = walk(seed, share)
    causal, smoothed = np.full((2, len(truth)), np.nan)
    history, events = None, []
    lengths = np.full((len(truth), TREE.n_shape), np.nan)
    for f, now in enumerate(track(scene)):
        tracker, history, events = now
        if tracker.tracks and tracker.tracks[0].state == TrackState.ACTIVE:
            points = tracker.confirmed.projected(tracker.settings.cameras[:0], tracker.settings).points_m[0]
            causal[f] = 1e3 * np.linalg.norm(points[KNEES] - truth[f, KNEES], axis=-1).mean()
    assert history is not None
    for part in PeopleSmoother(history).take(len(truth)):
        away_m = part.body.points_m[:, KNEES] - truth[part.places][:, KNEES]
        smoothed[part.places], lengths[part.places] = (
            1e3 * np.linalg.norm(away_m, axis=-1).mean(axis=1),
            part.body.shape_m,
        )
    return causal, smoothed, lengths, events


@pytest.mark.parametrize("seed", [1, 2])
def test_shortened_bones_are_corrected_within_three_seconds(seed):
    *usual, _, quiet = knee_errors_mm(seed, 0.0)
    *found, lengths, events = knee_errors_mm(seed, SHARE)
    assert "lengths_reestimated" not in quiet
    assert "lengths_reestimated" in events
    after, during = slice(round((SHORT_S + 3.0) * RATE_HZ), None), slice(50, 120)
    for normal, short in zip(usual, found, strict=True):
        assert np.nanmean(short[after]) < 1.3 * np.nanmean(normal[after])
    # The smoother's lengths are those of each time, not one for all.
    assert np.nanmedian(lengths[during, THIGH]) < 0.88 * np.nanmedian(lengths[after, THIGH])


def comparison(settings: TrackerSettings, time_s: float, bias_m: np.ndarray, misfit: float = 0.8) -> LengthComparison:
    """Return a comparison that shows lengths with a standard deviation of 2 cm."""
    information = np.eye(TREE.n_shape) / 0.02**2
    variance = np.full(TREE.n_shape, 0.02**2)
    return LengthComparison(time_s, information, information @ bias_m, bias_m, variance, misfit)


def watched(settings: TrackerSettings, bias_m: np.ndarray, misfit: float = 0.8, checks: int = 6) -> LengthMonitor:
    monitor = LengthMonitor()
    for k in range(checks):
        monitor.add(comparison(settings, 0.4 * k, bias_m, misfit))
    return monitor


def test_only_a_clear_bias_that_lasts_is_found(settings):
    bias_m = np.zeros(TREE.n_shape)
    bias_m[THIGH] = 0.08
    shape_m = np.array(TREE.shape_m)
    found = watched(settings, bias_m).find_biased(shape_m, settings)
    assert found is not None
    assert np.flatnonzero(found).tolist() == [THIGH]
    assert watched(settings, 0.2 * bias_m).find_biased(shape_m, settings) is None
    assert watched(settings, bias_m, checks=3).find_biased(shape_m, settings) is None
    assert watched(settings, bias_m, misfit=1.0).find_biased(shape_m, settings) is None
    assert watched(settings, bias_m).find_biased(shape_m + bias_m, settings) is None
    off = replace(settings, options=replace(settings.options, reopen_shape_sigma=None))
    assert watched(settings, bias_m).find_biased(shape_m, off) is None


def test_scattered_comparisons_are_weaker_evidence(settings):
    bias_m, steady, scattered = np.zeros(TREE.n_shape), LengthMonitor(), LengthMonitor()
    bias_m[THIGH] = 0.08
    for k in range(6):
        steady.add(comparison(settings, 0.4 * k, bias_m))
        scattered.add(comparison(settings, 0.4 * k, (2.0 if k % 2 else 0.0) * bias_m))
    shape_m = np.array(TREE.shape_m)
    sigma = [each.bias_sigma(shape_m, settings)[THIGH] for each in (steady, scattered)]
    assert sigma[1] < 0.6 * sigma[0]


def test_reopened_lengths_start_with_what_the_views_show(settings):
    scene, _ = walk(3, 0.0)
    *_, (tracker, _, _) = track(scene)
    state, n, h = tracker.state, TREE.n_pose, TREE.n_shape
    assert not state.free[0]
    bias_m, before_m = np.zeros(h), state.shape[0].copy()
    bias_m[THIGH] = 0.08
    monitor = watched(settings, before_m - TREE.shape_m + bias_m)
    assert monitor.find_biased(before_m, settings) is not None
    reopen_shape(state, 0, 0.005**2 * np.eye(h), monitor, settings)
    assert state.free[0]
    assert state.shape[0, THIGH] - before_m[THIGH] == pytest.approx(0.08, abs=0.01)
    assert state.shape[0, SHANK] == pytest.approx(before_m[SHANK], abs=0.005)
    np.linalg.cholesky(state.covariance[0, n : n + h, n : n + h])


@pytest.mark.parametrize("longer_m", [0.0, 0.06])
def test_comparisons_measure_lengths(longer_m):
    """Comparisons over several seconds show the true lengths, also to a body with other lengths."""
    scene, _ = walk(4, 0.0)
    shown, shape_m = [], np.zeros(TREE.n_shape)
    for f, (tracker, _, _) in enumerate(track(scene)):
        if f > 120 and f % 10 == 0:
            frame = Frame.of(scene.detections, f)
            rows = np.array(
                [[int(np.flatnonzero(frame.view == v)[0]) if (frame.view == v).any() else -1 for v in range(5)]]
            )
            labels = np.tile(np.arange(len(SKELETON)), (1, 5, 1))
            state = State(*(each.copy() for each in tracker.state))
            shape_m = state.shape[0].copy()
            state.shape[0, THIGH] += longer_m
            shown += measure_lengths(state, frame, f / RATE_HZ, rows, labels, tracker.settings)
    information = sum(each.information for each in shown) + np.eye(TREE.n_shape)
    measured_m = TREE.shape_m + np.linalg.solve(information, sum(each.pull for each in shown))
    assert measured_m[THIGH] == pytest.approx(shape_m[THIGH], abs=0.02)
    assert np.mean([each.misfit for each in shown]) == pytest.approx(0.8, abs=0.12)


def test_lengths_are_stable_once_they_are_accurate_and_steady(settings):
    monitor, shape_m, h = LengthMonitor(), np.array(TREE.shape_m), TREE.n_shape
    accurate, vague = 0.001**2 * np.eye(h), 0.02**2 * np.eye(h)
    assert not any(monitor.is_stable(shape_m, vague, 2.0, 0.2, settings) for _ in range(20))
    monitor = LengthMonitor()
    stable = [monitor.is_stable(shape_m, accurate, 2.0, 0.2, settings) for _ in range(8)]
    assert stable == [False] * 5 + [True] * 3
    moved = [monitor.is_stable(shape_m + 0.01, accurate, 2.0, 0.2, settings) for _ in range(6)]
    assert moved == [False] * 5 + [True]


def test_the_specification_fixes_lengths_once(settings):
    options = find_strategy("specification").configure(settings).options
    assert options.reopen_shape_sigma is None
    assert options.fix_shape_sd_m is None
