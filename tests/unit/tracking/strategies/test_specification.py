"""The strategy `specification`: its terms against hand computations, and a simple crowd."""

import math
import pickle
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.errors import OptionsError
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.specification import SpecificationOptions
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track, tracks_to_terminate
from posefuse.tracking.records import Observation, People, RecentHistory, TentativeTrack, Track
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies import default, specification
from posefuse.tracking.strategies.pelvis_distance import reacquisition_cost
from posefuse.tracking.strategy import FrameOutcome
from posefuse.tracking.track_initiation import update_by_observation
from posefuse.tracking.tracker import ArticulatedTracker

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 4)
VIEWS, KEYPOINTS = len(RIG), len(SKELETON)
SIGMA_PX = 5.0

STRATEGY = specification.STRATEGY
SETTINGS = TrackerSettings.of(
    RIG, SKELETON, NoiseModel(np.full(VIEWS, SIGMA_PX), 1.0), TrackerOptions(strategy="specification")
)
SEED = SETTINGS.options.specification
TREE = SETTINGS.tree
CORE = SETTINGS.core


def standing(x_m: float = 0.0, y_m: float = 0.0) -> State:
    """Return the state of an upright person."""
    points = np.full((KEYPOINTS, 3), np.nan)
    points[SKELETON.index("mid_hip")] = [x_m, y_m, 0.95]
    shape, covariance = np.asarray(TREE.shape_m), np.asarray(TREE.shape_covariance)
    return initial_state(TREE, points, shape, covariance, SETTINGS.options.motion)


def tracked_person() -> Track:
    return new_track(1, 0.0, LifecycleThresholds(0.5, -2.0, 0.0))


def unknown() -> RecentHistory:
    movers = len(SETTINGS.tree.segments) + len(SETTINGS.tree.bones)
    return RecentHistory.new(1, VIEWS, SETTINGS.n_groups, KEYPOINTS, movers)


def project_state(state: State) -> ProjectedBodies:
    return specification._projected(state, SETTINGS)


def frame_of(keypoints_px: np.ndarray, confidence: float = 1.0) -> Frame:
    """Return a frame with one detection of a person in every view, shape (view, keypoint, 2)."""
    return Frame.of_people(list(keypoints_px[:, None]), [np.full((1, KEYPOINTS), confidence)] * VIEWS, 0.0)


def outcome_with_offset(
    state: State, off_px: float, confidence: float = 1.0, used: bool = True, dt_s: float = 0.04
) -> FrameOutcome:
    """Return the outcome of a frame in which every keypoint has a horizontal offset."""
    frame = frame_of(project_state(state).pixels[0] + np.array([off_px, 0.0]), confidence)
    labels = np.tile(np.arange(KEYPOINTS), (1, VIEWS, 1))
    supported = np.full((1, VIEWS), used)
    counted = np.full((1, VIEWS, KEYPOINTS), used)
    return FrameOutcome(
        frame, dt_s, dt_s, np.arange(VIEWS)[None], labels, counted, supported, np.ones((1, VIEWS), dtype=bool)
    )


def proposal(points_m: np.ndarray, time_s: float = 0.0, n_pairs: int = 1, log_odds: float = 1.0) -> Observation:
    shape = (VIEWS, KEYPOINTS)
    return Observation(
        time_s, 0, np.full((*shape, 2), np.nan), np.full(shape, np.nan), np.arange(VIEWS), points_m,
        np.full((KEYPOINTS, 6), 1e-4), points_m[SKELETON.core_indices].mean(axis=0), log_odds, 1.0, n_pairs,
    )  # fmt: skip


@pytest.mark.parametrize("off_px", [0.0, 3.0, 12.0, 80.0])
def test_noise_follows_the_recursion(off_px: float) -> None:
    state, recent, dt_s = standing(), unknown(), 0.04
    keep = math.exp(-dt_s / SEED.noise_memory_s)
    expected = SIGMA_PX**2
    for _ in range(3):
        STRATEGY.noise.adapt(outcome_with_offset(state, off_px), recent, state, SETTINGS)
        most = SEED.max_residual_sigma * SIGMA_PX
        expected = keep * expected + (1 - keep) * (SIGMA_PX**2 + SEED.noise_gain * min(off_px, most) ** 2)
        expected = float(np.clip(expected, (SEED.min_noise * SIGMA_PX) ** 2, (SEED.max_noise * SIGMA_PX) ** 2))
        np.testing.assert_allclose(recent.noise_px2, expected, rtol=1e-9)


