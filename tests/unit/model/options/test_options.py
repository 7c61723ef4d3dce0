"""Options refuse invalid combinations and name the valid range or choices."""

import pytest

from posefuse.errors import OptionsError
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TriangulationOptions(method="simpel"), "method must be one of .* got 'simpel'. Did you mean 'simple'"),
        (lambda: TriangulationOptions(min_views=1), "integer of at least 2, got 1"),
        (lambda: TriangulationOptions(min_confidence=float("nan")), "number of at least 0, got nan"),
        (lambda: TriangulationOptions(confidence_exponent=-1), "number from 0 to 4, got -1"),
        (lambda: Options(rate_hz=0), "rate_hz must be a finite number above 0 Hz, got 0"),
        (lambda: Options(noise_scale_px=-2), "noise_scale_px must be a finite number above 0 px, got -2"),
        (lambda: Options(start_s=3, end_s=2), r"end_s \(2.0\) must be above start_s \(3.0\)"),
        (lambda: Options(cameras=("a", "b"), exclude_camera=("b",)), "got b in both"),
        (lambda: Options(cameras=("a", "b", "a")), "cameras must not name anything twice, got a"),
        (lambda: Options(view_rates_hz=("cam_2=0",)), "rates above 0 Hz, got cam_2=0.0"),
        (lambda: Options(view_rates_hz=("cam_2",)), "view=rate entries such as cam_2=60, got 'cam_2'"),
    ],
)
def test_invalid_options_are_refused(make, message):
    with pytest.raises(OptionsError, match=message):
        make()
