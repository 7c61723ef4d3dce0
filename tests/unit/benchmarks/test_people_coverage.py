"""Coverage of calibrations from people does not depend on the world, and falls if covariances are too small."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_recordings import CalibrationCase
from benchmarks.people_calibration import Calibrated, calibrate
from benchmarks.people_coverage import PARAMETERS, coverage, groups_of, regions
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