def test_noise_adapts_only_to_used_keypoints() -> None:
    state, recent = standing(), unknown()
    STRATEGY.noise.adapt(outcome_with_offset(state, 10.0, used=False), recent, state, SETTINGS)
    assert np.isnan(recent.noise_px2).all()


@given(st.floats(0.1, 1.0), st.floats(0.0, 100.0))
def test_noise_stays_within_its_bounds(confidence: float, off_px: float) -> None:
    state, recent = standing(), unknown()
    for _ in range(3):
        STRATEGY.noise.adapt(outcome_with_offset(state, off_px, confidence, dt_s=1.0), recent, state, SETTINGS)
    assert recent.noise_px2.min() >= (SEED.min_noise * SIGMA_PX) ** 2 * (1 - 1e-9)
    assert recent.noise_px2.max() <= (SEED.max_noise * SIGMA_PX) ** 2 * (1 + 1e-9)


def test_update_uses_the_adapted_noise() -> None:
    """The variances survive their encoding as confidences."""
    state, recent = standing(), unknown()
    recent.noise_px2[:] = np.random.default_rng(0).uniform(10.0, 400.0, recent.noise_px2.shape)
    observed = outcome_with_offset(state, 0.0)
    labels = np.tile(SKELETON.mirror, (1, VIEWS, 1))
    trust = STRATEGY.noise.update_noise(observed.frame, observed.rows, labels, recent, 0.04, SETTINGS)
    law = trust.law
    body = trust.confidence[:, SKELETON.mirror]
    assert law.floor_m == 0.0
    assert (body >= law.min_confidence).all()
    np.testing.assert_allclose((law.scale_px[:, None] * body**-law.exponent) ** 2, recent.noise_px2[0], rtol=1e-9)


def test_keypoints_without_confidence_do_not_count() -> None:
    state, recent = standing(), unknown()
    observed = outcome_with_offset(state, 0.0, confidence=0.01)
    trust = STRATEGY.noise.update_noise(observed.frame, observed.rows, observed.labels, recent, 0.04, SETTINGS)
    assert (trust.confidence < trust.law.min_confidence).all()


def predict_states(state: State, dt_s: float) -> None:
    s = SETTINGS
    predict_people(np.array([dt_s]), s.motion, state)


def test_prior_is_the_process_noise_since_the_last_update() -> None:
    """Process noise over two frames without an update is that of their total time."""
    once, twice, recent = standing(), standing(), unknown()
    for state in (once, twice):
        STRATEGY.prior.prepare(state, recent)
    predict_states(once, 0.08)
    predict_states(twice, 0.04)
    recent.updated[:] = False
    STRATEGY.prior.prepare(twice, recent)
    predict_states(twice, 0.04)
    np.testing.assert_allclose(twice.covariance, once.covariance, rtol=1e-6, atol=1e-9)
    t, f = SETTINGS.decay_s[0], math.exp(-0.08 / SETTINGS.decay_s[0])
    q = SETTINGS.power[0] * t * t * (0.08 - 2.0 * t * (1.0 - f) + 0.5 * t * (1.0 - f * f))
    assert once.covariance[0, 0, 0] == pytest.approx(q, rel=1e-5)


def test_fixed_shape_stays_certain() -> None:
    state = standing()
    state.free[0] = 0
    STRATEGY.prior.prepare(state, unknown())
    n, h = TREE.n_pose, TREE.n_shape
    assert not state.covariance[0, n : n + h].any()
    predict_states(state, 0.04)
    shape = state.shape.copy()
    evidence = replace(proposal(project_state(state).points_m[0]), keypoints_px=project_state(state).pixels[0] + 4.0)
    update_by_observation(state, evidence, SETTINGS, 2)
    np.testing.assert_array_equal(state.shape, shape)


