"""Left-out views are predicted better at their true times, and worse at others."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.clock_coverage import simulate

from posefuse.calibration.joint.estimate import JointEstimate, estimate, sample_frames
from posefuse.calibration.joint.left_out import gain_by_offsets
from posefuse.calibration.joint.parameters import JointParameters

LATE_S = 0.06


@pytest.fixture(scope="module")
def late():
    """Return a recording whose view 1 is late, its estimate, and frames."""
    recording, _ = simulate("walks", 5.0, np.random.default_rng(3))
    times = recording.time_s.copy()
    times[:, 1] -= LATE_S
    recording = replace(recording, time_s=times, common_s=recording.time_s[:, 0])
    joint = estimate(recording)
    assert joint is not None
    return recording, joint, sample_frames(recording, 100)


def late_by(joint: JointEstimate, offset_s: float) -> tuple[JointParameters, np.ndarray]:
    """Return parameters with a time offset of view 1 relative to the others, and the offsets."""
    offsets = np.where(np.arange(len(joint.names)) == 1, offset_s, 0.0)
    return replace(joint.parameters, offset_s=offsets), offsets


def test_true_offset_is_a_gain_and_three_times_as_much_a_loss(late):
    recording, joint, frames = late
    parameters, offset_s = late_by(joint, LATE_S)
    gain = gain_by_offsets(recording, frames, parameters, joint.noise_scale, offset_s)
    assert gain[1] > 0.01
    assert gain[offset_s == 0.0] == pytest.approx(0.0, abs=1e-12)
    parameters, offset_s = late_by(joint, 3.0 * LATE_S)
    assert gain_by_offsets(recording, frames, parameters, joint.noise_scale, offset_s)[1] < -0.01
    parameters, offset_s = late_by(joint, -LATE_S)
    assert gain_by_offsets(recording, frames, parameters, joint.noise_scale, offset_s)[1] < -0.01


def test_two_views_predict_nothing(late):
    recording, joint, frames = late
    two = replace(recording, xy=np.where(np.arange(recording.n_views)[:, None, None] < 2, recording.xy, np.nan))
    gain = gain_by_offsets(two, frames, joint.parameters, joint.noise_scale, np.full(recording.n_views, LATE_S))
    assert np.isnan(gain).all()
