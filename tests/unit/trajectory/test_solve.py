"""Trajectory solve: invariances, accuracy, outlier rejection and agreement with a general solver."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from posefuse.model.cameras import CameraRig
from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.reconstruction import Layer, unpack_covariance
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.skeleton.skeletons import Skeleton
from posefuse.trajectory.bone_system import _BONE_CORRELATION_S, _MAX_RELATIVE_STIFFNESS
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.observations import MeasuredRange, PersonObservations
from posefuse.trajectory.path_solver import PathSolver
from posefuse.trajectory.paths import CONSTANT_LEVEL_STRENGTH
from posefuse.trajectory.priors import RecordingPriors, estimate_priors, margin_s
from posefuse.trajectory.smoothness import Smoothness
from tests.scenes import ring
from tests.unit.trajectory.path_problems import (
    ARM,
    errors_m,
    exact_pixels,
    measured,
    part_of,
    solved,
    swinging,
)

FRAMES = 240
PLAIN = TrajectoryOptions(density_window_s=0.0, full_weight_sigma=50.0, zero_weight_sigma=100.0, max_sd_share=10.0)


def priors_of(
    density: float, length_sd_m: float = np.inf, inflation: float = 1.0, keypoints: int = 3
) -> RecordingPriors:
    return RecordingPriors(
        density=np.full((1, keypoints), density),
        length_m=np.array([[0.3, 0.25]]),
        length_sd_m=np.full((1, 2), length_sd_m),
        correlation_s=0.0,
        persistent_fraction=0.0,
        innovation_scale=np.ones(1),
        scale_strength=np.full(1, CONSTANT_LEVEL_STRENGTH),
        size_m=np.array([0.5]),
        time_constant_s=np.full((1, keypoints), 0.03),
        max_gap_s=0.5,
        roughness_m2=np.zeros((1, keypoints)),
        inflation=np.full((1, keypoints), inflation),
        error_variance=np.ones(1),
        variance_m2=np.full((1, keypoints), np.nan),
    )


@pytest.fixture(scope="module")
def arm() -> MeasuredRange:
    return measured(swinging(FRAMES))


def test_noise_is_smoothed_with_valid_coverage(arm):
    truth = swinging(FRAMES)
    layer = solved(arm)
    assert np.median(errors_m(layer, truth)) < 0.5 * np.median(errors_m(arm.layer, truth))
    offset = np.asarray(layer.points_m)[:, 0] - truth
    squared = np.einsum(
        "fki,fkij,fkj->fk", offset, np.linalg.inv(unpack_covariance(np.asarray(layer.covariance_m2))[:, 0]), offset
    )
    assert 0.9 < (squared < 7.815).mean() <= 1.0
    assert (np.asarray(layer.source) == Source.TRAJECTORY).all()


@pytest.mark.parametrize("correlation_s", [0.1, 0.25])
def test_regions_are_valid_under_correlated_errors(correlation_s):
    inside, errors = [], []
    truth = swinging(600)
    for seed in range(4):
        measurements = measured(truth, pixels=exact_pixels(ring(4), truth) + lasting(truth, correlation_s, seed))
        layer = solved(measurements)
        offset = np.asarray(layer.points_m)[:, 0] - truth
        inverse = np.linalg.inv(unpack_covariance(np.asarray(layer.covariance_m2))[:, 0])
        inside.append(np.einsum("fki,fkij,fkj->fk", offset, inverse, offset) < [[[3.506]], [[7.815]]])
        errors.append(np.median(errors_m(layer, truth)) / np.median(errors_m(measurements.layer, truth)))
    shares = np.mean(inside, axis=(0, 2, 3))
    # An arm that swings evenly has less of the motion that paths lose than people do.
    assert 0.62 < shares[0] < 0.90
    assert shares[1] > 0.93
    assert np.mean(errors) < {0.1: 0.565, 0.25: 0.735}[correlation_s]


@pytest.mark.parametrize("frames", [4, 8, 15, 60])
def test_few_frames_with_correlated_errors_have_valid_regions(frames):
    """The ends of a path, and short paths, are as certain as the point of a single frame, not many times less."""
    ratio, squared = [], []
    for seed in range(8):
        truth = swinging(220)[20 * seed : 20 * seed + frames]
        measurements = measured(truth, pixels=exact_pixels(ring(4), truth) + lasting(truth, 0.1, seed))
        layer = solved(measurements, None, TrajectoryOptions(correlation_s=0.1))
        offset = np.asarray(layer.points_m)[:, 0] - truth
        own, single = (unpack_covariance(np.asarray(each.covariance_m2))[:, 0] for each in (layer, measurements.layer))
        ratio.append(np.trace(own, axis1=-2, axis2=-1) / np.trace(single, axis1=-2, axis2=-1))
        squared.append(np.einsum("fki,fkij,fkj->fk", offset, np.linalg.inv(own), offset)[[0, -1]])
    assert np.mean(ratio, axis=(0, 2)).max() < 1.25
    assert 0.6 < np.mean(squared) / 3.0 < 1.6


def lasting(points_m: np.ndarray, correlation_s: float, seed: int) -> np.ndarray:
    """Return errors of 2 px with a correlation time, shape (frame, view, keypoint, 2)."""
    white = np.random.default_rng(seed).standard_normal((len(points_m), 4, points_m.shape[1], 2))
    r = np.exp(-1.0 / (60.0 * correlation_s))
    white[1:] *= np.sqrt(1.0 - r * r)
    return 2.0 * np.asarray(lfilter([1.0], [1.0, -r], white, axis=0))


@pytest.mark.parametrize(("prior", "powers"), [("jerk", (1.0, -0.3, 0.2)), ("acceleration", (1.0, -0.3))])
def test_motion_without_prior_cost_is_reproduced_exactly(prior, powers):
    t = np.arange(90) / 60.0
    moved = sum(c * t**p for p, c in enumerate(powers))
    truth = swinging(1).repeat(90, axis=0) + np.stack([moved, 0.4 * moved, -0.2 * moved], axis=-1)[:, None]
    layer = solved(measured(truth, 0.0), priors_of(1e-3), TrajectoryOptions(prior=prior))
    assert errors_m(layer, truth).max() < 1e-6


def twin(
    measurements: MeasuredRange, recording_priors: RecordingPriors, options: TrajectoryOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Solve with a general least-squares solver: paths (keypoint, frame, 3), and the covariance of each point."""
    observed = PersonObservations.of(measurements, 0)
    smoothness, ends = Smoothness.of(options.prior, observed.time_s), Bones.of(measurements.detections.skeleton).ends
    keypoints, frames = observed.points_m.shape[:2]
    step = observed.step_s
    sigma_px = 2.0 * np.sqrt(recording_priors.inflation[0, 0])
    _, jacobians = observed.linear(observed.points_m)
    visible = np.einsum("kfvai,kfvaj->kfij", jacobians, jacobians) / sigma_px**2
    usual = 1.0 / np.median(np.trace(visible, axis1=-2, axis2=-1) / 3.0, axis=1)
    tight = np.minimum(
        step / (2.0 * _BONE_CORRELATION_S) / recording_priors.length_sd_m[0] ** 2,
        _MAX_RELATIVE_STIFFNESS / usual[ends].sum(axis=1),
    )

    def residuals(flat: np.ndarray) -> np.ndarray:
        paths = flat.reshape(keypoints, frames, 3)
        errors = observed.linear(paths)[0] / sigma_px
        rows = np.stack([smoothness.differences[r] @ paths[:, r : r + 4] for r in range(frames - 3)], axis=1)
        rough = rows * np.sqrt(smoothness.time_s[:, None] / recording_priors.density[0][:, None, None])
        length = np.linalg.norm(paths[ends[:, 0]] - paths[ends[:, 1]], axis=-1)
        long = np.sqrt(tight)[:, None] * (length - recording_priors.length_m[0][:, None])
        return np.concatenate([errors.ravel(), rough.ravel(), long.ravel()])

    actual = least_squares(residuals, observed.points_m.ravel(), method="trf", xtol=1e-12, ftol=1e-14, gtol=1e-12)
    covariance = np.linalg.inv(actual.jac.T @ actual.jac)
    blocks = [covariance[3 * n : 3 * n + 3, 3 * n : 3 * n + 3] for n in range(keypoints * frames)]
    return actual.x.reshape(keypoints, frames, 3), np.stack(blocks).reshape(keypoints, frames, 3, 3)


