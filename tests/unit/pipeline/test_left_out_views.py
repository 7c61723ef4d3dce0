"""Layers are scored by views that they do not see."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.io.results import netcdf
from posefuse.pipeline import left_out_views
from posefuse.pipeline.left_out_views import sample_spans, with_layer_scores
from posefuse.pipeline.people.left_out_bodies import Bodies
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.scenes import ring, simulate_detections

OPTIONS = posefuse.Options(bodies="fit", solve="trajectory", health="off")


def plan_of(rig, detections, options=OPTIONS):
    return prepare(rig, detections, options, Silent())


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(duration_s=2, cameras=4, seed=3))


def test_points_do_not_depend_on_the_detections_of_the_view_left_out(scene):
    plan = plan_of(scene.rig, scene.detections)
    bodies = Bodies.of(plan.bodies, plan.options)
    other = np.array(plan.detections.keypoints_px)
    view_of = np.repeat(
        np.tile(np.arange(plan.detections.n_views), plan.detections.n_frames), plan.detections.people_counts.ravel()
    )
    other[view_of == 1] += 200.0
    moved = replace(plan, detections=replace(plan.detections, keypoints_px=other))
    pieces = [list(left_out_views._pieces(each, bodies)) for each in (plan, moved)]
    for view, same in ((1, True), (2, False)):
        before, after = (
            left_out_views._points_without(next(each for each in of_plan if each.view == view))[0] for of_plan in pieces
        )
        assert list(before) == ["measured", "solved", "model"]
        for name in before:
            assert np.array_equal(before[name], after[name], equal_nan=True) == same, (name, view)


@pytest.mark.parametrize("stretch", [0.0, 0.2])
def test_bodies_predict_left_out_views_at_least_as_well_as_measured_points(stretch, rng):
    truth = np.asarray(simulate(SceneOptions(duration_s=2, cameras=3)).truth.layers["measured"].points_m)[:, 0]
    center = truth.mean(axis=1, keepdims=True)
    factor = 1.0 + stretch * np.sin(2.0 * np.pi * np.arange(len(truth)) / 20.0)
    points = center + factor[:, None, None] * (truth - center)
    detections = simulate_detections(ring(4), points, rng, sigma_px=4.0)
    skeleton = simulate(SceneOptions(duration_s=0.1, cameras=3)).detections.skeleton
    result = posefuse.reconstruct(
        ring(4), replace(detections, skeleton=skeleton), replace(OPTIONS, solve="frame", people="one")
    )
    measured, model = result.layer_scores
    assert (measured.layer, model.layer) == ("measured", "model")
    assert model.median_px <= 1.03 * measured.median_px
    assert model.mean_px <= 1.03 * measured.mean_px
    assert any(note.startswith("Left-out views") for note in result.provenance.notes)
    if stretch:
        assert any("26 of 26 keypoints deviate from the fitted bodies" in note for note in result.provenance.notes)
    # The points of the layer itself deviate, too.
    error = {
        name: np.nanmedian(np.linalg.norm(np.asarray(result.layers[name].points_m)[:, 0] - points, axis=-1))
        for name in ("measured", "model")
    }
    assert error["model"] < 1.03 * error["measured"]


def test_scores_do_not_depend_on_the_chunks_and_are_stored(scene, tmp_path):
    results = [
        posefuse.reconstruct(scene.rig, scene.detections, replace(OPTIONS, chunk_frames=size)) for size in (17, 10_000)
    ]
    assert results[0].layer_scores == results[1].layer_scores
    points, again = (np.asarray(each.layers["model"].points_m) for each in results)
    assert np.array_equal(points, again, equal_nan=True)
    netcdf.write([results[0]], tmp_path / "reconstruction.nc")
    stored = posefuse.read_reconstruction(tmp_path / "reconstruction.nc")
    assert stored.layer_scores == results[0].layer_scores
    assert stored.best_layer()[0] == results[0].best_layer()[0]


def test_nothing_is_scored_with_one_layer_or_two_cameras(scene):
    one_layer = replace(OPTIONS, bodies="none", solve="frame")
    plan = plan_of(scene.rig, scene.detections, one_layer)
    assert with_layer_scores(plan) is plan
    two = scene.rig.names[:2]
    plan = plan_of(scene.rig.select(two), scene.detections.views(two), one_layer)
    assert with_layer_scores(plan) is plan
    result = posefuse.reconstruct(scene.rig.select(two), scene.detections.views(two), OPTIONS)
    assert not result.layer_scores
    assert any("two cameras, so the layers are not compared" in note for note in result.provenance.notes)
    assert result.best_layer()[0] == "model"


def test_work_is_bounded_for_long_recordings_and_many_views():
    scene = simulate(SceneOptions(duration_s=20, cameras=7, seed=3))
    spans = sample_spans(plan_of(scene.rig, scene.detections, replace(OPTIONS, bodies="none", solve="frame")), 6)
    assert 6 * sum(span.stop - span.start for span in spans) <= 1000
    assert sum(span.last - span.first for span in spans) < 300
    assert spans[0].start > 0
    assert spans[-1].stop < scene.detections.n_frames
