"""Refined cameras: planted errors are corrected, correct cameras stay, and undetermined results are errors."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.adjust import adjust
from posefuse.calibration.gauge import align, apply_similarity, pose_changes, similarity_directions
from posefuse.calibration.locate import locate
from posefuse.calibration.normal_equations import compute_rows
from posefuse.calibration.parameters import N_PARAMETERS, FreeParameters, apply_changes
from posefuse.calibration.point_observations import PointObservations
from posefuse.calibration.selection import held_out_frames, select_spread_points
from posefuse.errors import CalibrationError, MatchError, OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.refinement import RefineOptions
from posefuse.pipeline.refine_calibration import refine_calibration
from posefuse.skeleton.skeletons import Skeleton
from tests.scenes import LENSES, ring

NOISE_PX = 1.0


def observe(rig: CameraRig, seed: int = 0, frames: int = 40, keypoints: int = 10) -> Detections:
    """Return noisy observations of random points in every frame."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 2.0], (frames, keypoints, 3))
    pixels = np.moveaxis(rig.project(points), 0, 1)
    pixels += rng.normal(0.0, NOISE_PX, pixels.shape)
    names = tuple(f"point_{k}" for k in range(keypoints))
    return Detections.from_dense(Skeleton("points", names), rig.names, pixels, rate_hz=30.0)


def moved(rig: CameraRig, name: str, **numbers: float) -> CameraRig:
    """Return the rig with one camera rotated (y_rad) or shifted (x_m, y_m)."""
    change = np.zeros((len(rig), N_PARAMETERS))
    change[rig.index(name), [1, 3, 4]] = [numbers.get(key, 0.0) for key in ("y_rad", "x_m", "y_m")]
    return apply_changes(rig, change)


ONE = Options(people="one")


@pytest.mark.parametrize("planted", [{"y_rad": np.radians(1.0)}, {"x_m": 0.02}, {"y_m": -0.05}])
def test_planted_error_is_corrected_and_other_cameras_stay(planted):
    truth = ring(4)
    result = refine_calibration(moved(truth, "cam_2", **planted), observe(truth), ONE)
    errors = pose_changes(truth, result.rig)
    sds = np.array([[np.radians(c.turn_sd_deg)] * 3 + [c.shift_sd_m] * 3 for c in result.cameras])
    assert np.abs(errors / sds).max() < 5.0
    assert np.sqrt(np.mean((errors / sds) ** 2)) < 1.5
    assert sds[:, 0].max() < np.radians(0.2)
    assert result.after_px < 2.0 * NOISE_PX
    assert result["cam_2"].before_px > result["cam_2"].after_px


def test_correct_rig_stays_within_its_uncertainty():
    truth = ring(4)
    result = refine_calibration(truth, observe(truth, seed=3), ONE)
    for camera in result.cameras:
        assert camera.role == "refined"
        assert camera.turn_deg < 4.0 * camera.turn_sd_deg
        assert camera.shift_m < 4.0 * camera.shift_sd_m


def test_result_is_independent_of_the_camera_order():
    truth, order = ring(4), ("cam_3", "cam_0", "cam_2", "cam_1")
    given, seen = moved(truth, "cam_2", x_m=0.02), observe(truth, frames=20)
    one = refine_calibration(given, seen, ONE).rig
    other = refine_calibration(given.select(order), seen.views(order), ONE).rig
    assert np.abs(pose_changes(one, other.select(one.names))).max() < 1e-4


def test_result_moves_with_the_world():
    truth = ring(4)
    given, seen = moved(truth, "cam_1", y_rad=0.02), observe(truth, frames=20)
    step, origin = np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.5, 0.0]), np.zeros(3)
    one = apply_similarity(refine_calibration(given, seen, ONE).rig, np.zeros((1, 3)), step, origin)[0]
    other = refine_calibration(apply_similarity(given, np.zeros((1, 3)), step, origin)[0], seen, ONE).rig
    assert np.abs(pose_changes(one, other)).max() < 1e-4


def test_fixed_cameras_define_the_world():
    truth = ring(4)
    result = refine_calibration(
        moved(truth, "cam_2", x_m=0.05), observe(truth), ONE, RefineOptions(fix=("cam_0", "cam_1"))
    )
    assert result.rig["cam_0"] == truth["cam_0"]
    assert result["cam_0"].role == "fixed"
    assert np.linalg.norm(result.rig["cam_2"].centre_m - truth["cam_2"].centre_m) < 0.01


def test_wrong_focal_length_is_corrected():
    truth = ring(4)
    wrong = np.zeros((4, N_PARAMETERS))
    wrong[3, 6] = 0.03
    seen = observe(truth, frames=60)
    result = refine_calibration(apply_changes(truth, wrong), seen, ONE, RefineOptions(refine="focal"))
    camera = result["cam_3"]
    assert camera.focal_share == pytest.approx(-0.03, abs=0.005 + 4 * camera.focal_sd)
    assert 0 < camera.focal_sd < 0.01


def test_copied_camera_is_left_out_or_relocated():
    truth = ring(4)
    copy = replace(truth["cam_0"], name="cam_3")
    given, seen = replace(truth, cameras=(*truth.cameras[:3], copy)), observe(truth)
    result = refine_calibration(given, seen, ONE)
    assert result.left_out == ("cam_3",)
    assert "cam_0" in result["cam_3"].why
    found = refine_calibration(given, seen, ONE, RefineOptions(relocate=("cam_3",)))
    assert found["cam_3"].role == "located"
    assert np.linalg.norm(found.rig["cam_3"].centre_m - truth["cam_3"].centre_m) < 0.03
    assert found["cam_3"].after_px < 3 * NOISE_PX


