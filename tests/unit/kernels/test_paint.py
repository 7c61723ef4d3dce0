"""Painting against the reference, pixel by pixel over the whole image."""

import numpy as np
import pytest

from posefuse.kernels.visualize.paint import COLUMNS, paint
from tests.reference.paint import paint as paint_slowly


def random_shapes(rng: np.random.Generator, n: int) -> np.ndarray:
    shapes = np.empty((n, COLUMNS))
    shapes[:, :4] = rng.uniform(-30, 70, (n, 4))
    shapes[::3, 2:4] = shapes[::3, :2]
    shapes[1::5, 3] = shapes[1::5, 1]
    shapes[:, 4] = np.where(np.arange(n) % 3 == 0, rng.uniform(0, 12, n), 0.0)
    shapes[:, 5] = rng.uniform(0.2, 4, n)
    shapes[:, 6:9] = rng.integers(0, 256, (n, 3))
    shapes[:, 9] = rng.uniform(0.2, 1, n)
    return shapes


@pytest.mark.no_jit
def test_painting_matches_the_reference(rng):
    image = rng.integers(0, 256, (31, 47, 3)).astype(np.uint8)
    shapes = random_shapes(rng, 40)
    painted = image.copy()
    paint(painted, shapes)
    slowly = paint_slowly(image, shapes)
    assert np.abs(painted.astype(int) - slowly).max() <= 1  # what is rounded at a half may fall to either side
    assert (painted != image).any()


def test_missing_and_distant_shapes_paint_nothing(rng):
    image = rng.integers(0, 256, (20, 30, 3)).astype(np.uint8)
    shapes = random_shapes(rng, 6)
    shapes[0, 0] = np.nan
    shapes[1, 3] = np.inf
    shapes[2:, :4] = [1e300, 1e300, 1e300, 1e300]
    painted = image.copy()
    paint(painted, shapes)
    assert (painted == image).all()


def test_a_disc_covers_its_area():
    image = np.zeros((41, 41, 3), dtype=np.uint8)
    paint(image, np.array([[20.3, 19.8, 20.3, 19.8, 0, 10.0, 255, 255, 255, 1.0]]))
    assert image[..., 0].sum() / 255 == pytest.approx(np.pi * 100, rel=0.01)
