"""Agreement of people with a relative pose: the kernel against its plain twin."""

import numpy as np
import pytest

from posefuse.kernels.calibration.people_agreement import N_RESULTS, people_agreement
from posefuse.kernels.calibration.relative_pose import STUDENT_T_DOF
from posefuse.model.cameras import rotation_from_vector
from tests.reference import epipolar as plain


@pytest.mark.no_jit
def test_every_two_people_agree_with_the_plain_twin(rng):
    mirror = np.array([0, 2, 1, 3])
    rotation = rotation_from_vector(np.array([0.1, -0.9, 0.2]))
    translation = np.array([0.8, 0.1, 0.59])
    translation /= np.linalg.norm(translation)

    def view(people):
        rays = np.array([0.0, 0.0, 2.0]) + rng.normal(0.0, 0.6, (3, people, 4, 3))
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        rays[rng.uniform(size=(3, people, 4)) < 0.2] = np.nan
        return rays, rng.uniform(1e-6, 1e-4, (3, people, 4))

    (rays_a, variance_a), (rays_b, variance_b) = view(3), view(2)
    rays_b[1, 0] = np.nan
    results = np.full((3, 3, 2, N_RESULTS), np.nan)
    people_agreement(rotation, translation, rays_a, rays_b, variance_a, variance_b, mirror, results)
    results[..., 0] /= np.maximum(results[..., 1], 1.0)
    for s, i, j in np.ndindex(3, 3, 2):
        expected = plain.people_agreement(
            (rotation, translation), rays_a[s, i], rays_b[s, j], variance_a[s, i], variance_b[s, j], mirror,
            STUDENT_T_DOF,
        )  # fmt: skip
        np.testing.assert_allclose(results[s, i, j], expected, rtol=1e-6, atol=1e-9)
