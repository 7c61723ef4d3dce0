"""Options refuse what cannot be, and say what can."""

import pytest

from posefuse.errors import OptionsError
from posefuse.model.options.options import Options, TriangulationOptions


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: TriangulationOptions(method="simpel"), "no method 'simpel'. Did you mean 'simple'"),
        (lambda: TriangulationOptions(min_views=1), "at least 2, got 1"),
        (lambda: TriangulationOptions(min_confidence=float("nan")), "0 or more"),
        (lambda: TriangulationOptions(confidence_exponent=-1), "between 0 and 4"),
        (lambda: Options(rate_hz=0), "rate_hz must be positive"),
        (lambda: Options(noise_scale_px=-2), "noise_scale_px must be positive"),
        (lambda: Options(start_s=3, end_s=2), "must come after"),
        (lambda: Options(cameras=("a", "b"), exclude_camera=("b",)), "both name b"),
    ],
)
def test_impossible_choices_are_refused(make, words):
    with pytest.raises(OptionsError, match=words):
        make()