@pytest.mark.parametrize(("length_sd_m", "inflation"), [(np.inf, 1.0), (0.004, 1.0), (np.inf, 4.0), (0.004, 4.0)])
def test_solution_matches_a_general_solver(length_sd_m, inflation):
    measurements = measured(swinging(24), seed=3)
    recording_priors = priors_of(20.0, length_sd_m, inflation)
    layer = solved(measurements, recording_priors, PLAIN)
    paths, covariance = twin(measurements, recording_priors, PLAIN)
    ours = np.asarray(layer.points_m)[:, 0].transpose(1, 0, 2)
    sd = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1))
    assert (np.linalg.norm(ours - paths, axis=-1) / sd).max() < 0.02
    actual = unpack_covariance(np.asarray(layer.covariance_m2))[:, 0].transpose(1, 0, 2, 3)
    ratio = np.trace(actual, axis1=-2, axis2=-1) / np.trace(covariance, axis1=-2, axis2=-1)
    # Bone information is propagated frame by frame, so with bones the covariance is approximate.
    assert np.allclose(ratio, 1.0, atol=1e-3 if np.isinf(length_sd_m) else 0.25)


def moved_rig(rig: CameraRig, world_from_new: np.ndarray) -> CameraRig:
    cameras = tuple(replace(c, camera_from_world=c.camera_from_world @ world_from_new) for c in rig.cameras)
    return replace(rig, cameras=cameras)


