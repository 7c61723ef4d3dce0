"""Weights of detections with stated standard deviations."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError
from posefuse.io.keypoints import native
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.pipeline.reconstruct import triangulate
from posefuse.preprocess.weights import weighted
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.example_detections import ragged_detections

SCENE = SceneOptions(duration_s=0.5, cameras=3, detector=replace(CLEAN, sigma_px=0.1))


def with_sigma(rng, detections):
    shape = np.asarray(detections.confidence).shape
    return replace(detections, sigma_px=np.exp(rng.uniform(np.log(0.5), np.log(8.0), shape)))


def test_weights_are_the_reference_over_sigma(rng):
    original = with_sigma(rng, ragged_detections(rng))
    actual = weighted(original, 4.5, 0.0)
    assert actual is not None
    sigma = np.asarray(original.sigma_px)
    np.testing.assert_allclose(np.asarray(actual.confidence) * sigma, 4.5)
    assert actual.sigma_px is None


def test_detections_below_min_confidence_get_weight_zero(rng):
    original = with_sigma(rng, ragged_detections(rng))
    sigma = np.asarray(original.sigma_px).copy()
    sigma[0, 0], sigma[0, 1] = 1e6, np.nan
    confidence = np.asarray(original.confidence).copy()
    confidence[0] = 0.9, 0.9, np.nan, 0.29
    actual = np.asarray(weighted(replace(original, sigma_px=sigma, confidence=confidence), 4.5, 0.3).confidence)
    assert (actual[confidence < 0.3] == 0.0).all()
    assert (actual[~(confidence < 0.3)] >= 0.3).all()
    assert actual[0, 0] == 0.3
    assert actual[0, 1] == pytest.approx(np.median(actual[np.isfinite(sigma) & ~(confidence < 0.3)]), rel=0.5)


def test_files_are_weighted_while_they_are_read(rng, tmp_path):
    detections = with_sigma(rng, ragged_detections(rng))
    native.write(detections, tmp_path / "keypoints.nc")
    from posefuse import read_detections

    stored = read_detections(tmp_path / "keypoints.nc")
    assert stored == detections
    assert weighted(stored, 4.5, 0.2) == weighted(detections, 4.5, 0.2)


def test_derived_keypoint_gets_the_largest_deviation_of_its_parts(rng):
    body, other = find_skeleton("coco_17"), find_skeleton("body_20")
    original = with_sigma(rng, replace(ragged_detections(rng, keypoints=17), skeleton=body))
    detections = np.asarray(original.to_skeleton(other).sigma_px)
    hips = [body.index("left_hip"), body.index("right_hip")]
    np.testing.assert_array_equal(
        detections[:, other.index("mid_hip")], np.asarray(original.sigma_px)[:, hips].max(axis=1)
    )


@pytest.mark.parametrize("method", ["consensus", "simple"])
def test_points_weighted_by_their_true_noise_are_better(method, rng):
    scene = simulate(replace(SCENE, duration_s=2.0, cameras=4))
    clean = scene.detections
    sigma = np.exp(rng.uniform(np.log(0.5), np.log(12.0), np.asarray(clean.confidence).shape))
    pixels = np.asarray(clean.keypoints_px) + rng.normal(size=(*sigma.shape, 2)) * sigma[..., None]
    noisy = replace(clean, keypoints_px=pixels)
    options = Options(triangulation=TriangulationOptions(method=method), pairs="labels", solve="frame")

    def error_m(detections):
        result = np.asarray(triangulate(scene.rig, detections, options).layers["measured"].points_m)
        off = np.linalg.norm(result - np.asarray(scene.truth.layers["measured"].points_m), axis=-1)
        return np.sqrt(np.nanmean(off**2))

    assert error_m(replace(noisy, sigma_px=sigma)) < 0.75 * error_m(noisy)
    # A common factor does not change the relative weights of views.
    assert error_m(replace(noisy, sigma_px=sigma)) == pytest.approx(
        error_m(replace(noisy, sigma_px=1.7 * sigma)), rel=0.02
    )


def test_fixed_noise_overrides_standard_deviations(rng):
    scene = simulate(SCENE)
    results = replace(scene.detections, sigma_px=np.exp(rng.normal(size=np.asarray(scene.detections.confidence).shape)))
    options = Options(noise_scale_px=0.5, pairs="labels")
    with_it, without = (triangulate(scene.rig, d, options) for d in (results, scene.detections))
    np.testing.assert_array_equal(with_it.layers["measured"].points_m, without.layers["measured"].points_m)
    assert any("set the noise" in note for note in with_it.provenance.notes)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.inf])
def test_deviations_are_positive(bad, rng):
    detections = with_sigma(rng, ragged_detections(rng))
    sigma = np.asarray(detections.sigma_px).copy()
    sigma[3, 1] = bad
    with pytest.raises(DetectionsError, match="sigma_px of view"):
        replace(detections, sigma_px=sigma)
