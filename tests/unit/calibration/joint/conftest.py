"""Simulated recordings for the joint estimate."""

import numpy as np
import pytest
from benchmarks.clock_coverage import simulate

from posefuse.calibration.joint.recording import JointRecording


@pytest.fixture(scope="session")
def walk() -> tuple[JointRecording, np.ndarray]:
    """Return five seconds of walking, and the true changes of the cameras."""
    return simulate("walks", 5.0, np.random.default_rng(3))


@pytest.fixture(scope="session")
def stand() -> tuple[JointRecording, np.ndarray]:
    """Return three seconds of standing, and the true changes of the cameras."""
    return simulate("stands", 3.0, np.random.default_rng(3))
