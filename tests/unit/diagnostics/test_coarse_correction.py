"""Choice among corrections of gross faults."""

from typing import Any, cast

import pytest

from posefuse.diagnostics.coarse_correction import MIN_GAIN, CoarseCorrection, choose


def correction(kind: str, before: float, after: float) -> CoarseCorrection:
    return CoarseCorrection(kind, 0, cast("Any", None), before, after)


def test_the_largest_improvement_is_chosen():
    small, large = correction("offset", 0.8, 0.5), correction("focal", 0.8, 0.3)
    assert choose([small, large], 0.2) is large
    assert large.score == pytest.approx(200.0)


def test_the_first_of_equal_ones_is_chosen():
    simple, equal = correction("offset", 0.8, 0.3), correction("focal", 0.8, 0.29)
    assert choose([simple, equal], 0.2) is simple


@pytest.mark.parametrize(("kind", "gain"), [("offset", MIN_GAIN), ("image", 0.2)])
def test_small_improvements_are_none(kind, gain):
    assert choose([correction(kind, 0.3, 0.3 - 0.99 * gain)], 0.3) is None
    assert choose([correction(kind, 0.3, 0.3 - 1.01 * gain)], 0.3) is not None


def test_half_of_the_excess_must_be_explained():
    assert choose([correction("offset", 0.9, 0.6)], 0.2) is None
    assert choose([], 0.2) is None
