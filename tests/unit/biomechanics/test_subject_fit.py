"""The parameters of a person are estimated, and their covariance and that of coordinates are those of the errors."""

from dataclasses import replace

import numpy as np
from benchmarks.replayed_angles import person

from posefuse.biomechanics.body_scales import scale_basis, scale_factors
from posefuse.biomechanics.coordinate_priors import moving_prior, upright_prior
from posefuse.biomechanics.inverse_kinematics import solve
from posefuse.biomechanics.placements import mirrored, placements_of
from posefuse.biomechanics.subject_fit import fit_subject, moving_sample, systematic_covariance, upright_sample
from posefuse.biomechanics.subject_samples import is_upright
from posefuse.skeleton.skeletons import find_skeleton
from tests.unit.biomechanics.bodies import gait, model_of, points_of

MODEL = model_of()
ROWS = np.arange(0, 90, 4)


def test_errors_of_angles_are_within_their_standard_deviations():
    scores = []
    coordinates = gait(MODEL, 90)
    names = [f"{name}_{side}" for name in ("knee_angle", "hip_flexion", "ankle_angle", "elbow_flex") for side in "rl"]
    at = [MODEL.anatomy.coordinate_index(name) for name in names]
    for seed in range(8):
        points = points_of(person(MODEL, np.random.default_rng(seed)), coordinates, 0.005, seed)
        fit = fit_subject(MODEL, (moving_sample(points.rows(ROWS), 1.0),))
        sample = points.rows(ROWS)
        solution = solve(fit.model, sample, fit.prior)
        covariance = solution.covariance + systematic_covariance(fit, sample, solution)
        error = solution.coordinates[:, at] - coordinates[ROWS][:, at]
        scores.append(error / np.sqrt(np.einsum("fii->fi", covariance)[:, at]))
    z = np.array(scores)
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.2
    assert np.mean(np.abs(z) < 1.96) > 0.9


def test_sizes_are_those_of_the_person():
    subject = person(MODEL, np.random.default_rng(3))
    fit = fit_subject(MODEL, (moving_sample(points_of(subject, gait(MODEL, 90), 0.003).rows(ROWS), 1.0),))
    for name in ("femur_r", "tibia_l", "humerus_r"):
        body = MODEL.anatomy.body_index(name)
        assert abs(fit.model.scales[body, 1] / subject.scales[body, 1] - 1.0) < 0.05


def test_a_static_trial_determines_the_zero_of_the_ankle():
    subject = person(MODEL, np.random.default_rng(5))
    moving = points_of(subject, gait(MODEL, 60), 0.004).rows(np.arange(0, 60, 4))
    standing = points_of(subject, np.zeros((6, len(MODEL.anatomy.coordinates))), 0.004)
    upright = np.zeros((6, len(MODEL.anatomy.coordinates)))
    assert is_upright(MODEL, points_of(MODEL, upright, 0.004)).all()
    assert not is_upright(MODEL, moving).any()
    c = MODEL.anatomy.coordinate_index("ankle_angle_r")
    sds = []
    for samples in ((moving_sample(moving, 1.0),), (moving_sample(moving, 1.0), upright_sample(standing, True))):
        fit = fit_subject(MODEL, samples)
        solution = solve(fit.model, moving, fit.prior)
        sds.append(np.sqrt(systematic_covariance(fit, moving, solution)[0, c, c]))
    assert sds[1] < 0.92 * sds[0]
    assert upright_prior(0.5).precision[c, c] > upright_prior().precision[c, c]


def test_points_in_a_wrong_unit_give_finite_sizes():
    points = points_of(MODEL, gait(MODEL, 60), 0.004).rows(np.arange(0, 60, 8))
    for factor in (1e-3, 1e3):
        scaled = replace(points, points_m=factor * points.points_m, information=points.information / factor**2)
        fit = fit_subject(MODEL, (moving_sample(scaled, 1.0),))
        assert np.isfinite(fit.model.scales).all()
        assert np.isfinite(fit.factor).all()


def test_without_frames_a_person_is_the_average():
    fit = fit_subject(MODEL, ())
    assert np.array_equal(fit.model.scales, MODEL.anatomy.unscaled())
    assert (moving_prior().sds() > 0.0).all()


def test_scale_factors_are_symmetric():
    basis, sds = scale_basis(MODEL.anatomy)
    factors = scale_factors(basis, sds * np.random.default_rng(0).standard_normal(len(sds)))
    at = MODEL.anatomy.body_index
    assert np.array_equal(factors[at("femur_r")], factors[at("femur_l")])


def test_placements_are_mirror_images():
    for name in ("halpe_26", "coco_wholebody_133", "mediapipe_33", "h36m_17", "body_25b", "panoptic_19"):
        by_name = {each.keypoint: each for each in placements_of(find_skeleton(name))}
        assert {"left_hip", "right_ankle", "left_shoulder", "right_wrist"} <= set(by_name)
        for keypoint, each in by_name.items():
            twin = by_name[mirrored(keypoint)]
            assert np.allclose(np.multiply(each.place_m, [1, 1, -1]), twin.place_m), (name, keypoint)


def test_noise_does_not_lengthen_limbs():
    coordinates = gait(MODEL, 90)
    zero = np.zeros((1, coordinates.shape[1]))

    def leg_m(model) -> float:
        found = model.anatomy.marker_positions(model.scales, zero, model.markers.bodies, model.markers.locations_m)[0]
        hip, knee, ankle = (found[model.keypoints.index(f"left_{name}")] for name in ("hip", "knee", "ankle"))
        return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))

    fits = (fit_subject(MODEL, (moving_sample(points_of(MODEL, coordinates, 0.04, seed), 1.0),)) for seed in range(6))
    excess_m = np.mean([leg_m(fit.model) for fit in fits]) - leg_m(MODEL)
    # Without a correction, the legs are 7 mm too long.
    assert abs(excess_m) < 0.0035
