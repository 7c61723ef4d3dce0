"""Any similarity transform of a result keeps every finite standard deviation, and transforms it as its quantity."""

from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from posefuse.alignment.apply import align
from posefuse.biomechanics.tables import keypoint_angles
from posefuse.model.alignment import Alignment
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction, unpack_covariance
from posefuse.model.up_axis import UP_AXES, InferredUp, up_vector
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.properties import examples

seeds = st.integers(0, 2**31 - 1)
axes = st.sampled_from(UP_AXES)
scales = st.floats(1e-3, 1e3)


@cache
def walker() -> Reconstruction:
    """Return a result with every layer and fitted bodies."""
    scene = simulate(SceneOptions(duration_s=1.0, cameras=4, seed=3))
    result = reconstruct(scene.rig, scene.detections, Options(bodies="fit", solve="trajectory", health="off"))
    assert set(result.layers) == {"measured", "solved", "model"}
    return result


def rotation_to(axis: str, seed: int) -> np.ndarray:
    """Return a rotation that maps the direction z to an axis, with a random heading."""
    to_axis, _ = Rotation.align_vectors([up_vector(axis)], [[0.0, 0.0, 1.0]])
    heading = np.random.default_rng(seed).uniform(-np.pi, np.pi)
    return to_axis.as_matrix() @ Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix()


@given(seed=seeds, scale=scales, axis=axes)
@examples(15)
def test_every_finite_sd_stays_finite_and_is_transformed(seed, scale, axis):
    result = walker()
    rotation = Rotation.random(random_state=seed).as_matrix()
    shift = np.random.default_rng(seed).normal(0.0, 100.0, 3)
    moved = align(result, Alignment(rotation, shift, scale, axis, "z"))
    for name, layer in result.layers.items():
        before, after = (unpack_covariance(each.layers[name].covariance_m2) for each in (result, moved))
        np.testing.assert_allclose(after, scale**2 * rotation @ before @ rotation.T, rtol=1e-6, atol=1e-12 * scale**2)
        np.testing.assert_array_equal(np.isfinite(after), np.isfinite(before))
        assert np.isfinite(after).all(axis=(-1, -2)).any(), name
        np.testing.assert_array_equal(moved.layers[name].status, layer.status)
    np.testing.assert_allclose(moved.poses.shape_sd_m, scale * np.asarray(result.poses.shape_sd_m))
    (names, degrees, sds), (_, _, sds_before) = keypoint_angles(moved), keypoint_angles(result)
    assert np.isfinite(sds[np.isfinite(sds_before)]).all()
    np.testing.assert_array_equal(np.isfinite(sds), np.isfinite(degrees))
    inner = [not name.startswith("mid_hip.") for name in names]
    np.testing.assert_allclose(sds[..., inner], sds_before[..., inner])
    np.testing.assert_array_equal(moved.poses.angle_sd_deg, sds)


@given(seed=seeds, scale=scales, axis=axes)
@examples(15)
def test_root_angle_sds_are_the_same_in_every_world_with_the_same_vertical(seed, scale, axis):
    result = walker()
    moved = align(result, Alignment(rotation_to(axis, seed), np.ones(3), scale, axis, "z"))
    (_, degrees, sds), (_, degrees_before, sds_before) = keypoint_angles(moved), keypoint_angles(result)
    np.testing.assert_allclose(sds, sds_before, rtol=1e-4)
    # The heading is relative to the world; tilt and list are not.
    np.testing.assert_allclose(degrees[..., 1:], degrees_before[..., 1:], atol=1e-6)


@given(seed=seeds, axis=axes)
@examples(10)
def test_alignments_compose_and_can_be_undone(seed, axis):
    result = walker()
    first, second = (Rotation.random(random_state=seed + i).as_matrix() for i in range(2))
    once = align(result, Alignment(first, np.ones(3), 2.0, None, "z"))
    twice = align(once, Alignment(second, np.zeros(3), 0.5, axis))
    direct = align(result, Alignment(second @ first, 0.5 * second @ np.ones(3), 1.0, axis, "z"))
    np.testing.assert_allclose(twice.poses.angle_sd_deg, direct.poses.angle_sd_deg, rtol=1e-4)
    back = align(direct, direct.alignment.inverse)
    np.testing.assert_allclose(back.poses.angle_sd_deg, result.poses.angle_sd_deg, rtol=1e-4)


@given(seed=seeds, axis=axes)
@examples(10)
def test_inferred_up_directions_are_transformed_and_restored(seed, axis):
    up = InferredUp((0.0, np.sin(0.2), np.cos(0.2)), 6.0)
    result = replace(walker(), rig=walker().rig.with_up(None, up))
    rotation = Rotation.random(random_state=seed).as_matrix()
    there = InferredUp(up_vector(axis), 6.0)
    alignment = Alignment(rotation, np.ones(3), 2.0, axis, "z", inferred_up=there, calibration_inferred_up=up)
    moved = align(result, alignment)
    assert moved.rig.inferred_up == there
    assert moved.rig.up_text == f"{axis} (inferred)"
    assert align(moved, alignment.inverse).rig.inferred_up == up
