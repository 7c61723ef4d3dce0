"""Coverage of calibrations from people does not depend on the world, and falls if covariances are too small."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_recordings import CalibrationCase
from benchmarks.people_calibration import Calibrated, calibrate
from benchmarks.people_coverage import PARAMETERS, PRINCIPAL_SD, coverage, groups_of, regions, trial_options
from benchmarks.simulated_rigs import RigOptions, simulate_rig

from tests.unit.benchmarks.test_calibration_scores import moved


@pytest.fixture(scope="module")
def solved() -> tuple[CalibrationCase, Calibrated]:
    case = simulate_rig(RigOptions(cameras=4, duration_s=4.0, max_offset_s=1.0, seed=5))
    return case, calibrate(case, focal_known=False, start="truth")


def test_regions_do_not_depend_on_the_world_of_the_truth(solved):
    case, found = solved
    levels, sds = regions(case, found)
    elsewhere = replace(case, rig=moved(case.rig, [0.3, -2.0, 0.4], [1.0, -3.0, 2.0], 2.5))
    again, _ = regions(elsewhere, found)
    assert set(levels) == set(PARAMETERS) == set(sds)
    for name in PARAMETERS:
        assert len(levels[name]) == 4
        assert again[name] == pytest.approx(levels[name], abs=0.02)


def test_too_small_covariances_do_not_cover(solved):
    case, found = solved
    joint = replace(found.estimate.joint, covariance=1e-4 * found.estimate.joint.covariance)
    boasting = replace(found, estimate=replace(found.estimate, joint=joint))
    levels, _ = regions(case, boasting)
    assert coverage(list(levels.values())) < 0.3
    assert np.isnan(coverage([]))


def test_trial_is_in_one_group_of_each_kind():
    options = {"layout": "ring", "people": "walks", "cameras": 4, "max_offset_s": 0.0}
    assert groups_of(options, focal_known=True) == {"ring", "walks", "3-5", "known", "together"}


def test_regions_contain_cameras_with_principal_points_off_the_middle():
    """With little noise, regions of rotations that take them for centered are a fraction of the errors."""
    options = RigOptions(cameras=6, duration_s=6.0, noise=0.3, principal_sd=PRINCIPAL_SD, seed=7)
    case = simulate_rig(options)
    found = calibrate(case, focal_known=False, start="truth", seed=7)
    levels, _ = regions(case, found)
    assert coverage([levels["rotation"]]) > 0.6
    away = [camera.matrix[:2, 2] for camera in found.estimate.cameras]
    assert np.ptp(away, axis=0).min() > 0.0
    assert found.estimate.other is not None
    assert found.estimate.other.parameters.tolist() == [[v, i] for v in range(6) for i in (8, 9)]


def test_only_unknown_lenses_have_principal_points_off_the_middle():
    assert [trial_options(seed)[0].principal_sd for seed in (4, 5)] == [PRINCIPAL_SD, 0.0]
    assert [trial_options(seed)[1] for seed in (4, 5)] == [False, True]
