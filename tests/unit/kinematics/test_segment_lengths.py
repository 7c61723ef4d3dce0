"""Bone lengths: information of observations, identification by lengths, and restored tracks."""

import numpy as np
import pytest

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state
from posefuse.kinematics.segment_lengths import length_information, measured_lengths
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.lifecycle import LifecycleThresholds, fix_shape, new_track, restore_track
from posefuse.tracking.records import Track
from posefuse.tracking.reidentification import same_body_log_odds
from posefuse.tracking.settings import TrackerSettings

BOUNDS = LifecycleThresholds(3.0, -2.0, 3.0)
SKELETON = shipped_skeleton("body_20")
HUMAN = SKELETON.tree
assert HUMAN is not None
TREE = HUMAN
N, H = TREE.n_pose, TREE.n_shape
SHAPE = slice(N, N + H)
# As returns.py has them, of a body of a human's size.
DEFINITION = (0.03 * np.abs(TREE.shape_m) + 0.01) ** 2


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    return TrackerSettings.of(build_rig("ring", 3), SKELETON, NoiseModel(np.full(3, 4.5), 1.0), TrackerOptions())


def posterior(measured: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return measured lengths relative to those of the mean adult."""
    covariance = np.linalg.inv(np.linalg.inv(TREE.shape_covariance) + information)
    return TREE.shape_m + covariance @ information @ measured, covariance


def body(settings: TrackerSettings, mean_m: np.ndarray, covariance: np.ndarray) -> State:
    """Return the state of a person at rest."""
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [0.0, 0.0, 0.9]
    return initial_state(TREE, points, mean_m, covariance, settings.options.motion)


def random_information(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(0.0, 20.0, (H, 2 * H))
    return root @ root.T


def test_prior_is_removed_completely(rng):
    information, measured = random_information(rng), rng.normal(0.0, 0.05, H)
    actual, pull = length_information(TREE, *posterior(measured, information))
    np.testing.assert_allclose(actual, information, rtol=1e-6, atol=1e-6 * np.abs(information).max())
    np.testing.assert_allclose(pull, information @ measured, rtol=1e-6)
    back, errors = measured_lengths(TREE, *posterior(measured, information))
    np.testing.assert_allclose(back, measured, atol=1e-7)
    np.testing.assert_allclose(errors @ information, np.eye(H), atol=1e-5)


def test_prior_alone_holds_no_information(settings):
    information, pull = length_information(TREE, TREE.shape_m, 1.001 * TREE.shape_covariance)
    assert np.linalg.eigvalsh(information).min() > 0.0
    assert np.abs(information @ TREE.shape_covariance).max() < 1e-3
    assert np.abs(pull).max() == 0.0
    track = new_track(1, 0.0, BOUNDS)
    prior_body = body(settings, TREE.shape_m, TREE.shape_covariance)
    assert same_body_log_odds(settings, track, prior_body, 0, prior_body, 0.1) == pytest.approx(0.0, abs=1e-3)


def white_noise_posterior(
    settings: TrackerSettings, lengths: np.ndarray, sd_m: float, correlation_factor: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return a posterior of a filter that assumes white errors, while errors are correlated."""
    information = np.eye(H) / sd_m**2
    errors = rng.normal(0.0, np.sqrt(0.5 * DEFINITION + correlation_factor * sd_m**2))
    return posterior(lengths + errors, information)


def correlation_factor(settings: TrackerSettings, duration_s: float) -> float:
    o = settings.options
    return (1.0 + 0.5 * duration_s / o.error_memory_s) / (1.0 + 0.5 * duration_s / o.smoother_error_memory_s)


@pytest.mark.parametrize(
    ("known_sd_m", "new_sd_m", "duration_s"), [(0.005, 0.02, 0.12), (0.005, 0.05, 1.2), (0.03, 0.05, 0.12)]
)
def test_log_odds_equal_the_likelihood_ratio(settings, known_sd_m, new_sd_m, duration_s):
    """For bodies sampled from the model, the odds are calibrated."""
    rng = np.random.default_rng(5)
    track = new_track(1, 0.0, BOUNDS)
    track.shape_observed_s = settings.options.fix_shape_after_s
    odds: dict[bool, list[float]] = {True: [], False: []}
    spread, new_body = np.linalg.cholesky(TREE.shape_covariance), body(settings, TREE.shape_m, TREE.shape_covariance)
    for _ in range(400):
        for same, actual in odds.items():
            second, other = rng.normal(size=(2, H)) @ spread.T
            track.known_shape = white_noise_posterior(
                settings, second, known_sd_m, correlation_factor(settings, track.shape_observed_s), rng
            )
            new = white_noise_posterior(
                settings, second if same else other, new_sd_m, correlation_factor(settings, duration_s), rng
            )
            new_body.shape[0], new_body.covariance[0, SHAPE, SHAPE] = new
            actual.append(same_body_log_odds(settings, track, new_body, 0, new_body, duration_s))
    same, other = np.array(odds[True]), np.array(odds[False])
    assert np.mean(np.exp(-same)) == pytest.approx(1.0, abs=0.35)
    both, truly = np.concatenate([same, other]), np.repeat([1.0, 0.0], 400)
    for low, high in ((-np.inf, -1.0), (-1.0, 1.0), (1.0, np.inf)):
        within = (both > low) & (both < high)
        expected = np.mean(1.0 / (1.0 + np.exp(-both[within])))
        assert truly[within].mean() == pytest.approx(expected, abs=3.5 * 0.5 / np.sqrt(within.sum()))


def observe_for(
    settings: TrackerSettings, track: Track, state: State, seconds: float, start_s: float, views: int = 2
) -> float:
    """Observe a person for a duration, and return the time after it."""
    frames = round(25 * seconds)
    for k in range(1, frames + 1):
        now_s = start_s + k / 25
        if views > 1:
            track.last_multiview_s = now_s
        fix_shape(track, state, 0, now_s, 0.04, settings)
    return start_s + seconds


def test_absence_does_not_count_as_observation(settings, rng):
    track = new_track(1, 0.0, BOUNDS)
    state = body(settings, *posterior(rng.normal(0.0, 0.05, H), random_information(rng)))
    now_s = observe_for(settings, track, state, 2.4, 0.0)
    track.state = TrackState.LOST
    now_s = observe_for(settings, track, state, 3.0, now_s, views=0)
    track.state = TrackState.ACTIVE
    now_s = observe_for(settings, track, state, 1.2, now_s)
    now_s = observe_for(settings, track, state, 5.0, now_s, views=1)
    assert state.free[0]
    assert track.shape_observed_s == pytest.approx(3.6)
    now_s = observe_for(settings, track, state, 0.6, now_s)
    assert not state.free[0]
    assert track.known_shape is not None


def test_restored_track_combines_both_observations(settings, rng):
    """A track restored before its lengths were fixed has the combination of both observations."""
    information = [random_information(rng) for _ in range(2)]
    measured = rng.normal(0.0, 0.05, (2, H))
    before, actual = (body(settings, *posterior(*each)) for each in zip(measured, information, strict=True))
    actual.root[0] = [1.0, 2.0, 0.9]
    restore_track(before, 0, actual, settings)
    together = information[0] + information[1]
    pull = information[0] @ measured[0] + information[1] @ measured[1]
    mean, covariance = posterior(np.linalg.solve(together, pull), together)
    np.testing.assert_allclose(before.shape[0], mean, atol=1e-9)
    np.testing.assert_allclose(before.covariance[0, SHAPE, SHAPE], covariance, atol=1e-10)
    np.testing.assert_allclose(before.root[0], actual.root[0], atol=1e-9)
    assert before.free[0]


def test_pose_follows_corrected_lengths(settings, rng):
    """The pose changes by its correlation with the lengths."""
    actual = body(settings, TREE.shape_m, 1e-3 * np.eye(H))
    actual.covariance[0, 2, N] = actual.covariance[0, N, 2] = 0.5e-3
    longer = TREE.shape_m.copy()
    longer[0] += 0.02
    before = body(settings, longer, 1e-12 * np.eye(H))
    restore_track(before, 0, actual, settings)
    assert before.shape[0, 0] == pytest.approx(longer[0], abs=1e-6)
    assert before.root[0, 2] == pytest.approx(actual.root[0, 2] + 0.5 * 0.02, abs=1e-6)


def test_fixed_lengths_do_not_change(settings, rng):
    before = body(settings, TREE.shape_m + 0.01, 1e-4 * np.eye(H))
    before.free[0] = 0
    actual = body(settings, TREE.shape_m, 1e-3 * np.eye(H))
    restore_track(before, 0, actual, settings)
    np.testing.assert_array_equal(before.shape[0], TREE.shape_m + 0.01)
    assert not before.free[0]
    assert not before.covariance[0, SHAPE].any()