def test_result_follows_a_change_of_world_coordinates(arm):
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn * np.linalg.det(turn), (3.0, -2.0, 5.0)
    pixels = np.asarray(arm.detections.keypoints_px).reshape(FRAMES, 4, 3, 2)
    other = solved(measured(swinging(FRAMES), rig=moved_rig(arm.rig, pose), pixels=pixels, noise_px=2.0))
    back = np.asarray(other.points_m)[:, 0] @ pose[:3, :3].T + pose[:3, 3]
    assert np.abs(back - np.asarray(solved(arm).points_m)[:, 0]).max() < 1e-5


def test_length_unit_does_not_change_the_paths(arm):
    cameras = []
    for camera in arm.rig.cameras:
        pose = camera.camera_from_world.copy()
        pose[:3, 3] *= 1000.0
        cameras.append(replace(camera, camera_from_world=pose))
    pixels = np.asarray(arm.detections.keypoints_px).reshape(FRAMES, 4, 3, 2)
    rig = replace(arm.rig, cameras=tuple(cameras))
    other = solved(measured(swinging(FRAMES), rig=rig, pixels=pixels, noise_px=2.0))
    assert np.abs(np.asarray(other.points_m) / 1000.0 - np.asarray(solved(arm).points_m)).max() < 1e-5


def test_result_is_independent_of_the_camera_order(arm):
    pixels = np.asarray(arm.detections.keypoints_px).reshape(FRAMES, 4, 3, 2)[:, ::-1]
    rig = replace(arm.rig, cameras=arm.rig.cameras[::-1])
    other = solved(measured(swinging(FRAMES), rig=rig, pixels=pixels, noise_px=2.0))
    assert np.abs(np.asarray(other.points_m) - np.asarray(solved(arm).points_m)).max() < 1e-5


def test_reversed_time_reverses_the_result(arm):
    pixels = np.asarray(arm.detections.keypoints_px).reshape(FRAMES, 4, 3, 2)[::-1]
    other = solved(measured(swinging(FRAMES), pixels=pixels, noise_px=2.0))
    assert np.abs(np.asarray(other.points_m)[::-1] - np.asarray(solved(arm).points_m)).max() < 1e-5


def test_windows_leave_no_seams():
    measurements = measured(swinging(420), seed=5)
    recording_priors = estimate_priors([measurements], ARM, TrajectoryOptions())
    whole = solved(measurements, recording_priors)
    around = int(np.ceil(60.0 * margin_s(recording_priors)))
    assert around < 150
    window = solved(part_of(measurements, 200 - around, 260 + around), recording_priors)
    apart = np.linalg.norm(
        np.asarray(window.points_m)[around : around + 60, 0] - np.asarray(whole.points_m)[200:260, 0], axis=-1
    )
    assert (apart / np.asarray(whole.sd_m)[200:260, 0].max(axis=-1)).max() < 0.05


def with_outliers(truth: np.ndarray, share: float, seed: int) -> MeasuredRange:
    rng = np.random.default_rng(seed)
    pixels = exact_pixels(ring(4), truth) + 2.0 * rng.standard_normal((len(truth), 4, truth.shape[1], 2))
    wrong = rng.random(pixels.shape[:-1]) < share
    pixels[wrong] += rng.uniform(40.0, 300.0, (wrong.sum(), 1)) * np.array([0.8, -0.6])
    return measured(truth, pixels=pixels, noise_px=2.0)