def test_undetermined_results_are_errors():
    truth = ring(4)
    with pytest.raises(CalibrationError, match="points are observed by two"):
        refine_calibration(truth, observe(truth, frames=8), ONE)
    small = Detections.from_dense(
        Skeleton("points", ("a", "b", "c", "d")),
        truth.names,
        np.moveaxis(truth.project(np.random.default_rng(0).uniform(0.9, 1.0, (80, 4, 3))), 0, 1)
        + np.random.default_rng(1).normal(0.0, 3.0, (80, 4, 4, 2)),
    )
    with pytest.raises(CalibrationError, match="do not determine focal length and distortion"):
        refine_calibration(truth, small, ONE, RefineOptions(refine="focal"))
    with pytest.raises(CalibrationError, match=r"rotation .* degrees"):
        refine_calibration(truth, small, ONE)
    with pytest.raises(MatchError, match="No camera 'cam_9'"):
        refine_calibration(truth, small, ONE, RefineOptions(fix=("cam_9",)))
    with pytest.raises(OptionsError, match="must not name the same camera"):
        RefineOptions(fix=("a",), relocate=("a",))


@pytest.mark.parametrize("lens", ["pinhole", "barrel", "fisheye"])
def test_camera_is_located_despite_outliers(lens, rng):
    camera = ring(2, lens).cameras[1]
    points = rng.uniform([-1.0, -1.0, 0.3], [1.0, 1.0, 1.8], (200, 3))
    pixels = camera.project(points)[0] + rng.normal(0.0, 0.5, (200, 2))
    pixels[::4] = rng.uniform(0, 1000, (50, 2))
    found = locate(replace(camera, camera_from_world=np.eye(4)), points, pixels)
    assert found is not None
    assert np.linalg.norm(found.camera.centre_m - camera.centre_m) < 0.02
    flat = points * [1.0, 1.0, 0.0]
    assert locate(camera, flat, camera.project(flat)[0]) is None


@pytest.mark.parametrize("lens", list(LENSES))
def test_derivatives_match_finite_differences(lens, rng):
    rig = ring(2, lens)
    points = rng.uniform(-0.5, 1.5, (6, 3))
    n = len(points)
    seen = PointObservations(
        np.zeros(n, dtype=np.int64), np.arange(n), np.zeros((n, 2)), np.ones(n), points, np.arange(n), np.arange(n)
    )
    rows = compute_rows(rig, seen, points, np.ones(2))
    for k in range(6 if lens == "pinhole" else N_PARAMETERS):
        change = np.zeros((2, N_PARAMETERS))
        change[0, k] = 1e-6
        up, down = (
            compute_rows(apply_changes(rig, sign * change), seen, points, np.ones(2)).residual for sign in (1, -1)
        )
        assert np.allclose((up - down) / 2e-6, rows.by_camera[:, :, k], rtol=1e-4, atol=1e-2)


def test_alignment_undoes_a_similarity_but_not_a_bumped_camera(rng):
    rig, points = ring(6), rng.normal(0.0, 1.0, (50, 3))
    bumped = moved(rig, "cam_4", x_m=0.1)
    step = np.array([0.02, -0.01, 0.03, 0.1, 0.05, -0.02, 0.01])
    elsewhere, there = apply_similarity(bumped, points, step, np.zeros(3))
    restored, restored_points = align(rig, elsewhere, there, np.ones(6, dtype=bool))
    left = np.linalg.norm(pose_changes(rig, restored)[:, 3:], axis=1)
    assert left[4] == pytest.approx(0.1, abs=0.01)
    assert np.delete(left, 4).max() < 0.01
    assert np.abs(restored.project(restored_points) - bumped.project(points)).max() < 1e-6


def test_similarities_leave_projections_unchanged(rng):
    rig, points = ring(3), rng.normal([0.0, 0.0, 1.0], 0.5, (20, 3))
    for k in range(7):
        step = np.eye(7)[k] * 1e-6
        after, there = apply_similarity(rig, points, step, np.zeros(3))
        assert np.abs(after.project(there) - rig.project(points)).max() < 1e-6
        assert np.allclose(pose_changes(rig, after), similarity_directions(rig, np.zeros(3)) @ step, atol=1e-11)


def test_held_out_frames_and_selected_points_are_spread():
    kept = held_out_frames(1000)
    assert 0.15 < kept.mean() < 0.25
    assert np.abs(np.diff(kept.astype(int))).sum() <= 10
    n = 3000
    points = np.concatenate([np.random.default_rng(0).normal(0, 0.01, (n - 150, 3)), np.ones((150, 3))])
    view, point = np.tile([0, 1], n), np.repeat(np.arange(n), 2)
    seen = PointObservations(
        view, point, np.zeros((2 * n, 2)), np.ones(2 * n), points, np.arange(n), np.zeros(n, dtype=np.int64)
    )
    chosen = select_spread_points(seen, 2, 600)
    assert 300 < chosen.sum() <= 600
    assert chosen[-150:].sum() >= 60


def test_adjustment_without_noise_is_exact(rng):
    truth = ring(3)
    points = rng.uniform([-0.7, -0.7, 0.3], [0.7, 0.7, 1.7], (80, 3))
    pixels = truth.project(points)
    view, point = np.tile([0, 1, 2], 80), np.repeat(np.arange(80), 3)
    seen = PointObservations(
        view, point, pixels[view, point], np.ones(240), points + 0.01, np.arange(80), np.zeros(80, dtype=np.int64)
    )
    start = moved(truth, "cam_1", y_rad=0.02, x_m=0.05)
    done = adjust(start, seen, FreeParameters.of(start, "extrinsics", ("cam_0",)), 20.0)
    assert np.sqrt(compute_rows(done.rig, seen, done.points_m, np.ones(3)).squared).max() < 1e-3
