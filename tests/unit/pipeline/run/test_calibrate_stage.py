"""Calibration stage of a run: bounds of time offsets."""

import pytest

from posefuse.errors import CalibrationError
from posefuse.model.options.calibration import PeopleOptions
from posefuse.pipeline.run.calibrate_stage import _with_widening_offsets


@pytest.mark.parametrize(
    ("widest_s", "most_s", "expected"), [(0.0, 0.0, [0.0]), (10.0, 10.0, [2.0, 10.0]), (0.8, 10.0, [0.8, 2.0])]
)
def test_a_refused_calibration_is_tried_with_larger_offsets_that_are_allowed(widest_s, most_s, expected):
    tried = []

    def refuse(options):
        tried.append(options.max_offset_s)
        raise CalibrationError("The people do not determine the cameras.")

    with pytest.raises(CalibrationError):
        _with_widening_offsets(refuse, PeopleOptions(), widest_s, most_s)
    assert tried == expected