def test_match_gain_is_the_bonus_minus_squared_residuals() -> None:
    state, recent = standing(), unknown()
    match = STRATEGY.score.match
    near, far = (
        match(project_state(state), outcome_with_offset(state, off).frame, recent, STRATEGY.noise, SETTINGS).gain[0]
        for off in (5.0, 10.0)
    )
    np.testing.assert_allclose(near - far, len(CORE) * (10.0**2 - 5.0**2) / SIGMA_PX**2, rtol=1e-6)
    recent.detector_ids[:] = 7
    frame = replace(outcome_with_offset(state, 5.0).frame, track_ids=np.full(VIEWS, 7))
    reference = match(project_state(state), frame, recent, STRATEGY.noise, SETTINGS).gain[0]
    np.testing.assert_allclose(reference - near, SEED.id_bonus, rtol=1e-6)


def test_detections_beyond_the_gate_do_not_match() -> None:
    state = standing()
    off = 1.01 * SIGMA_PX * math.sqrt(SEED.match_gate)
    actual = STRATEGY.score.match(
        project_state(state), outcome_with_offset(state, off).frame, unknown(), STRATEGY.noise, SETTINGS
    )
    assert (actual.gain == -np.inf).all()


def test_scores_are_exponentially_weighted_sums() -> None:
    state, track, dt_s = standing(), tracked_person(), 0.04
    keep = math.exp(-dt_s / SEED.score_memory_s)
    score = STRATEGY.score.track_scores(outcome_with_offset(state, SIGMA_PX), [track], state, SETTINGS)[0]
    gain = SEED.active_views_weight * VIEWS + SEED.active_joints_weight - SEED.active_error_weight
    assert score == pytest.approx(keep * track.log_odds + (1 - keep) * gain, rel=1e-9)
    missed = STRATEGY.score.track_scores(outcome_with_offset(state, 0.0, used=False), [track], state, SETTINGS)[0]
    assert missed == pytest.approx(keep * track.log_odds - (1 - keep) * SEED.active_missing_weight, rel=1e-9)


def tentative_score(rate_hz: float, last_seen_s: float, missed_s: float) -> float:
    """Return the score of a person who stands still for a time and is then not seen."""
    points = project_state(standing()).points_m[0]
    each = TentativeTrack(1, [proposal(points)])
    for i in range(1, round((last_seen_s + missed_s) * rate_hz) + 1):
        time_s = i / rate_hz
        if time_s <= last_seen_s + 1e-9:
            each.observations.append(proposal(points, time_s))
        each.score = STRATEGY.score.tentative_score(each, time_s, 1.0 / rate_hz, SETTINGS)
    return each.score


def test_tentative_scores_do_not_depend_on_the_frame_rate() -> None:
    observed = SEED.pairs_weight + SEED.views_weight * VIEWS - SEED.error_weight
    keep = math.exp(-0.4 / SEED.score_memory_s)
    for rate_hz in (25.0, 100.0):
        assert tentative_score(rate_hz, 0.4, 0.0) == pytest.approx((1 - keep) * observed, rel=1e-9)
    assert tentative_score(25.0, 0.4, 0.4) == pytest.approx(tentative_score(100.0, 0.4, 0.4), rel=1e-9)
    assert tentative_score(25.0, 0.4, 0.4) < tentative_score(25.0, 0.4, 0.0)


def test_varying_bones_lower_the_score() -> None:
    points = project_state(standing()).points_m[0]
    steady, wild = (TentativeTrack(1, [proposal(points), proposal(scale * points, 0.04)]) for scale in (1.0, 1.3))
    scores = [STRATEGY.score.tentative_score(each, 0.04, 0.04, SETTINGS) for each in (steady, wild)]
    keep = math.exp(-0.04 / SEED.score_memory_s)
    variation = 0.3 / math.sqrt(2.0) / 1.15
    assert scores[0] - scores[1] == pytest.approx((1 - keep) * SEED.bones_weight * variation, rel=1e-6)


def settings_with(**changed: Any) -> TrackerSettings:
    """Return the settings with other options of the strategy."""
    options = TrackerOptions(strategy="specification", specification=replace(SEED, **changed))
    return TrackerSettings.of(RIG, SKELETON, SETTINGS.noise, options)


