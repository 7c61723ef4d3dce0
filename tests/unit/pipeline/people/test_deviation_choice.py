"""Deviations from bodies are chosen where they predict left-out views better."""

from dataclasses import replace

import numpy as np

from posefuse.pipeline.people.deviation_choice import (
    LeftOutSample,
    choices_m,
    chosen_deviations,
    describe_deviations,
)
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.scenes import ring

SKELETON = shipped_skeleton("coco_17")
FRAMES, NOISE_M, NOISE_PX = 32, 0.012, 3.0


def samples_of(rng, deviation_m, views=4):
    """Return samples of a person whose keypoints deviate slowly from the body, and whose body is known to 3 mm."""
    shape, samples = (FRAMES, 1, len(SKELETON)), []
    covariance = np.broadcast_to(NOISE_M**2 * np.array([1.0, 0, 0, 1.0, 0, 1.0]), (*shape, 6))
    for span in range(3):
        rigid = rng.uniform(-0.5, 0.5, (1, 1, len(SKELETON), 3)) + np.array([0.0, 0.0, 1.0])
        phase = 0.3 * np.arange(FRAMES)[:, None, None, None] + rng.uniform(0.0, 6.0, (1, 1, len(SKELETON), 3)) + span
        truth = rigid + np.sqrt(2.0) * deviation_m[:, None] * np.sin(phase)
        for view, camera in enumerate(ring(views).cameras):
            pixels = camera.project(truth)[0] + NOISE_PX * rng.standard_normal((*shape, 2))
            body = np.broadcast_to(rigid, truth.shape) + 0.003 * rng.standard_normal(truth.shape)
            measured = truth + NOISE_M * rng.standard_normal(truth.shape)
            samples.append(LeftOutSample(view, camera, pixels, body, measured, covariance))
    return samples


def sds_of(samples):
    choices = choices_m(SKELETON)
    return choices[chosen_deviations(SKELETON, [(each.view, each.errors_px(choices)) for each in samples])]


def test_rigid_keypoints_stay_rigid(rng):
    assert not sds_of(samples_of(rng, np.zeros(len(SKELETON)))).any()


def test_single_keypoints_that_deviate_are_found(rng):
    deviation_m = np.zeros(len(SKELETON))
    deviation_m[[3, 9]] = 0.06, 0.03
    sds = sds_of(samples_of(rng, deviation_m))
    assert np.flatnonzero(sds > 0.005).tolist() == [3, 9]
    assert 0.5 < sds[3] / 0.06 < 2.0
    assert 0.5 < sds[9] / 0.03 < 2.0
    text = describe_deviations(SKELETON, sds)
    assert text.startswith("In the model layer, 2 of 17 keypoints deviate from the fitted bodies")
    assert f"mm: {SKELETON.keypoints[3]} {1000 * sds[3]:.3g}, {SKELETON.keypoints[9]}" in text


def test_a_body_that_is_not_rigid_deviates_everywhere(rng):
    sds = sds_of(samples_of(rng, np.full(len(SKELETON), 0.03)))
    assert (sds > 0.01).all()


def test_an_improvement_in_one_view_alone_is_no_evidence(rng):
    # One camera is slightly misplaced: its detections deviate from all points in the same way.
    deviating = samples_of(rng, np.full(len(SKELETON), 0.03))
    rigid = samples_of(rng, np.zeros(len(SKELETON)))
    assert not sds_of([rigid[i] if each.view else each for i, each in enumerate(deviating)]).any()


def test_too_little_evidence_chooses_nothing(rng):
    assert not chosen_deviations(SKELETON, []).any()
    samples = samples_of(rng, np.full(len(SKELETON), 0.05))
    hidden = [replace(each, pixels=np.full_like(each.pixels, np.nan)) for each in samples]
    assert not sds_of(hidden).any()
    assert describe_deviations(SKELETON, np.zeros(len(SKELETON))) == ""


def test_one_keypoint_that_deviates_is_described_in_the_singular():
    sds = np.zeros(len(SKELETON))
    sds[3] = 0.02
    assert "1 of 17 keypoints deviates from" in describe_deviations(SKELETON, sds)