def test_outlier_views_are_rejected():
    truth = swinging(FRAMES)
    measurements = with_outliers(truth, 0.15, 7)
    layer = solved(measurements)
    assert np.nanmax(errors_m(layer, truth)) < 0.05
    off = np.asarray(measurements.detections.keypoints_px).reshape(FRAMES, 4, 3, 2) - exact_pixels(
        measurements.rig, truth
    )
    wrong = (np.linalg.norm(off, axis=-1) > 30.0).transpose(0, 2, 1)
    used = np.asarray(layer.view_status)[:, 0] == ViewStatus.USED
    assert not (used & wrong).any()
    assert used[~wrong].mean() > 0.99


def hidden(truth: np.ndarray, views: int, start: int, stop: int, keypoint: int = 1) -> MeasuredRange:
    """Return a recording with one keypoint visible in only a few views for a while."""
    pixels = exact_pixels(ring(4), truth)
    pixels = pixels + 2.0 * np.random.default_rng(2).standard_normal(pixels.shape)
    pixels[start:stop, views:, keypoint] = np.nan
    return measured(truth, pixels=pixels, noise_px=2.0)


def test_one_camera_bridges_a_short_time():
    truth = swinging(FRAMES)
    layer = solved(hidden(truth, 1, 100, 115))
    assert (np.asarray(layer.status)[100:115, 0, 1] == PointStatus.HELD).all()
    assert errors_m(layer, truth)[100:115, 1].max() < 0.03
    assert (np.asarray(layer.source)[100:115, 0, 1] == Source.TRAJECTORY).all()


def test_bones_constrain_points_in_one_camera():
    truth = swinging(FRAMES)
    measurements = hidden(truth, 1, 90, 150)
    options = TrajectoryOptions(max_sd_share=10.0)
    errors = [
        errors_m(solved(measurements, options=replace(options, bones=bones)), truth)[90:150, 1].mean()
        for bones in (True, False)
    ]
    assert errors[0] < 0.7 * errors[1]


def test_short_gaps_are_filled_and_long_ones_are_not():
    truth = swinging(FRAMES)
    short = solved(hidden(truth, 0, 100, 108))
    assert (np.asarray(short.source)[100:108, 0, 1] == Source.FILLED).all()
    assert (np.asarray(short.status)[100:108, 0, 1] == PointStatus.FILLED).all()
    assert errors_m(short, truth)[100:108, 1].max() < 0.02
    long = solved(hidden(truth, 0, 100, 160))
    assert np.isnan(np.asarray(long.points_m)[100:160, 0, 1]).all()
    assert (np.asarray(long.status)[100:160, 0, 1] >= PointStatus.NOT_SEEN).all()
    assert np.isfinite(np.asarray(long.points_m)[:100, 0]).all()


def test_path_does_not_extend_beyond_observations():
    truth = swinging(FRAMES)
    measurements = hidden(truth, 0, 0, 10)
    layer = solved(measurements)
    assert np.isnan(np.asarray(layer.points_m)[:10, 0, 1]).all()
    assert np.isfinite(np.asarray(layer.points_m)[10:, 0, 1]).all()


def test_points_with_large_uncertainty_are_missing():
    truth = swinging(FRAMES)
    measurements = hidden(truth, 1, 60, 180)
    layer = solved(measurements, options=TrajectoryOptions(bones=False, max_sd_share=0.02))
    status = np.asarray(layer.status)[:, 0, 1]
    assert (status == PointStatus.UNCERTAIN).any()
    assert np.isnan(np.asarray(layer.points_m)[:, 0, 1][status == PointStatus.UNCERTAIN]).all()


def test_points_of_two_views_are_reported_with_any_uncertainty():
    layer = solved(measured(swinging(60)), options=TrajectoryOptions(max_sd_share=1e-6))
    assert np.isfinite(np.asarray(layer.points_m)).all()


def test_single_view_until_the_end_is_accurate_or_missing():
    truth = swinging(FRAMES)
    between = solved(hidden(truth, 1, 170, 210))
    assert np.isfinite(np.asarray(between.points_m)).all()
    for start, stop in ((200, FRAMES), (0, 40)):
        layer = solved(hidden(truth, 1, start, stop))
        assert not (errors_m(layer, truth)[start:stop, 1] > 0.05).any()