def test_close_groups_merge_at_their_centroid() -> None:
    """Without pair proposals, groups of detections are clustered; with them, clusters of pairs stay as they are."""
    points = project_state(standing()).points_m[0]
    aside = np.array([0.1, 0.0, 0.0])
    near = [proposal(points, n_pairs=2), proposal(points + aside, n_pairs=3, log_odds=2.0)]
    far = proposal(points + np.array([3.0, 0.0, 0.0]))
    merged = STRATEGY.distance.merge([*near, far], settings_with(pair_proposals=False))
    assert [each.n_pairs for each in merged] == [5, 1]
    np.testing.assert_allclose(merged[0].points_m, points + 0.5 * aside, atol=1e-12)
    assert merged[0].log_odds == 2.0
    assert len(STRATEGY.distance.merge([*near, far], SETTINGS)) == 3
    assert len(default.STRATEGY.distance.merge([*near, far], SETTINGS)) == 3


def test_core_matching_ignores_other_keypoints() -> None:
    state, recent = standing(), unknown()
    pixels = project_state(state).pixels[0].copy()
    outside = np.setdiff1d(np.arange(KEYPOINTS), CORE)
    pixels[:, outside] += 30.0
    frame = frame_of(pixels)
    of_core, of_all = (
        STRATEGY.score.match(project_state(state), frame, recent, STRATEGY.noise, settings).gain[0]
        for settings in (SETTINGS, settings_with(core_matching=False))
    )
    np.testing.assert_allclose(of_core - of_all, len(outside) * 2 * 30.0**2 / SIGMA_PX**2, rtol=1e-6)


def test_joint_weights_scale_the_terms_of_the_cost() -> None:
    """The naive sum over core keypoints of delta omega |u - u'|^2 / sigma^2."""
    state, recent = standing(), unknown()
    rng = np.random.default_rng(3)
    frame = frame_of(project_state(state).pixels[0] + rng.uniform(-8.0, 8.0, (VIEWS, KEYPOINTS, 2)))
    weights = {"left_hip": 0.25, "right_wrist": 3.0, "left_knee": 0.0}
    settings = settings_with(joint_weights=tuple(f"{name}={weight}" for name, weight in weights.items()))
    gain = STRATEGY.score.match(project_state(state), frame, recent, STRATEGY.noise, settings).gain[0]
    projected = project_state(state).pixels[0]
    for v in range(VIEWS):
        cost = 0.0
        for k in CORE:
            off = frame.keypoints_px[v, k] - projected[v, k]
            cost += weights.get(SKELETON.keypoints[k], 1.0) * float(off @ off) / SIGMA_PX**2
        assert specification._MATCH_GAIN - gain[v] == pytest.approx(cost, rel=1e-6)


def test_joint_weight_of_an_unknown_keypoint_names_the_keypoints() -> None:
    with pytest.raises(OptionsError, match="joint_weights names 'hip', which is no keypoint of the skeleton 'body_20'"):
        STRATEGY.configure(settings_with(joint_weights=("hip=1",)))
    with pytest.raises(OptionsError, match="finite weights of at least 0, got left_hip=-1.0"):
        replace(SEED, joint_weights=("left_hip=-1",))


def test_moving_person_continues_only_with_velocities() -> None:
    """A tentative track at 2 m/s that is not seen for 0.5 s is 1 m from its last observation."""
    points, velocity = project_state(standing()).points_m[0], np.array([2.0, 0.0, 0.0])
    track = TentativeTrack(1, [proposal(points + t * velocity, t) for t in np.arange(0.0, 0.41, 0.04)])
    new = proposal(points + 0.9 * velocity, 0.9)
    assert STRATEGY.distance.distance(track, new, SETTINGS) < 0.5
    assert STRATEGY.distance.distance(track, new, settings_with(tentative_motion=False)) == math.inf


