"""Up axes and inferred up directions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.errors import CameraError
from posefuse.model.up_axis import MAX_AXIS_ANGLE_DEG, UP_AXES, InferredUp, up_vector
from tests.properties import examples
from tests.scenes import ring


@given(st.integers(0, 2**32 - 1))
@examples(100)
def test_axis_is_the_nearest_one_within_the_limit(seed):
    direction = np.random.default_rng(seed).normal(size=3)
    up = InferredUp(tuple(direction / np.linalg.norm(direction)), 5.0)
    angles = {axis: np.degrees(np.arccos(np.dot(up_vector(axis), up.direction))) for axis in UP_AXES}
    assert up.angle_deg == pytest.approx(min(angles.values()), abs=1e-6)
    assert angles[up.nearest_axis] == min(angles.values())
    assert up.axis == (up.nearest_axis if up.angle_deg <= MAX_AXIS_ANGLE_DEG else None)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 0.5), (0.0, 1.0), (0.0, 0.0, np.nan)])
def test_direction_must_be_a_unit_vector(direction):
    with pytest.raises(CameraError, match="unit vector"):
        InferredUp(direction, 5.0)


def test_rig_names_inferred_axes():
    rig = ring(3)
    up = InferredUp((0.0, -0.6, 0.8), 5.0)
    between = InferredUp((0.0, -(0.5**0.5), 0.5**0.5), 5.0)
    assert (rig.up_text, rig.up) == ("z", (0.0, 0.0, 1.0))
    assert (rig.with_up(None).up_text, rig.with_up(None).up) == ("unknown", None)
    assert (rig.with_up(None, between).up_text, rig.with_up(None, between).up_axis) == ("unknown (inferred)", None)
    assert rig.with_up(None, between).up is None
    assert up.angle_deg > MAX_AXIS_ANGLE_DEG
    small = InferredUp((0.0, -0.28, 0.96), 5.0)
    assert (rig.with_up("x", small).up_text, rig.with_up("x", small).up_axis) == ("z (inferred)", "z")
    assert rig.with_up("x", small).up == (0.0, 0.0, 1.0)
    assert small.level_direction == small.direction
    assert InferredUp(small.direction, 11.0).level_direction == (0.0, 0.0, 1.0)
    with pytest.raises(CameraError, match="inferred_up"):
        replace(rig, up_axis="x", inferred_up=small)
