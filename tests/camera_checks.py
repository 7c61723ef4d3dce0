"""Comparison of cameras."""

from dataclasses import replace

import numpy as np

from posefuse.model.cameras import CameraRig


def assert_same_cameras(actual: CameraRig, expected: CameraRig, atol: float = 1e-12) -> None:
    assert actual.names == expected.names
    for a, b in zip(actual.cameras, expected.cameras, strict=True):
        np.testing.assert_allclose(a.matrix, b.matrix, atol=atol)
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=atol)
        assert (a.lens, a.size_px) == (b.lens, b.size_px)
        np.testing.assert_allclose(a.distortion, b.distortion, atol=atol)


def four_coefficients(rig: CameraRig) -> CameraRig:
    return CameraRig(tuple(replace(c, distortion=(*c.distortion[:4], 0.0)) for c in rig.cameras))