def test_promotion_figures_are_those_of_the_buffer() -> None:
    """Hits in the last L, mean views and errors, and raw variation; the default counts all frames."""
    points = project_state(standing()).points_m[0]
    times_s = [0.0, 0.04, 0.08, *np.arange(0.6, 1.01, 0.08)]
    track = TentativeTrack(1, [proposal(points, t) for t in times_s], frames=26)
    track.observations[:3] = [replace(each, error_sigma=9.0) for each in track.observations[:3]]
    track.observations[-1] = replace(track.observations[-1], error_sigma=4.0, rows=np.array([0, 1, -1, -1]))
    mine, shared = (each.initiation.figures(track, SETTINGS) for each in (STRATEGY, default.STRATEGY))
    assert (mine.n_hits, mine.n_frames) == (6, 11)
    assert mine.error_sigma == pytest.approx((5 * 1.0 + 4.0) / 6)
    assert mine.n_views == pytest.approx((5 * VIEWS + 2) / 6)
    assert (shared.n_hits, shared.n_frames) == (9, 26)
    assert shared.error_sigma == 1.0
    rng = np.random.default_rng(0)
    noisy = [replace(e, points_m=points + 0.01 * rng.standard_normal(points.shape)) for e in track.observations]
    noisy_track = replace(track, observations=noisy)
    lengths = [np.linalg.norm(e.points_m[7] - e.points_m[9]) for e in noisy[3:]]
    raw = STRATEGY.initiation.figures(noisy_track, SETTINGS).bone_variation
    assert raw == pytest.approx(np.std(lengths, ddof=1) / np.mean(lengths), rel=0.6)
    assert default.STRATEGY.initiation.figures(noisy_track, SETTINGS).bone_variation < raw


def lost_and_found(aside_m: float) -> tuple[list[Track], State, Observation]:
    state, track = standing(), tracked_person()
    track.state = TrackState.LOST
    observed = proposal(project_state(state).points_m[0] + np.array([aside_m, 0.0, 0.0]), 1.0)
    return [track], state, observed


def test_cost_of_reacquisition_is_that_of_the_equation() -> None:
    rng = np.random.default_rng(5)
    (_, state, observed), pelvis = lost_and_found(0.0), SKELETON.index("mid_hip")
    observed = replace(observed, points_m=observed.points_m + 0.1 * rng.standard_normal((KEYPOINTS, 3)))
    predicted = project_state(state).points_m[0]
    expected = float(((observed.points_m[pelvis] - predicted[pelvis]) ** 2).sum()) / SEED.tau_root_m**2
    for k in CORE:
        theirs, mine = observed.points_m[k] - observed.points_m[pelvis], predicted[k] - predicted[pelvis]
        expected += SEED.core_weight * float(((theirs - mine) ** 2).sum()) / SEED.tau_core_m**2
    for settings in (SETTINGS, settings_with(normalized_distance=True)):
        cost = reacquisition_cost(state, [0], [observed], settings)
        assert cost[0, 0] == pytest.approx(expected, rel=1e-9)


def test_lost_track_is_found_close_to_its_prediction() -> None:
    (tracks, state, observed) = lost_and_found(0.2)
    actual = STRATEGY.distance.find_lost(tracks, state, state, observed, 1.0, 1.0, SETTINGS)
    assert actual is not None
    assert actual.track == 0
    elsewhere = replace(observed, points_m=observed.points_m + np.array([0.0, 2.0, 0.0]))
    assert STRATEGY.distance.find_lost(tracks, state, state, elsewhere, 1.0, 1.0, SETTINGS) is None
    tracks[0].state = TrackState.ACTIVE
    assert STRATEGY.distance.find_lost(tracks, state, state, observed, 1.0, 1.0, SETTINGS) is None


def test_each_lost_track_is_reacquired_by_its_best_proposal() -> None:
    tracks, state, seen = lost_and_found(0.1)
    nearer = replace(seen, points_m=seen.points_m - np.array([0.05, 0.0, 0.0]))
    near, far, nearest = (
        TentativeTrack(1, [each])
        for each in (seen, replace(seen, points_m=seen.points_m + np.array([0.0, 2.0, 0.0])), nearer)
    )
    found = STRATEGY.distance.find_reacquired(tracks, state, [near, far, nearest], SETTINGS)
    assert [(match.track, each.observations[0] is nearer) for match, each in found] == [(0, True)]
    assert not STRATEGY.distance.find_reacquired(tracks, state, [far], SETTINGS)
    off = settings_with(same_frame_reacquisition=False)
    assert not STRATEGY.distance.find_reacquired(tracks, state, [near], off)


