"""Motion options of bodies of other sizes."""

import pytest

from posefuse.model.options.tracking_motion import MotionOptions, PartOptions, time_factor


@pytest.mark.parametrize("options", [MotionOptions(), PartOptions()])
def test_scaling_is_undone_by_its_inverse(options):
    assert options.in_proportion(1.0) == options
    restored = options.in_proportion(0.05).in_proportion(20.0)
    for name, value in vars(options).items():
        assert getattr(restored, name) == pytest.approx(value)


def test_stationary_speed_scales_with_length_over_time():
    """The variance of the velocity is half the density times the decay time."""
    scale, human = 0.05, MotionOptions()
    small = human.in_proportion(scale)
    variance = [0.5 * each.root_acceleration * each.root_decay_s for each in (human, small)]
    assert variance[1] == pytest.approx(variance[0] * (scale / time_factor(scale)) ** 2)
    turn = [0.5 * each.limb_acceleration * each.limb_decay_s for each in (human, small)]
    assert turn[1] == pytest.approx(turn[0] / time_factor(scale) ** 2)
