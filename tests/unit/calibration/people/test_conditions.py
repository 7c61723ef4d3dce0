"""What a calibration from people needs, and what errors say."""

import numpy as np
import pytest

from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.conditions import check_perspective
from posefuse.errors import CalibrationError


def view(name: str, extent_deg: float) -> Bearings:
    """Return directions within an angle."""
    angle = 0.5 * np.radians(extent_deg) * np.linspace(-1.0, 1.0, 50)[:, None, None]
    rays = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)
    sigma = np.full(angle.shape, 1e-3)
    return Bearings(name, np.arange(50.0), rays, sigma, np.arange(1), np.arange(1))


def test_views_with_weak_perspective_are_named():
    """One telephoto lens can be related to two others, but not two to one."""
    check_perspective([view("a", 30.0), view("b", 30.0), view("c", 1.0)])
    with pytest.raises(CalibrationError, match=r"within 4 degrees: b \(0\.92 degrees\), c \(2\.8 degrees\)"):
        check_perspective([view("a", 30.0), view("b", 1.0), view("c", 3.0)])