def test_roughness_is_included_in_covariances():
    rng = np.random.default_rng(5)
    smooth = swinging(600)
    truth = smooth + 0.004 * rng.standard_normal(smooth.shape)
    layer = solved(measured(truth), options=TrajectoryOptions(bones=False, density_window_s=0.0, density=50.0))
    offset = np.asarray(layer.points_m)[:, 0] - truth
    squared = np.einsum(
        "fki,fkij,fkj->fk", offset, np.linalg.inv(unpack_covariance(np.asarray(layer.covariance_m2))[:, 0]), offset
    )
    assert 0.88 < (squared < 7.815).mean() < 0.99


def test_path_follows_views_that_agree_for_several_frames():
    truth = swinging(FRAMES)
    truth[100:117, 2] += (0.6, 0.0, 0.2)
    layer = solved(measured(truth))
    assert np.median(errors_m(layer, truth)[100:117, 2]) < 0.02


@pytest.mark.parametrize("away_m", [(0.15, 0.1, 0.1), (0.6, 0.0, 0.2)])
def test_agreeing_views_overrule_bone_lengths(away_m):
    recording_priors = estimate_priors([measured(swinging(400))], ARM, TrajectoryOptions())
    truth = swinging(400)
    truth[150:260, 2] += away_m
    errors = errors_m(solved(measured(truth), recording_priors), truth)
    assert np.median(errors[150:260, 2]) < 0.006
    assert np.median(errors[150:260, 1]) < 0.004


def test_swapped_view_is_corrected_first():
    skeleton = Skeleton("feet", ("left_foot", "right_foot"), pairs=(("left_foot", "right_foot"),))
    truth = swinging(90)[:, 1:]
    measurements = measured(truth, skeleton=skeleton)
    rows = np.array(measurements.detections.keypoints_px).reshape(90, 4, 2, 2)
    rows[30:60, 2] = rows[30:60, 2, ::-1]
    swapped = replace(measurements.detections, keypoints_px=rows.reshape(360, 2, 2))
    state = np.full((90, 1, 4, 1), SwapState.AS_LABELED, dtype=np.int8)
    state[30:60, 0, 2] = SwapState.SWAPPED
    status = np.array(measurements.layer.view_status)
    status[30:60, :, :, 2] = ViewStatus.USED_SWAPPED
    other = replace(
        measurements,
        detections=swapped,
        swaps=Swaps(("foot",), state),
        layer=replace(measurements.layer, view_status=status),
    )
    one, two = solved(measurements), solved(other)
    assert np.array_equal(np.asarray(one.points_m), np.asarray(two.points_m))
    assert (np.asarray(two.view_status)[30:60, 0, :, 2] == ViewStatus.USED_SWAPPED).mean() > 0.98


def fast_hand(frames: int) -> np.ndarray:
    """Return paths where the wrist swings at 3 Hz with 30 cm amplitude and everything else is static."""
    points = swinging(1).repeat(frames, axis=0)
    points[:, 2, 0] += 0.15 * np.sin(2.0 * np.pi * 3.0 * np.arange(frames) / 60.0)
    return points


def test_fast_hand_motion_is_preserved():
    truth = fast_hand(FRAMES)
    layer = solved(measured(truth, seed=4))
    t = np.arange(FRAMES) / 60.0
    basis = np.stack([np.sin(6.0 * np.pi * t), np.cos(6.0 * np.pi * t), np.ones(FRAMES)], axis=-1)
    actual = np.linalg.lstsq(basis, np.asarray(layer.points_m)[:, 0, 2, 0], rcond=None)[0]
    assert np.hypot(*actual[:2]) == pytest.approx(0.15, rel=0.02)


def test_solve_is_deterministic(arm):
    assert solved(arm) == solved(arm)


def test_no_observations_give_no_points(arm):
    pixels = np.full((30, 4, 3, 2), np.nan)
    layer = solved(measured(swinging(30), pixels=pixels))
    assert isinstance(layer, Layer)
    assert np.isnan(np.asarray(layer.points_m)).all()


def test_a_point_that_nothing_determines_has_no_finite_covariance():
    """Rounding leaves an indefinite covariance; its persistent part must not overflow."""
    solver = SimpleNamespace(options=TrajectoryOptions(), observed=SimpleNamespace(step_s=0.01))
    covariance = 1e18 * np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])[None, None]
    information = np.diag([1.0, 0.0, 0.0])[None, None]
    priors = SimpleNamespace(persistent_ratio=1.0)
    found = PathSolver._persistent_covariance(solver, covariance, information, priors)  # type: ignore[arg-type]
    assert not np.isfinite(found).any()
