"""The solve at any frame rate, with errors as detectors make them."""

import numpy as np
import pytest

from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.detector import correlated_noise
from tests.scenes import ring
from tests.unit.trajectory.path_problems import ARM, errors_m, exact_pixels, measured, solved, swinging

RATES_HZ = (5.0, 25.0, 60.0, 120.0, 240.0, 500.0, 1000.0)


@pytest.mark.parametrize("lasting", [False, True])
@pytest.mark.parametrize("keypoints", [1, 2, 3])
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_solved_points_are_at_least_as_accurate_as_measured_ones(rate_hz, keypoints, lasting):
    frames = max(round(rate_hz * (1.0 if rate_hz > 100.0 else 3.0)), 30)
    truth = swinging(frames, rate_hz)[:, :keypoints]
    names = ARM.keypoints[:keypoints]
    skeleton = Skeleton("part", names, tuple(edge for edge in ARM.edges if set(edge) <= set(names)))
    solved_m, measured_m = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        pixels = exact_pixels(ring(4), truth)
        normal = correlated_noise if lasting else lambda shape, _, generator: generator.standard_normal(shape)
        # Student's t with 2.7 degrees of freedom, about.
        spread = np.sqrt(np.square(normal((*pixels.shape[:-1], 3), rate_hz, rng)).mean(axis=-1, keepdims=True))
        pixels = pixels + 4.0 * normal(pixels.shape, rate_hz, rng) / spread
        recording = measured(truth, pixels=pixels, noise_px=4.0, skeleton=skeleton, rate_hz=rate_hz)
        layer = solved(recording)
        both = np.stack([errors_m(layer, truth), errors_m(recording.layer, truth)])
        both = both[:, np.isfinite(both).all(axis=0)].mean(axis=1)
        solved_m.append(both[0])
        measured_m.append(both[1])
    assert np.mean(solved_m) <= 1.02 * np.mean(measured_m)
