"""The solved layer in ranges, for every kind of recording."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.concatenate import concatenate_ranges
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import ButterworthOptions, PostprocessOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source, is_used
from posefuse.pipeline.defaults import RecordingFacts, resolve_solve
from posefuse.pipeline.measured_layer import measure, reconstruct_chunks
from posefuse.pipeline.reconstruct import prepare
from posefuse.pipeline.solved_layer import frame_windows
from posefuse.progress import Silent
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.scenes import body_points, ring, simulate_detections
from tests.unit.trajectory.path_problems import ARM, exact_pixels, swinging

EVERYTHING = PostprocessOptions(
    fill="pchip", smooth=("hampel", "butterworth"), butterworth=ButterworthOptions(cutoff_hz=9.0)
)


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(duration_s=4, cameras=3, seed=3))


def with_gaps(scene, **postprocess):
    return posefuse.reconstruct(
        scene.rig, scene.detections, Options(solve="frame", postprocess=PostprocessOptions(**postprocess))
    )


def test_no_postprocessing_gives_no_solved_layer(scene):
    result = posefuse.reconstruct(scene.rig, scene.detections, Options(solve="frame"))
    assert list(result.layers) == ["measured"]


def test_measured_layer_is_unchanged_and_sources_are_correct(scene):
    result = with_gaps(scene, fill="pchip", smooth=("butterworth",))
    plain = posefuse.reconstruct(scene.rig, scene.detections, Options(solve="frame"))
    assert list(result.layers) == ["measured", "solved"]
    assert result.layers["measured"] == plain.layers["measured"]
    measured, solved = result.layers["measured"], result.layers["solved"]
    filled = np.asarray(solved.source) == Source.FILLED
    assert filled.any()
    assert (solved.has_point == np.isfinite(solved.points_m[..., 0])).all()
    assert (np.asarray(solved.status)[filled] == PointStatus.FILLED).all()
    assert not measured.has_point[filled].any()
    assert set(np.unique(solved.source)) <= {Source.NONE, Source.MEASURED, Source.FILLED, Source.SMOOTHED}
    assert (np.asarray(solved.source)[~solved.has_point] == Source.NONE).all()
    kept = measured.has_point
    assert solved.has_point[kept].all()


def test_reprojection_errors_are_those_of_the_processed_points(scene):
    result = with_gaps(scene, smooth=("butterworth",))
    solved = result.layers["solved"]
    pixels = np.moveaxis(result.rig.project(np.asarray(solved.points_m)), 1, 3)
    rows = result.tracks.rows(scene.detections)
    seen_px = np.asarray(scene.detections.keypoints_px)[np.maximum(rows, 0)].transpose(0, 1, 3, 2, 4)
    by_hand = np.linalg.norm(pixels - seen_px, axis=-1)
    used = np.asarray(solved.view_status) == 0
    np.testing.assert_allclose(np.asarray(solved.view_error_px)[used], by_hand[used], rtol=1e-4, atol=1e-4)
    moved = (np.asarray(solved.source) == Source.SMOOTHED) & is_used(np.asarray(solved.view_status)).any(axis=-1)
    assert np.isfinite(np.asarray(solved.reprojection_error_px)[moved]).all()


@pytest.mark.parametrize("size", [37, 64, 1000])
def test_results_do_not_depend_on_the_chunk_length(scene, size):
    options = Options(solve="frame", postprocess=EVERYTHING, pairs="labels")
    plan = prepare(scene.rig, scene.detections, options, Silent())
    whole = Reconstruction.concatenate(list(reconstruct_chunks(plan, Silent())))
    other = replace(plan, options=replace(plan.options, chunk_frames=size))
    pieces = Reconstruction.concatenate(list(reconstruct_chunks(other, Silent())))
    assert replace(pieces, resolved=whole.resolved) == whole


def test_windows_equal_the_whole_recording(scene):
    options = Options(solve="frame", postprocess=EVERYTHING, pairs="labels")
    plan = prepare(scene.rig, scene.detections, options, Silent())
    whole = plan.solver.steps[0].apply(
        next(frame_windows(iter([measured(plan)]), 120, 0, 120)), measured(plan).layers["measured"]
    )
    margin = plan.solver.margin
    assert margin < 80
    for window in frame_windows(iter([measured(plan)]), 120, margin, size=20):
        layer = plan.solver.steps[0].apply(window, window.part.layers["measured"])
        inner = layer.frames(window.start - window.first, window.stop - window.first)
        np.testing.assert_allclose(inner.points_m, whole.points_m[window.start : window.stop], atol=1e-8)


def measured(plan) -> Reconstruction:
    return measure(plan, 0, plan.detections.n_frames)


def test_windows_hold_their_frames_and_margins():
    rig = ring(3)
    detections = simulate_detections(
        rig, np.broadcast_to(body_points(np.random.default_rng(0), 1), (50, 17, 3)), np.random.default_rng(1)
    )
    plan = prepare(rig, detections, Options(solve="frame"), Silent())
    whole = measured(plan)
    for size, margin, step in ((10, 3, 7), (20, 0, 50), (8, 8, 1), (10, 3, 10), (10, 3, 5)):
        parts = (whole.frames(i, min(i + step, 50)) for i in range(0, 50, step))
        covered = []
        for window in frame_windows(parts, 50, margin, size):
            covered.extend(range(window.start, window.stop))
            assert window.first == max(window.start - margin, 0)
            assert (window.own is not None) == (size == step)
            assert window.without_margin() == whole.frames(window.start, window.stop)
            last = min(window.stop + margin, 50)
            np.testing.assert_array_equal(window.part.frame_numbers, np.arange(window.first, last))
        assert covered == list(range(50))


def test_rigid_bones(scene):
    result = with_gaps(scene, rigid_bones=True)
    solved = np.asarray(result.layers["solved"].points_m)[:, 0]
    hip, knee = result.skeleton.index("left_hip"), result.skeleton.index("left_knee")
    length = np.linalg.norm(solved[:, hip] - solved[:, knee], axis=-1)
    assert np.nanstd(length) < 1e-9


def test_unreliable_points_are_dropped_with_a_status(scene):
    result = with_gaps(scene, drop_beyond_px=8.0)
    solved = result.layers["solved"]
    gone = np.asarray(result.layers["measured"].reprojection_error_px) > 8.0
    assert gone.any()
    assert (np.asarray(solved.status)[gone] == PointStatus.OUTLIER).all()
    assert not solved.has_point[gone].any()
    assert not is_used(np.asarray(solved.view_status))[gone].any()


def test_filters_without_times_are_an_error(scene):
    timeless = replace(scene.detections, time_s=np.full_like(scene.detections.time_s, np.nan), rate_hz=None)
    with pytest.raises(DetectionsError, match="`rate_hz"):
        posefuse.reconstruct(scene.rig, timeless, Options(solve="frame", postprocess=EVERYTHING))


def test_single_camera(scene):
    detections = scene.detections.views(["cam_0"])
    result = posefuse.reconstruct(
        scene.rig.select(["cam_0"]), detections, Options(solve="frame", postprocess=EVERYTHING)
    )
    assert result.unit == "px"
    assert "solved" in result.layers


@pytest.fixture(scope="module")
def trajectory_plan(scene):
    return prepare(scene.rig, scene.detections, Options(solve="trajectory"), Silent())


def test_trajectory_is_more_accurate_than_single_frames(scene, trajectory_plan):
    assert trajectory_plan.options.solve == "trajectory"
    result = Reconstruction.concatenate(list(reconstruct_chunks(trajectory_plan, Silent())))
    solved = result.layers["solved"]
    assert result.resolved.solve == "trajectory"
    assert (np.asarray(solved.source) == Source.TRAJECTORY).mean() > 0.9
    truth = np.asarray(scene.truth.best_layer()[1].points_m)
    errors = [
        np.nanmedian(np.linalg.norm(np.asarray(result.layers[name].points_m) - truth, axis=-1))
        for name in ("measured", "solved")
    ]
    assert errors[1] < 0.9 * errors[0]


@pytest.mark.parametrize(
    ("changes", "cameras", "seconds", "expected"),
    [
        ({}, 3, 0.5, "trajectory"),
        ({}, 3, 0.4, "frame"),
        ({}, 1, 60.0, "frame"),
        ({"people": "many"}, 3, 60.0, "trajectory"),
        ({"people": "many"}, 3, 0.4, "frame"),
        ({"people": "stills"}, 3, 60.0, "frame"),
        ({"triangulation": TriangulationOptions(method="simple")}, 3, 60.0, "frame"),
        ({"solve": "trajectory", "people": "many"}, 3, 1.0, "trajectory"),
    ],
)
def test_auto_solves_tracked_subjects_over_time(scene, changes, cameras, seconds, expected):
    detections = scene.detections.with_rate(scene.detections.n_frames / seconds)
    assert (
        resolve_solve(Options(**{"people": "one"} | changes), RecordingFacts.of(detections), cameras).solve == expected
    )


def test_windows_of_a_trajectory_join_smoothly():
    """Rough motion, gross errors, and a wrist in a single view across a window border."""
    rng = np.random.default_rng(4)
    rig, frames = ring(4), 1300
    truth = swinging(frames) + 0.003 * rng.standard_normal((frames, 3, 3))
    pixels = exact_pixels(rig, truth) + 2.0 * rng.standard_normal((frames, 4, 3, 2))
    pixels[rng.random(pixels.shape[:-1]) < 0.05] += 90.0
    pixels[570:630, 1:, 2] = np.nan
    detections = posefuse.Detections.from_dense(ARM, rig.names, pixels, rate_hz=60.0)
    plan = prepare(rig, detections, Options(solve="trajectory"), Silent())
    part = measured(plan)
    whole, cut = (
        concatenate_ranges(plan.solver.solve(iter([part]), frames, block), frames).layers["solved"]
        for block in (frames, 200)
    )
    assert plan.solver.margin < 120
    assert (np.asarray(plan.solver.steps[0].priors.roughness_m2) > 1e-6).all()
    present = np.asarray(whole.has_point)
    assert present.mean() > 0.98
    np.testing.assert_array_equal(cut.status, whole.status)
    apart = np.linalg.norm(np.asarray(cut.points_m) - np.asarray(whole.points_m), axis=-1)[present]
    assert (apart / np.asarray(whole.sd_m).max(axis=-1)[present]).max() < 0.02
    assert np.abs(np.log(np.asarray(cut.sd_m)[present] / np.asarray(whole.sd_m)[present])).max() < 0.005


def test_trajectory_needs_times_and_two_cameras(scene):
    timeless = replace(scene.detections, time_s=np.full_like(scene.detections.time_s, np.nan), rate_hz=None)
    with pytest.raises(DetectionsError, match="`rate_hz"):
        resolve_solve(Options(solve="trajectory"), RecordingFacts.of(timeless), 3)
    assert resolve_solve(Options(), RecordingFacts.of(timeless), 3).solve == "frame"
    with pytest.raises(OptionsError, match="two cameras"):
        resolve_solve(Options(solve="trajectory"), RecordingFacts.of(scene.detections), 1)
