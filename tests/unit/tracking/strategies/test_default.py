"""The default strategy of the tracker."""

import numpy as np

from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies import default
from tests.unit.tracking.strategies.test_specification import standing, unknown

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 4)
VIEWS, KEYPOINTS = len(RIG), len(SKELETON)
SIGMA_PX = 5.0
SETTINGS = TrackerSettings.of(
    RIG, SKELETON, NoiseModel(np.full(VIEWS, SIGMA_PX), 1.0), TrackerOptions(strategy="specification")
)
TREE = SETTINGS.tree


def test_propagated_prior_keeps_covariances() -> None:
    state = standing()
    before = state.covariance.copy()
    default.STRATEGY.prior.prepare(state, unknown())
    np.testing.assert_array_equal(state.covariance, before)
