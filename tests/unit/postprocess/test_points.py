"""Clocks of recordings."""

import numpy as np
import pytest

from posefuse.errors import DetectionsError
from posefuse.postprocess.points import Clock


def test_missing_times_are_an_error():
    with pytest.raises(DetectionsError, match="`rate_hz"):
        Clock.of(np.full(5, np.nan), None)