def updated_shape(settings: TrackerSettings, update_m: float) -> np.ndarray:
    """Return the change of the lengths by an update that moves all of them from the prior's mean."""
    state = standing()
    state.shape[:] += 0.02
    before = state.shape.copy()
    opened = STRATEGY.prior.open_shape(state, np.array([[0, -1, -1, -1]]), settings)
    state.shape[:] += update_m
    STRATEGY.prior.close_shape(opened, state, settings)
    return (state.shape - before)[0]


def test_lengths_move_by_a_fraction_of_the_step() -> None:
    """The step starts at the minimum of |b - b'|^2 + lambda |b - b0|^2 in units of the tree's covariance."""
    for weight, gain in ((1.0, 0.1), (3.0, 0.5)):
        settings = settings_with(shape_weight=weight, shape_gain=gain)
        step = 0.01 - 0.02 * weight / (1.0 + weight)
        np.testing.assert_allclose(updated_shape(settings, 0.01), gain * step, rtol=1e-9)
    np.testing.assert_allclose(updated_shape(settings_with(shape_gain=None), 0.01), 0.01, rtol=1e-9)


def test_lengths_stay_without_a_detection_and_when_fixed() -> None:
    state = standing()
    before = state.shape.copy()
    for free, row in ((1, -1), (0, 0)):
        state.free[0] = free
        opened = STRATEGY.prior.open_shape(state, np.full((1, VIEWS), row), SETTINGS)
        assert opened is not None
        assert np.isnan(opened).all()
    np.testing.assert_array_equal(state.shape, before)


def test_tracks_are_terminated_by_variance_and_volume_by_default() -> None:
    configured = STRATEGY.configure(SETTINGS).options
    assert configured.terminate_beyond_m == pytest.approx(math.sqrt(SEED.terminate_variance_m2 or 0.0))
    assert configured.terminate_outside_after_s == SEED.terminate_outside_after_s == 1.0
    off = STRATEGY.configure(settings_with(terminate_variance_m2=None, terminate_outside_after_s=None)).options
    assert off.terminate_beyond_m is off.terminate_outside_after_s is None
    own = replace(SETTINGS, options=replace(SETTINGS.options, terminate_beyond_m=0.5, terminate_outside_after_s=7.0))
    assert STRATEGY.configure(own).options.terminate_beyond_m == 0.5
    assert STRATEGY.configure(own).options.terminate_outside_after_s == 7.0
    assert default.STRATEGY.configure(SETTINGS) is SETTINGS


def test_lost_track_ends_once_the_trace_of_its_covariance_is_large() -> None:
    """tr(P) of the root, against a threshold in m^2."""
    state, track = standing(), tracked_person()
    track.state, track.established = TrackState.LOST, True
    track.last_seen_s = track.last_inside_s = 0.9
    options = STRATEGY.configure(settings_with(terminate_variance_m2=4.0))
    for trace_m2, ends in ((3.9, False), (4.1, True)):
        state.covariance[0, :3, :3] = np.eye(3) * trace_m2 / 3.0
        assert (tracks_to_terminate([track], state, 1.0, options) != {}) == ends
    off = STRATEGY.configure(settings_with(terminate_variance_m2=None, terminate_outside_after_s=None))
    assert not tracks_to_terminate([track], state, 1.0, off)


def test_lost_track_ends_outside_the_volume() -> None:
    state, track = standing(), tracked_person()
    track.state, track.established = TrackState.LOST, True
    track.last_seen_s, track.last_inside_s = 2.0, 1.5
    state.covariance[0, :3, :3] = 0.0
    options = STRATEGY.configure(SETTINGS)
    assert not tracks_to_terminate([track], state, 2.4, options)
    assert tracks_to_terminate([track], state, 2.6, options)
    off = STRATEGY.configure(settings_with(terminate_outside_after_s=None))
    assert not tracks_to_terminate([track], state, 2.6, off)


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    """Return 100 frames of three people with all detector errors."""
    return simulate_crowd(CrowdOptions(people=3, duration_s=4.0, seed=1))


