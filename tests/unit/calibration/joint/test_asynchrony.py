"""Free-running cameras are told from triggered ones by all clocks together."""

import numpy as np
import pytest

from posefuse.calibration.joint.asynchrony import log_odds_of_free_running
from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.evidence import DECISIVE, Explanation, choose
from posefuse.calibration.joint.recording import JointRecording

from .test_evidence import variances, with_data

PERIOD_S = 0.04


@pytest.fixture(scope="module")
def joint(walk: tuple[JointRecording, np.ndarray]) -> JointEstimate:
    """Return the estimate of a walk."""
    out = estimate(walk[0])
    assert out is not None
    return out


def with_offsets(joint: JointEstimate, offset_s: np.ndarray) -> JointEstimate:
    """Return an estimate whose keypoints tell some time offsets to 2 ms."""
    change = np.zeros_like(joint.change)
    change[:, 6] = offset_s
    return with_data(joint, change, variances(joint, 0.002))


def test_offsets_of_a_part_of_a_frame_show_free_running_cameras(joint, rng):
    for _ in range(10):
        late = with_offsets(joint, PERIOD_S * rng.uniform(-0.5, 0.5, len(joint.names)))
        assert choose(late) == ()
        assert log_odds_of_free_running(late, (), PERIOD_S) > DECISIVE


def test_errors_of_a_trigger_do_not(joint, rng):
    for _ in range(10):
        triggered = with_offsets(joint, 1.5e-3 * rng.standard_normal(len(joint.names)))
        assert log_odds_of_free_running(triggered, (), PERIOD_S) < 0.0


def test_one_late_view_among_triggered_ones_does_not(joint):
    offset_s = np.zeros(len(joint.names))
    offset_s[1] = 0.2
    late = with_offsets(joint, offset_s)
    assert log_odds_of_free_running(late, (Explanation("offset", 1, 0.1),), PERIOD_S) < 0.0
