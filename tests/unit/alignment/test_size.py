"""Size of the world."""

import numpy as np
import pytest

from posefuse.alignment.size import estimate_height_m, scale_factor
from posefuse.model.options.alignment import AlignOptions


def test_scale_from_height_or_distance(walker, true_points):
    skeleton = walker.truth.skeleton
    length = np.median(
        np.linalg.norm(
            true_points[:, 0, skeleton.index("left_hip")] - true_points[:, 0, skeleton.index("left_knee")], axis=-1
        )
    )
    options = AlignOptions(length_m=2 * length, length_between=("left_hip", "left_knee"))
    assert scale_factor([true_points], skeleton, options) == pytest.approx(2.0)
    height = estimate_height_m([true_points], skeleton)
    assert estimate_height_m([2 * true_points], skeleton) == pytest.approx(2 * height)
    top = true_points[:, 0, skeleton.index("head_top"), 2]
    assert height == pytest.approx(np.nanmax(top), rel=0.08)
