"""Image transforms of a recording model."""

import numpy as np
import pytest

from posefuse.diagnostics.recording_model import ImageTransform


@pytest.mark.parametrize("quarter_turns", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
def test_undo_inverts_turns_and_mirroring(quarter_turns, mirrored, rng):
    size = (7, 5)
    u, v = np.meshgrid(np.arange(7.0), np.arange(5.0))
    picture = rng.random((5, 7))
    transformed = np.rot90(picture[:, ::-1] if mirrored else picture, -quarter_turns)
    height, width = transformed.shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([x, y], axis=-1).astype(float)
    original = ImageTransform(quarter_turns, mirrored).undo(pixels, size).astype(int)
    assert (picture[original[..., 1], original[..., 0]] == transformed).all()
    assert u.shape == v.shape == picture.shape


def test_resizing_keeps_the_corner_of_the_image():
    corner = ImageTransform(scale=0.5).undo(np.array([-0.5, -0.5]), (8, 6))
    assert corner == pytest.approx([-0.5, -0.5])
