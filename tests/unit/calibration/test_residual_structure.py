"""Structure of residuals over the image."""

import numpy as np
import pytest

from posefuse.calibration.residual_structure import residual_structure
from posefuse.model.calibration_summary import CameraSummary

SIZE = (1200, 800)


def camera(systematic_px, n_images=60, common_px=0.5):
    """Points of many images with an error of each image, noise, and an error that grows from the center."""
    rng = np.random.default_rng(0)
    image = np.repeat(np.arange(n_images), 20)
    pixels = rng.uniform((0, 0), SIZE, (len(image), 2))
    residual = rng.normal(0.0, common_px, (n_images, 2))[image] + rng.normal(0.0, 0.3, pixels.shape)
    outward = (pixels - np.array(SIZE) / 2) / np.linalg.norm(np.array(SIZE) / 2)
    return CameraSummary(pixels, residual + systematic_px * outward, image, 0.0, 0.0, 0.0, lens_given=True)


@pytest.mark.parametrize("systematic_px", [0.0, 1.0, 3.0])
def test_systematic_part_is_told_from_errors_of_images(systematic_px):
    found = residual_structure(camera(systematic_px), SIZE)
    outward = np.hypot(
        *(np.stack(np.meshgrid(np.linspace(-1, 1, 50), np.linspace(-1, 1, 50))) * [[[0.832]], [[0.555]]])
    )
    expected = systematic_px * np.sqrt(np.mean(outward**2))
    assert found.systematic_px == pytest.approx(expected, abs=0.1)


def test_few_images_have_no_structure():
    found = residual_structure(camera(1.0, n_images=2), SIZE)
    assert np.isnan(found.systematic_px)
    assert np.isnan(found.mean_px).all()