def tracker_for(scene: CrowdScene) -> ArticulatedTracker:
    options = Options(tracker=TrackerOptions(strategy="specification"))
    return tracker_of(scene.rig, scene.detections.skeleton, default_noise(scene.rig, options), options)


def track_frames(tracker: ArticulatedTracker, scene: CrowdScene, frames: range) -> list[People]:
    return [tracker.update(Frame.of(scene.detections, i)) for i in frames]


def active_points(results: Sequence[People]) -> list[dict[str, np.ndarray]]:
    return [{p.name: p.points_m for p in people.people if p.state == TrackState.ACTIVE} for people in results]


def test_simple_crowd_is_tracked(scene: CrowdScene) -> None:
    n = scene.detections.n_frames
    results = active_points(track_frames(tracker_for(scene), scene, range(n)))
    truth = np.asarray(scene.truth.layers["measured"].points_m)
    assert [sorted(people) for people in results[n // 2 :]] == [sorted(results[-1])] * (n - n // 2)
    assert len(results[-1]) == truth.shape[1]
    owners = []
    for name in results[-1]:
        points = np.stack([people[name] for people in results[n // 2 :]])
        off = np.nanmean(np.linalg.norm(points[:, None] - truth[n // 2 :], axis=-1), axis=-1)
        owners.append(int(off.mean(axis=0).argmin()))
        # Velocities that persist overshoot: without them, the errors are half as large.
        assert off[:, owners[-1]].max() < 0.35
        assert off[:, owners[-1]].mean() < 0.15
    assert sorted(owners) == list(range(truth.shape[1]))


def test_pickled_tracker_resumes(scene: CrowdScene) -> None:
    half = scene.detections.n_frames // 2
    tracker = tracker_for(scene)
    track_frames(tracker, scene, range(half))
    again = pickle.loads(pickle.dumps(tracker))
    rest = range(half, scene.detections.n_frames)
    for one, other in zip(
        active_points(track_frames(tracker, scene, rest)), active_points(track_frames(again, scene, rest)), strict=True
    ):
        assert list(one) == list(other)
        for name in one:
            np.testing.assert_allclose(one[name], other[name], rtol=0, atol=1e-6)


def test_specification_disables_the_smoother(scene: CrowdScene) -> None:
    assert tracker_for(scene).settings.options.smoother == "none"
    assert TrackerOptions().smoother == "full"


def test_lengths_are_in_proportion_to_bodies() -> None:
    small = TrackerOptions().in_proportion(0.1).specification
    assert small.tau_root_m == pytest.approx(0.1 * SEED.tau_root_m)
    assert small.tau_core_m == pytest.approx(0.1 * SEED.tau_core_m)
    assert small.core_fit_sd_m == pytest.approx(0.1 * SEED.core_fit_sd_m)
    assert small.terminate_variance_m2 == pytest.approx(0.01 * (SEED.terminate_variance_m2 or 0.0))
    assert small.tentative_speed_m_s == pytest.approx(0.1 ** (2.0 / 3.0) * SEED.tentative_speed_m_s)
    assert small.match_gate == SEED.match_gate


@pytest.mark.parametrize(
    ("given_", "message"),
    [
        ({"tau_root_m": 0.0}, "tracker.specification.tau_root_m must be a finite number above 0 m, got 0.0"),
        ({"max_noise": 0.1}, "max_noise must be at least min_noise"),
        ({"id_bonus": math.inf}, "tracker.specification.id_bonus must be a finite number of at least 0, got inf"),
    ],
)
def test_invalid_weights_are_named(given_: dict[str, float], message: str) -> None:
    with pytest.raises(OptionsError, match=message):
        replace(SpecificationOptions(), **given_)


def test_unknown_strategy_raises() -> None:
    with pytest.raises(OptionsError, match="tracker.strategy must be one of posefuse, specification, got 'seed'"):
        TrackerOptions(strategy="seed")  # type: ignore[arg-type]
