"""The equations agree with numerical derivatives, and errors of velocities pretend no information."""

import numpy as np
import pytest

from posefuse.calibration.joint import triangulated
from posefuse.calibration.joint.equations import linearize, normal_equations, observed_curvature
from posefuse.calibration.joint.estimate import estimate
from posefuse.kernels.calibration.joint import VIEW_PARAMETERS


def test_curvature_is_the_derivative_of_the_score(stand, monkeypatch):
    """The curvature of barely determined directions, where the second derivatives of the projections matter."""
    monkeypatch.setattr(triangulated, "_POINT_STEPS", 20)
    joint = estimate(stand[0])
    assert joint is not None
    at = (joint.rows.frames, joint.parameters, joint.noise_scale)
    rows = linearize(stand[0], *at)
    curvature = observed_curvature(rows)
    poses = np.flatnonzero(np.arange(len(curvature)) % VIEW_PARAMETERS < 6)
    values, vectors = np.linalg.eigh(curvature[np.ix_(poses, poses)])
    for k in (7, 8, 9, -1):
        direction = np.zeros(len(curvature))
        direction[poses] = vectors[:, k]
        step = 0.05 * values[k] ** -0.5 * direction.reshape(-1, VIEW_PARAMETERS)
        scores = [
            normal_equations(linearize(stand[0], at[0], at[1].changed(s), at[2], rows.support_m))[1]
            for s in (-step, step)
        ]
        slope = (scores[0] - scores[1]) @ direction / (0.1 * values[k] ** -0.5)
        assert slope == pytest.approx(values[k], rel=0.15)


def test_person_who_stands_still_does_not_show_the_time(stand, walk):
    standing, walking = estimate(stand[0]), estimate(walk[0])
    assert standing is not None
    assert walking is not None
    assert not standing.rows.velocity_m_s.any()
    assert not standing.determined[:, 6:].any()
    assert walking.rows.velocity_m_s.any()
    assert walking.determined[:, 6].all()
