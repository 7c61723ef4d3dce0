"""Ray intersection and distances against the reference."""

import numpy as np
import pytest

from posefuse.kernels.cameras import points, rays
from tests.kernels import from_python
from tests.reference import points as naive
from tests.scenes import body_points, ring

point_ray_distance = from_python(rays.point_ray_distance)

pytestmark = pytest.mark.no_jit


def intersect(origins, directions, weights):
    n = len(directions)
    out = np.empty((n, 3)), np.empty((n, 6)), np.empty(n, dtype=np.int64)
    rays.intersect_rays(origins, directions, weights, *out)
    return out


def test_agrees_with_the_reference(rng):
    origins = rng.normal(size=(5, 3)) * 4
    directions = rng.normal(size=(40, 5, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    weights = rng.uniform(0.1, 2.0, (40, 5))
    found, covariance, status = intersect(origins, directions, weights)
    assert (status == points.OK).all()
    for n in range(40):
        np.testing.assert_allclose(found[n], naive.intersect_rays(origins, directions[n], weights[n]), atol=1e-9)
    assert (covariance[:, [0, 3, 5]] > 0).all()


def test_rays_of_a_point_meet_there(rng):
    rig = ring(4, "fisheye")
    truth = body_points(rng, 30, 1)[:, 0]
    directions = np.stack(
        [camera.rays(camera.project(truth)[0])[0] @ camera.rotation for camera in rig.cameras], axis=1
    )
    origins = np.stack([camera.center_m for camera in rig.cameras])
    weights = np.ones((30, 4))
    directions[0, 2] = np.nan
    weights[1, 0] = 0.0
    found, _, status = intersect(origins, np.ascontiguousarray(directions), weights)
    assert (status == points.OK).all()
    np.testing.assert_allclose(found, truth, atol=1e-7)


def test_parallel_or_single_rays_determine_no_point():
    origins = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    directions = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0], [np.nan] * 3]])
    found, covariance, status = intersect(origins, directions, np.ones((2, 2)))
    assert (status == points.SINGULAR).all()
    assert np.isnan(found).all()
    assert np.isnan(covariance).all()


def test_distances(rng):
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    s, p = rng.normal(size=(2, 3))
    distance, along = point_ray_distance(*p, *s, *d)
    assert distance == pytest.approx(np.linalg.norm(np.cross(d, p - s)))
    assert along == pytest.approx(d @ (p - s))
