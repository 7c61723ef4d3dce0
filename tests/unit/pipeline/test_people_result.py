"""The covariance of a calibration relative to its first camera."""

import numpy as np
import pytest

from posefuse.alignment.apply import aligned_rig
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig, rotation_from_vector, vector_from_rotation
from posefuse.pipeline.people_result import relative_changes
from posefuse.synthetic.rigs import build_rig

RIG = build_rig("ring", 4, "pinhole")
SIZE = 9


def change_of(before: CameraRig, after: CameraRig) -> np.ndarray:
    """Return the small changes between two rigs, shape (view, 9)."""
    out = np.zeros((len(before), SIZE))
    for v, (a, b) in enumerate(zip(before.cameras, after.cameras, strict=True)):
        out[v, :3] = vector_from_rotation(b.rotation @ a.rotation.T)
        out[v, 3:6] = b.center_m - a.center_m
    return out


def relative_covariance(rig: CameraRig, covariance: np.ndarray) -> np.ndarray:
    change = relative_changes(rig, size=SIZE)
    return (change @ covariance.reshape(change.shape) @ change.T).reshape(covariance.shape)


def rank_one(change: np.ndarray) -> np.ndarray:
    flat = change.ravel()
    return np.outer(flat, flat).reshape(len(change), SIZE, len(change), SIZE)


@pytest.mark.parametrize("seed", range(3))
def test_changes_of_the_world_are_no_uncertainty(seed):
    rng = np.random.default_rng(seed)
    small = 1e-5
    world = Alignment(rotation_from_vector(small * rng.normal(size=3)), small * rng.normal(size=3), 1.0 + small)
    change = change_of(RIG, aligned_rig(RIG, world))
    change[:, 6:8] = small * rng.normal(size=2)
    left = relative_covariance(RIG, rank_one(change))
    assert np.abs(left).max() < 1e-4 * np.abs(rank_one(change)).max()


def test_the_first_camera_is_exact_and_others_keep_their_relative_errors():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4 * SIZE, 4 * SIZE))
    relative = relative_covariance(RIG, (root @ root.T).reshape(4, SIZE, 4, SIZE))
    assert np.abs(relative[0, :8]).max() < 1e-9
    assert np.allclose(relative_covariance(RIG, relative), relative, atol=1e-9)
    turned = np.zeros((4, SIZE))
    turned[2, 1] = 1.0
    assert relative_covariance(RIG, rank_one(turned))[2, 1, 2, 1] == pytest.approx(1.0)
