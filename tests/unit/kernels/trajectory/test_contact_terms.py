"""The terms of resting keypoints are the derivatives of a sum of squares."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.blocks import empty_blocks, from_blocks, matrices_from_blocks
from posefuse.kernels.trajectory.contact_terms import ContactTerms, add_contact
from posefuse.kernels.trajectory.observation_terms import PathSystem

KEYPOINTS, FRAMES = 3, 18


def problem(seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    contact = ContactTerms(
        np.array([2, 0]),
        rng.uniform(0.0, 3.0, (2, FRAMES - 1)) * (rng.uniform(size=(2, FRAMES - 1)) < 0.7),
        rng.normal(size=(FRAMES - 1, 3)),
        normal / np.linalg.norm(normal),
        rng.normal(size=(2, FRAMES)),
        rng.uniform(0.0, 3.0, (2, FRAMES)) * (rng.uniform(size=(2, FRAMES)) < 0.7),
    )
    return contact, rng.normal(size=(KEYPOINTS, FRAMES, 3))


def cost(contact, paths):
    """Half the weighted sum of squared slips and heights."""
    total = 0.0
    for c, k in enumerate(contact.keypoints):
        slips = np.diff(paths[k], axis=0) - contact.steps_m
        heights = paths[k] @ contact.normal - contact.heights_m[c]
        total += 0.5 * (contact.rest[c] @ np.square(slips).sum(axis=1) + contact.support[c] @ np.square(heights))
    return total


@pytest.mark.no_jit
@pytest.mark.parametrize("seed", range(3))
def test_terms_are_derivatives_of_the_cost(seed):
    contact, paths = problem(seed)
    system = PathSystem(*(np.zeros_like(empty_blocks(KEYPOINTS, FRAMES, rows)) for rows in (6, 3, 3, 6)))
    add_contact(contact, paths, system)
    rhs = from_blocks(system.rhs, FRAMES)
    diagonal, coupling = matrices_from_blocks(system.diagonal, FRAMES), from_blocks(system.coupling, FRAMES)
    step = 1e-4
    unit = step * np.eye(paths.size).reshape(paths.size, *paths.shape)
    gradient = [(cost(contact, paths + each) - cost(contact, paths - each)) / (2.0 * step) for each in unit]
    np.testing.assert_allclose(rhs.ravel(), -np.array(gradient), atol=1e-6)
    whole = np.zeros((KEYPOINTS, FRAMES, 3, KEYPOINTS, FRAMES, 3))
    for k in range(KEYPOINTS):
        for f in range(FRAMES):
            whole[k, f, :, k, f] = diagonal[k, f]
            for m in range(1, min(3, f) + 1):
                whole[k, f, :, k, f - m] = whole[k, f - m, :, k, f] = coupling[k, f, m - 1] * np.eye(3)
    moved = paths + np.random.default_rng(9).normal(size=paths.shape)
    change = (moved - paths).ravel()
    expected = cost(contact, paths) - rhs.ravel() @ change + 0.5 * change @ whole.reshape(paths.size, -1) @ change
    assert cost(contact, moved) == pytest.approx(expected)
