"""Projection matrices."""

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.calibration.projections import decompose_projection
from tests.scenes import ring


@pytest.mark.parametrize("factor", [1.0, -1.0, 1e-3, -250.0])
def test_projection_is_decomposed_at_any_scale(factor):
    camera = ring(3).cameras[1]
    projection = factor * camera.matrix @ camera.camera_from_world[:3]
    matrix, rotation, translation = decompose_projection(projection, "here")
    np.testing.assert_allclose(matrix, camera.matrix, atol=1e-8)
    np.testing.assert_allclose(rotation, camera.rotation, atol=1e-12)
    np.testing.assert_allclose(translation, camera.translation_m, atol=1e-10)


def test_invalid_projection_is_an_error():
    with pytest.raises(FileError, match="is not a projection matrix"):
        decompose_projection(np.zeros((3, 4)), "here")
