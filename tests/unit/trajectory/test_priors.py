"""Priors estimated from a recording."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.error_level import ErrorLevel
from posefuse.trajectory.observations import PersonObservations
from posefuse.trajectory.path_solver import PathSolver
from posefuse.trajectory.paths import PersonPriors
from posefuse.trajectory.priors import RecordingPriors, estimate_priors, margin_s
from posefuse.trajectory.smoothness import Smoothness
from tests.scenes import ring
from tests.unit.trajectory.path_problems import ARM, exact_pixels, measured, part_of, solved, swinging


def white_jerk(frames: int, density: float, seed: int) -> np.ndarray:
    """Return paths with white-noise jerk of a known density and a weak restoring force, shape (frame, 3, 3)."""
    rng = np.random.default_rng(seed)
    rows = Smoothness.of("jerk", np.arange(frames) / 60.0)
    dense = np.zeros((frames, frames))
    for row, w in enumerate(rows.time_s / density):
        dense[row : row + 4, row : row + 4] += w * np.outer(rows.differences[row], rows.differences[row])
    dense += np.eye(frames) / 0.3**2
    draws = np.linalg.solve(np.linalg.cholesky(dense).T, rng.standard_normal((frames, 9)))
    return swinging(1) + draws.reshape(frames, 3, 3)


def test_density_of_white_jerk_is_estimated():
    truth = white_jerk(500, 40.0, 1)
    recording_priors = estimate_priors([measured(truth)], ARM, TrajectoryOptions())
    # The estimate is doubled because motion is not white noise; the tie to a position reduces it.
    assert np.allclose(np.log(recording_priors.density[0] / 80.0), 0.0, atol=0.7)


def test_bone_lengths_and_variations_are_estimated():
    truth = swinging(600)
    truth[:, 2] = (
        truth[:, 1] + (truth[:, 2] - truth[:, 1]) * (1.0 + 0.1 * np.sin(np.arange(600) * np.pi / 100.0))[:, None]
    )
    recording_priors = estimate_priors([measured(truth)], ARM, TrajectoryOptions())
    assert recording_priors.length_m[0] == pytest.approx([0.3, 0.25], rel=0.01)
    assert recording_priors.length_sd_m[0, 0] < 0.003
    assert recording_priors.length_sd_m[0, 1] == pytest.approx(0.25 * 0.1 / np.sqrt(2.0), rel=0.2)


def test_variation_of_rigid_bones_is_limited():
    truth = swinging(600)
    stretched = 1.0 + 0.2 * np.sin(np.arange(600) * np.pi / 100.0)[:, None]
    truth[:, 2] = truth[:, 1] + (truth[:, 2] - truth[:, 1]) * stretched
    measurements = measured(truth)
    soft = estimate_priors([measurements], ARM, TrajectoryOptions())
    rigid = estimate_priors(
        [measurements], replace(ARM, rigid=(("wrist", "elbow"),)), TrajectoryOptions(max_rigid_bone_variation=0.02)
    )
    assert soft.length_sd_m[0, 1] > 0.1 * soft.length_m[0, 1]
    assert rigid.length_sd_m[0, 1] == pytest.approx(0.02 * rigid.length_m[0, 1])
    assert rigid.length_sd_m[0, 0] == pytest.approx(soft.length_sd_m[0, 0])


@pytest.mark.parametrize("seed", range(4))
def test_errors_of_a_short_recording_are_no_variation_of_lengths(seed):
    """In 12 frames, errors scatter by more than their expectation, by chance."""
    truth = swinging(12)
    rig = ring(4)
    pixels = exact_pixels(rig, truth) + 4.0 * np.random.default_rng(seed).standard_normal((12, 4, 3, 2))
    options = TrajectoryOptions()
    found = estimate_priors([measured(truth, 4.0, rig=rig, pixels=pixels)], ARM, options)
    assert found.length_sd_m[0] == pytest.approx(options.min_bone_variation * found.length_m[0])


def test_one_period_of_large_errors_does_not_affect_all_frames(monkeypatch):
    count = np.full((3, 600, 4), 20.0)
    total = np.random.default_rng(0).chisquare(20.0, count.shape)
    wild = total.copy()
    wild[1, 100:103, 2] *= 150.0**2
    observed = PersonObservations.of(measured(swinging(600)), 0)
    person_priors = PersonPriors(np.empty(0), np.empty(0), np.empty(0), 0.0, 1.0)
    solver = PathSolver(
        observed, Smoothness.of("jerk", observed.time_s), Bones.none(observed.sigma_px.shape[0]), TrajectoryOptions()
    )
    monkeypatch.setattr(ErrorLevel, "_new_errors", lambda *_: (wild, count))
    innovation_scale, scale_strength = solver.error_level.estimate(person_priors)
    assert innovation_scale == pytest.approx(1.0, abs=0.02)
    assert scale_strength > 5.0


def lasting_noise(shape: tuple[int, ...], kept: float, rng: np.random.Generator) -> np.ndarray:
    noise = rng.standard_normal(shape)
    for f in range(1, len(noise)):
        noise[f] = kept * noise[f - 1] + np.sqrt(1.0 - kept**2) * noise[f]
    return noise


@pytest.mark.parametrize("views", [3, 5])
def test_correlation_time_of_errors_is_estimated(views):
    rig, truth = ring(views), swinging(1200)
    pixels = exact_pixels(rig, truth)
    persistent_ratio = pixels + 2.0 * lasting_noise(pixels.shape, 0.9, np.random.default_rng(0))
    recording_priors = estimate_priors(
        [measured(truth, rig=rig, pixels=persistent_ratio, noise_px=2.0)], ARM, TrajectoryOptions()
    )
    assert np.exp(-1.0 / 60.0 / recording_priors.correlation_s) == pytest.approx(0.9, abs=0.03)
    white = estimate_priors([measured(truth, rig=rig)], ARM, TrajectoryOptions())
    assert white.correlation_s == 0.0


def test_persistent_errors_do_not_smooth_motion():
    rig, truth = ring(4), swinging(300)
    pixels = exact_pixels(rig, truth)
    rng = np.random.default_rng(0)
    biased = pixels + 8.0 * rng.standard_normal(pixels[:1].shape) + rng.standard_normal(pixels.shape)
    measurements = measured(truth, rig=rig, pixels=biased, noise_px=8.0)
    recording_priors = estimate_priors([measurements], ARM, TrajectoryOptions())
    assert recording_priors.persistent_fraction > 0.8
    assert recording_priors.correlation_s == 0.0
    layer = solved(measurements, recording_priors)
    offset = np.asarray(layer.points_m)[:, 0] - truth
    plain = estimate_priors([measured(truth, 1.0, rig=rig)], ARM, TrajectoryOptions())
    assert np.isfinite(offset).all()
    # Nearly as smooth as without bias, not as if the bias were noise: that has 8^(1/3) times the time constant.
    assert np.median(recording_priors.time_constant_s) < 1.5 * np.median(plain.time_constant_s)
    assert recording_priors.length_sd_m[0] == pytest.approx(0.0, abs=0.02)


def test_ranges_give_the_same_priors_as_the_whole():
    measurements = measured(swinging(600))
    whole = estimate_priors([measurements], ARM, TrajectoryOptions())
    parts = estimate_priors(
        (part_of(measurements, start, start + 200) for start in (0, 200, 400)), ARM, TrajectoryOptions()
    )
    assert np.allclose(np.log(parts.density / whole.density), 0.0, atol=0.7)
    assert np.allclose(parts.length_m, whole.length_m, rtol=2e-3)


def test_given_density_is_used():
    recording_priors = estimate_priors([measured(swinging(100))], ARM, TrajectoryOptions(density=12.0))
    assert (recording_priors.density == 12.0).all()


def test_priors_can_be_pickled_and_give_the_margin():
    recording_priors = estimate_priors([measured(swinging(200))], ARM, TrajectoryOptions(max_gap_s=0.3))
    again = pickle.loads(pickle.dumps(recording_priors))
    assert isinstance(again, RecordingPriors)
    assert np.array_equal(again.density, recording_priors.density)
    assert 0.3 < margin_s(recording_priors) < 3.0


def test_no_frames_is_an_error():
    with pytest.raises(DetectionsError, match="needs at least one frame"):
        estimate_priors([], ARM, TrajectoryOptions())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("prior", "snap"),
        ("density", 0.0),
        ("density_window_s", -1.0),
        ("density_prior_s", 0.0),
        ("min_bone_variation", -0.1),
        ("max_rigid_bone_variation", 0.001),
        ("correlation_s", -1.0),
        ("max_gap_s", np.inf),
        ("max_sd_share", 0.0),
        ("full_weight_sigma", 6.0),
        ("iterations", 0),
    ],
)
def test_invalid_options_are_named(name, value):
    with pytest.raises(OptionsError, match=rf"trajectory\.{name}"):
        TrajectoryOptions(**{name: value})
