"""Gait cycles of angles that pass 180 degrees, and of the pelvis relative to the direction of walking."""

import numpy as np
import pytest

from posefuse.biomechanics.angle_definitions import wrapped
from posefuse.biomechanics.cycles import PERCENT, gait_cycles
from posefuse.biomechanics.floor_levels import Levels
from posefuse.biomechanics.foot_paths import FootPaths
from posefuse.biomechanics.gait_events import GaitEvent

STRIDE_S, RATE_HZ, N_STRIDES = 1.1, 60.0, 6
TIME_S = np.arange(0.0, (N_STRIDES + 1) * STRIDE_S, 1.0 / RATE_HZ)
SWAY_DEG = 5.0 * np.sin(2.0 * np.pi * TIME_S / STRIDE_S)


def cycles_of(heading_deg, angles_deg, speed_m_s=1.2, belt=False):
    """Return the cycles of a person who walks in a direction, shape (frame,), by signal."""
    turned = np.radians(heading_deg)
    velocity = speed_m_s * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    ground = -velocity[0] if belt else np.zeros(2)
    place = np.cumsum(velocity / RATE_HZ, axis=0) * (0.0 if belt else 1.0)
    hips = np.zeros((len(TIME_S), 2, 3))
    hips[..., :2] = place[:, None]
    hips[..., 2] = 0.9
    feet = np.zeros((len(TIME_S), 2, 2, 3))
    feet[..., :2] = place[:, None, None]
    paths = FootPaths(TIME_S, feet, np.zeros_like(feet), hips, *np.zeros((2, len(TIME_S), 2)))
    events = [GaitEvent("heel_strike", 0, 0.2 + i * STRIDE_S, 0.01, 1.0, 0) for i in range(N_STRIDES)]
    both = {name: np.repeat(wrapped(each)[:, None], 2, axis=1) for name, each in angles_deg.items()}
    return {each.signal: each for each in gait_cycles(paths, events, Levels.none(), both, ground)}


EXPECTED = 5.0 * np.sin(2.0 * np.pi * (PERCENT / 100.0 + 0.2 / STRIDE_S))


@pytest.mark.parametrize("belt", [False, True])
@pytest.mark.parametrize("heading", [0.0, 90.0, 179.0, -178.0])
def test_rotation_of_the_pelvis_is_relative_to_the_direction_of_walking(heading, belt):
    whole = np.full(len(TIME_S), heading)
    found = cycles_of(whole, {"pelvis_rotation": whole + SWAY_DEG}, belt=belt)["pelvis_rotation_deg"]
    np.testing.assert_allclose(found.mean, EXPECTED, atol=0.1)
    assert found.sd.max() < 0.1


@pytest.mark.parametrize("turn_deg_s", [60.0, -45.0])
def test_a_curved_path_does_not_change_the_rotation_of_the_pelvis(turn_deg_s):
    heading = 150.0 + turn_deg_s * TIME_S
    found = cycles_of(heading, {"pelvis_rotation": heading + SWAY_DEG})["pelvis_rotation_deg"]
    # The recording ends half a stride before the directions of the first and last stride are complete.
    assert np.abs(found.mean - EXPECTED).max() < 5.0
    assert np.abs(found.mean - EXPECTED)[40:60].max() < 0.5


def test_a_person_who_walks_backward_has_a_rotation_of_half_a_turn():
    heading = np.full(len(TIME_S), 30.0)
    found = cycles_of(heading, {"pelvis_rotation": heading + 180.0 + SWAY_DEG})["pelvis_rotation_deg"]
    assert np.abs(found.mean).mean() == pytest.approx(180.0, abs=1.0)
    assert found.sd.max() < 0.1


def test_strides_on_the_spot_have_no_direction():
    still = np.zeros(len(TIME_S))
    found = cycles_of(still, {"pelvis_rotation": SWAY_DEG, "pelvis_tilt": SWAY_DEG}, speed_m_s=0.05)
    assert "pelvis_rotation_deg" not in found
    assert found["pelvis_tilt_deg"].n.min() == N_STRIDES - 1


@pytest.mark.parametrize("middle", [0.0, 178.0, -179.0, 540.0])
def test_angles_that_pass_half_a_turn_are_averaged_on_one_branch(middle):
    # Whole turns between strides, as an angle that was followed over time may have.
    angle = middle + SWAY_DEG + 360.0 * np.floor(TIME_S / STRIDE_S)
    found = cycles_of(np.zeros(len(TIME_S)), {"arm_rot": angle})["arm_rot_deg"]
    np.testing.assert_allclose(wrapped(found.mean - middle), EXPECTED, atol=0.1)
    assert np.ptp(found.mean) < 11.0
    assert found.sd.max() < 0.1


def test_missing_frames_do_not_hide_other_strides():
    angle = 179.0 + SWAY_DEG
    angle[100:130] = np.nan
    found = cycles_of(np.zeros(len(TIME_S)), {"arm_rot": angle})["arm_rot_deg"]
    assert found.n.max() == N_STRIDES - 1
    assert found.n.min() >= N_STRIDES - 2
    assert found.sd.max() < 0.1
