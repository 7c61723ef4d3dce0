"""State of tentative tracks, against ordinary least squares over the buffer."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.association.proposal_distance import core_poses
from posefuse.association.trunk import full, six
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.records import Observation, TentativeTrack
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies.tentative_state import buffer_of, tentative_state

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 4)
OPTIONS = TrackerOptions(strategy="specification")
SETTINGS = TrackerSettings.of(RIG, SKELETON, NoiseModel(np.full(4, 5.0), 1.0), OPTIONS)
AT_REST = replace(
    SETTINGS, options=replace(OPTIONS, specification=replace(OPTIONS.specification, tentative_motion=False))
)
SPEED_M_S = OPTIONS.specification.tentative_speed_m_s


def observation(time_s: float, points_m: np.ndarray, covariance_m2: np.ndarray) -> Observation:
    shape = (len(RIG), len(SKELETON))
    return Observation(
        time_s, 0, np.full((*shape, 2), np.nan), np.full(shape, np.nan), np.arange(len(RIG)), points_m, covariance_m2,
        np.nanmean(points_m, axis=0), 1.0, 1.0,
    )  # fmt: skip


def observations_of(rng: np.random.Generator, times_s: np.ndarray) -> list[Observation]:
    """Return observations of a person who moves, with different covariances and a keypoint that is missing once."""
    start, velocity = rng.normal(size=(2, len(SKELETON), 3))
    observations = []
    for i, time_s in enumerate(times_s):
        factor = 0.03 * rng.normal(size=(len(SKELETON), 3, 3))
        covariance = factor @ np.swapaxes(factor, 1, 2) + 1e-4 * np.eye(3)
        points = start + time_s * velocity + 0.02 * rng.normal(size=start.shape)
        if i == 1:
            points[SKELETON.core_indices[0]] = np.nan
        observations.append(observation(float(time_s), points, six(covariance)))
    return observations


def naive_line(times_s, points, covariances, speed_m_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity at time 0, and their covariance, by whitened rows of an ordinary least squares."""
    rows, right = [np.hstack([np.zeros((3, 3)), np.eye(3) / speed_m_s])], [np.zeros(3)]
    for time_s, point, covariance in zip(times_s, points, covariances, strict=True):
        if np.isfinite(point).all():
            whiten = np.linalg.inv(np.linalg.cholesky(covariance + 1e-8 * np.eye(3)))
            rows.append(whiten @ np.hstack([np.eye(3), time_s * np.eye(3)]))
            right.append(whiten @ point)
    matrix = np.vstack(rows)
    return np.linalg.lstsq(matrix, np.concatenate(right), rcond=None)[0], np.linalg.inv(matrix.T @ matrix)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 6), st.floats(0.0, 0.5))
def test_state_is_the_weighted_line_through_the_buffer(seed: int, n: int, ahead_s: float) -> None:
    rng = np.random.default_rng(seed)
    times_s = np.cumsum(rng.uniform(0.02, 0.1, n))
    seen, now_s = observations_of(rng, times_s), float(times_s[-1]) + ahead_s
    state = tentative_state(seen, now_s, SETTINGS)
    pelvis, since_s = SKELETON.index("mid_hip"), times_s - now_s
    spreads = [full(each.covariance_m2) for each in seen]
    root, root_spread = naive_line(
        since_s, [each.points_m[pelvis] for each in seen], [each[pelvis] for each in spreads], SPEED_M_S
    )
    np.testing.assert_allclose(state.poses.root_m, root[:3], atol=1e-7)
    np.testing.assert_allclose(state.root_velocity_m_s, root[3:], atol=1e-6)
    np.testing.assert_allclose(state.poses.root_covariance_m2, root_spread[:3, :3], atol=1e-9)
    for i, k in enumerate(SKELETON.core_indices):
        line, spread = naive_line(
            since_s,
            [each.points_m[k] - each.points_m[pelvis] for each in seen],
            [each[k] + each[pelvis] for each in spreads],
            SPEED_M_S,
        )
        if any(np.isfinite(each.points_m[k]).all() for each in seen):
            np.testing.assert_allclose(state.poses.core_m[i], line[:3], atol=1e-7)
            np.testing.assert_allclose(state.core_velocity_m_s[i], line[3:], atol=1e-6)
            np.testing.assert_allclose(state.poses.core_covariance_m2[i], spread[:3, :3], atol=1e-9)


def test_uncertainty_grows_with_time(rng: np.random.Generator) -> None:
    seen = observations_of(rng, np.array([0.0, 0.04, 0.08]))
    traces = [float(np.trace(tentative_state(seen, t, SETTINGS).poses.root_covariance_m2)) for t in (0.08, 0.2, 0.6)]
    assert traces[0] < traces[1] < traces[2]


def test_without_motion_the_state_is_the_last_observation(rng: np.random.Generator) -> None:
    seen = observations_of(rng, np.array([0.0, 0.04, 0.08]))
    state = tentative_state(seen, 0.5, AT_REST)
    last = core_poses(seen[-1].points_m, seen[-1].covariance_m2, SKELETON)
    np.testing.assert_array_equal(state.poses.root_m, last.root_m)
    np.testing.assert_array_equal(state.poses.core_m, last.core_m)
    np.testing.assert_array_equal(state.root_velocity_m_s, 0.0)
    moving = tentative_state(seen, 0.5, SETTINGS)
    assert np.linalg.norm(moving.poses.root_m - last.root_m) > 0.1


def test_buffer_holds_the_latest_observations(rng: np.random.Generator) -> None:
    times_s = np.arange(0.0, 1.01, 0.1)
    track = TentativeTrack(1, observations_of(rng, times_s))
    held = [each.time_s for each in buffer_of(track, SETTINGS)]
    assert held == pytest.approx([0.6, 0.7, 0.8, 0.9, 1.0])
