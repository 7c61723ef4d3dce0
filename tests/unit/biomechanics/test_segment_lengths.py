"""Segment lengths."""

import numpy as np
import pytest

from posefuse.biomechanics.segment_lengths import segment_lengths


def test_segment_lengths(truth, layer):
    name, _ = truth.best_layer()
    actual = segment_lengths(truth.chunks(4), name)
    shank = next(each for each in actual if (each.near, each.far) == ("left_knee", "left_ankle"))
    points = np.asarray(layer.points_m)[:, 0]
    lengths = np.linalg.norm(
        points[:, truth.skeleton.index("left_knee")] - points[:, truth.skeleton.index("left_ankle")], axis=-1
    )
    assert shank.median_m == pytest.approx(np.median(lengths), rel=1e-6)
    assert shank.sd_m == pytest.approx(1.4826 * np.median(np.abs(lengths - np.median(lengths))), abs=1e-6)
    assert shank.n_frames == 15
